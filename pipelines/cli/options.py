"""Options that several commands share."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

_MOST_SEEDS = 1000


def complete(what: str) -> Callable[[click.Context, click.Parameter, str], Any]:
    """A function of `texloom.pipelines.cli.completion`, which is imported when a shell asks."""

    def complete(context: click.Context, parameter: click.Parameter, typed: str) -> Any:
        from texloom.pipelines.cli import completion

        return getattr(completion, what)(context, parameter, typed)

    return complete


def assignments(_context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """NAME=VALUE of an option that may be repeated, as a mapping."""
    found: dict[str, str] = {}
    for value in values:
        name, equals, given = value.partition("=")
        name = name.strip()
        if not equals or not name or not given:
            raise click.BadParameter(f"{value!r} is not of the form {option.metavar}")
        if name in found:
            raise click.BadParameter(f"{name!r} is given twice: {found[name]!r} and {given!r}")
        found[name] = given
    return found


def _seeds(_context: click.Context, _option: click.Parameter, value: str | None) -> int | range | None:
    if value is None:
        return None
    found = re.fullmatch(r"(\d{1,18})(?:-(\d{1,18}))?", value)
    if not found:
        raise click.BadParameter(f"{value!r} is neither a number of seeds nor a range as 0-7")
    first, last = found.groups()
    seeds = range(int(first)) if last is None else range(int(first), int(last) + 1)
    if last is not None and not seeds:
        raise click.BadParameter(f"{value}: the first seed is larger than the last")
    if not 1 <= len(seeds) <= _MOST_SEEDS:
        raise click.BadParameter(f"{value}: must be from 1 to {_MOST_SEEDS} seeds")
    return len(seeds) if last is None else seeds


def _set_memory(context: click.Context, _option: click.Parameter, value: str | None) -> None:
    """Set the limit for this process and its workers, until the command ends."""
    from texloom.pipelines.memory import VARIABLE, parse_memory

    if value is None:
        return
    parse_memory(value, "--memory")
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = value

    def restore() -> None:
        os.environ.pop(VARIABLE)
        if before is not None:
            os.environ[VARIABLE] = before

    context.call_on_close(restore)


def _store_folder(_context: click.Context, _option: click.Parameter, folder: Path | None) -> Path:
    from texloom.pipelines.store.location import default_store

    try:
        return (folder or default_store()).expanduser()
    except RuntimeError:
        raise click.BadParameter(f"{str(folder)!r} is in a home folder that is not known") from None


memory_option = click.option(
    "--memory", metavar="SIZE", callback=_set_memory, expose_value=False,
    help="Refuse pictures that take more memory to decode, and keep larger arrays in files: 4GB or 4GiB; "
    "also TEXLOOM_MEMORY.  [default: half of the machine's]",
)  # fmt: skip
store_option = click.option(
    "--store",
    "store_folder",
    envvar="TEXLOOM_STORE",
    type=click.Path(path_type=Path),
    callback=_store_folder,
    help="Folder of the results; also TEXLOOM_STORE.  [default: artifacts, if there is such a folder here, else "
    "one in the user's cache folder]",
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
report_option = click.option("--json", "as_json", is_flag=True, help="Print one machine-readable report on stdout.")
common_params = (
    click.option(
        "--size",
        metavar="N|WIDTHxHEIGHT",
        help="Size of the result, px: 1024, or 2048x1024 for 2048 wide and 1024 high; short for --set size=...",
    ),
    click.option("--tileable", is_flag=True, help="The result continues across its borders; --set tileable=true."),
    click.option(
        "--preset",
        metavar="NAME",
        shell_complete=complete("presets"),
        help="Values for many params at once; short for --set preset=NAME.",
    ),
)
"""short options for params that most flows declare"""
flow_options = (
    click.argument("flow", required=False, shell_complete=complete("flow_names")),
    click.argument("pictures", nargs=-1, metavar="[PICTURE]...", shell_complete=complete("pictures")),
    click.option(
        "--source", "sources", multiple=True, metavar="NAME=PATH", callback=assignments,
        shell_complete=complete("sources"),
        help="Take another picture as a source of the flow: PNG, JPEG, TIFF, EXR ..., or one that ships, such "
        "as texloom:bricks or skimage:gravel.",
    ),
    click.option(
        "--set", "params", multiple=True, metavar="PARAM=VALUE", callback=assignments,
        shell_complete=complete("params"),
        help="Change a param of the flow, see `texloom flows NAME`, or of a step, such as texture.patch_size=12; "
        "lists are written a,b,c or none, entries of a mapping texture.weights.height=0.",
    ),
    click.option(
        "--export", "exports", multiple=True, metavar="NAME.EXT=STEP.OUTPUT", callback=assignments,
        shell_complete=complete("exports"),
        help="Also write another file, such as edges.png=edges.strength; `texloom stages STAGE` lists outputs.",
    ),
    *common_params,
    click.option("--seed", type=int, help="Random seed; the same seed gives the same bits."),
    click.option(
        "--seeds", metavar="N|A-B", callback=_seeds,
        help="Run with N seeds from --seed on, or with those from A to B, and make a contact sheet.",
    ),
    memory_option,
    store_option,
    report_option,
)  # fmt: skip

delivery_options = (
    click.option(
        "--layout", metavar="NAME", shell_complete=complete("layouts"),
        help="Write material sets with the file names, packed channels, normals and bits of a program: unreal, "
        "unity, blender, gltf, arnold, substance.",
    ),
    click.option(
        "--texel-size", metavar="LENGTH",
        help="Side of a pixel, such as 0.5mm: the size of the result in MaterialX, USD, glTF, EXR and tx, and the "
        "depth of its displacement.",
    ),
    click.option(
        "--color-space", metavar="NAME", shell_complete=complete("color_spaces"),
        help="Colour space of EXR and tx: rec709 (linear), the default, or acescg.",
    ),
    click.option(
        "--udim", metavar="COLUMNSxROWS",
        help="Cut the maps of a layout into tiles, such as 3x2, with 1001 at the lower left.",
    ),
)  # fmt: skip

out_option = click.option(
    "--out", "-o", type=click.Path(path_type=Path), metavar="FOLDER|PICTURE",
    help="Folder of the exports, or a picture, as result.png, for the main result alone.  "
    "[default: ./PICTURE_FLOW]",
)  # fmt: skip
force_option = click.option(
    "--force", is_flag=True, help="Replace files in --out that texloom did not write, or that were changed since."
)

out_options = (
    out_option, force_option,
    click.option(
        "--runner", metavar="NAME", shell_complete=complete("runners"),
        help="What computes the steps. local: this process, one item after the other; the default. threads, "
        "processes: several steps at a time on this machine. dask: the workers of a cluster. With "
        "PREFECT_API_URL set, the server there shows the run.",
    ),
    click.option(
        "--workers", type=int, metavar="N",
        help="How many steps at a time, for threads, processes and dask; they share the processors.  "
        "[default: what processors and memory allow]",
    ),
    click.option(
        "--address", metavar="tcp://HOST:PORT",
        help="Address of the scheduler of a running Dask cluster; without it, --runner dask starts one here.",
    ),
)  # fmt: skip


def with_options(*options: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that adds ``options`` in their order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


@contextlib.contextmanager
def named_as_given(params: dict[str, str]) -> Iterator[None]:
    """Errors of params that are not among those of ``--set`` name the short option."""
    from texloom.stages.declare import InputError

    try:
        yield
    except InputError as error:
        option = re.match(r"--set (size|tileable|preset):", str(error))
        if option is None or option[1] in params:
            raise
        raise InputError(str(error).replace("--set ", "--", 1)) from None


def with_common_params(
    params: dict[str, str], size: str | None, tileable: bool, preset: str | None
) -> dict[str, str]:
    """The params of ``--set`` and of `common_params`."""
    given = {"size": size, "tileable": "true" if tileable else None, "preset": preset}
    common = {name: value for name, value in given.items() if value is not None}
    twice = next((name for name in common if name in params), None)
    if twice is not None:
        raise click.UsageError(f"--{twice} and --set {twice}=... say the same; give one of them")
    return params | common


def runner_options(**options: Any) -> dict[str, Any]:
    """What the command line says of the runner."""
    return {name: value for name, value in options.items() if value is not None}
