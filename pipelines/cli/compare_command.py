"""``texloom compare``: several flows on the same exemplars."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator
from pathlib import Path

import click

from texloom.pipelines.cli.options import (
    FlowCommand,
    assignments,
    complete,
    memory_option,
    named_as_given,
    report_option,
    request_option,
    store_option,
    with_options,
)
from texloom.pipelines.cli.run_commands import execute
from texloom.pipelines.request_fields import RUNNER, SHORT


@click.command(cls=FlowCommand, short_help="Run several flows on the same exemplars and say which is better.")
@click.argument("flows", nargs=-1, metavar="FLOW...", shell_complete=complete("flow_names"))
@click.option(
    "--over",
    required=True,
    metavar="PATH",
    shell_complete=complete("paths"),
    help="The exemplars: a folder, a picture, or a pattern as 'library/*.png'.",
)
@click.option(
    "--against", multiple=True, metavar="NAME=FOLDER", callback=assignments, shell_complete=complete("paths"),
    help="Judge the pictures of FOLDER, named as the exemplars, as results of NAME. Larger ones are cropped to "
    "their centre; smaller ones are refused, and tileable ones of another size.",
)  # fmt: skip
@click.option(
    "--seeds", metavar="N", type=click.IntRange(1, 1000), default=1, show_default=True,
    help="How many seeds for each exemplar.",
)  # fmt: skip
@click.option("--seed", type=int, help="The first seed.")
@click.option(
    "--set", "params", multiple=True, metavar="PARAM=VALUE", callback=assignments,
    shell_complete=complete("params"),
    help="Change a param that all flows declare, as size, or that a step of all has, as texture.tileable; that of "
    "one flow is FLOW_STEP.PARAM.",
)  # fmt: skip
@with_options(*map(request_option, SHORT))
@click.option(
    "--report", type=click.Path(path_type=Path), metavar="FILE.html",
    help="Write the page here too, and FILE.csv and FILE.json beside it.",
)  # fmt: skip
@with_options(*map(request_option, ("out", "force", *RUNNER, "remote")))
@memory_option
@store_option
@report_option
def compare(
    flows: tuple[str, ...],
    over: str,
    against: dict[str, str],
    params: dict[str, str],
    size: str | None,
    tileable: str | None,
    preset: str | None,
    seed: int | None,
    seeds: int,
    report: Path | None,
    out: Path | None,
    force: bool,
    runner: str | None,
    workers: int | None,
    address: str | None,
    remote: str | None,
    store_folder: Path,
    as_json: bool,
) -> int:
    """Run several flows on the same exemplars and seeds, and say which is better at what.

    \b
    texloom compare self_tuning quilting --over library --size 512 --report compared.html
    texloom compare self_tuning --against other_tool=results --over library --size 512

    Writes comparison.html, with a leaderboard and all pictures at one scale, comparison.csv, the leaderboard,
    comparison.json, all scores, and each result. All results have one size, by default the first flow's.
    """
    from texloom.pipelines.engine.destination import placed
    from texloom.pipelines.engine.opening import open_store
    from texloom.pipelines.engine.preflight import Preflight
    from texloom.pipelines.engine.run import Run
    from texloom.pipelines.errors import one_line
    from texloom.pipelines.flow.comparison import EXPORTS, comparison_flow
    from texloom.pipelines.request import request
    from texloom.pipelines.store.atomic import write_atomically
    from texloom.stages.vocabulary.declare import InputError

    began = time.perf_counter()
    asked = request(
        flow="comparison", params=params, size=size, tileable=tileable, preset=preset, seed=seed, seeds=seeds,
        runner=runner, workers=workers, address=address,
        store=store_folder, remote=remote,
    )  # fmt: skip
    methods = [*flows, *(f"{name}={folder}" for name, folder in against.items())]
    with named_as_given(params), _named_as_over():
        opened = Run(comparison_flow(methods, asked.overrides, over), open_store(asked))
    opened, folder = placed(opened, out)
    copies = {} if report is None else {name: report.with_suffix(Path(name).suffix) for name in EXPORTS}
    if report is not None:
        preflight = Preflight(opened)
        for path in (report, *copies.values()):
            preflight.check_file("--report", path)
        if report.suffix.lower() != ".html":
            raise InputError(one_line(f"--report {report}: must be the name of an .html file"))
    code = execute(opened, folder, as_json, began, force)
    for name, path in copies.items():
        made = folder / name
        if made.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, made.read_bytes())
    return code


@contextlib.contextmanager
def _named_as_over() -> Iterator[None]:
    """Errors of the exemplars name the option, which gives them whatever the flows call that source."""
    from texloom.stages.vocabulary.declare import InputError

    try:
        yield
    except InputError as error:
        source = re.match(r"(?:[^:]*: )?sources\.(\w+): ", str(error))
        if source is None or source[1].endswith("_picture"):  # one of --against
            raise
        raise InputError(f"--over: {str(error)[source.end() :]}") from None
