"""Options that several commands share."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from texloom.pipelines.request_fields import ABOUT, MOST_SEEDS


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


def _seeds(_context: click.Context, _option: click.Parameter, value: str | None) -> int | tuple[int, ...] | None:
    if value is None:
        return None
    found = re.fullmatch(r"(\d{1,18})(?:-(\d{1,18}))?", value)
    if not found:
        raise click.BadParameter(f"{value!r} is neither a number of seeds nor a range as 0-7")
    first, last = found.groups()
    seeds = range(int(first)) if last is None else range(int(first), int(last) + 1)
    if last is not None and not seeds:
        raise click.BadParameter(f"{value}: the first seed is larger than the last")
    if not 1 <= len(seeds) <= MOST_SEEDS:
        raise click.BadParameter(f"{value}: must be from 1 to {MOST_SEEDS} seeds")
    return len(seeds) if last is None else tuple(seeds)


def _tileable(_context: click.Context, _option: click.Parameter, value: str | None) -> str | None:
    """How the result is tileable; what follows a bare ``--tileable`` is no value, see `FlowCommand`."""
    if value not in (None, "x", "y", "both", "off"):
        raise click.BadParameter(f"{value!r} is none of x, y, both, which may be left out, and off")
    return value


class FlowCommand(click.Command):
    """A command whose ``--tileable`` has a value after ``=`` alone, as a picture may follow it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """See click."""
        end = args.index("--") if "--" in args else len(args)
        options = ["--tileable=both" if word == "--tileable" else word for word in args[:end]]
        return super().parse_args(ctx, [*options, *args[end:]])


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
    help=ABOUT["store"],
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
report_option = click.option("--json", "as_json", is_flag=True, help="Print one machine-readable report on stdout.")
common_params = (
    click.option(
        "--size",
        metavar="N|WIDTHxHEIGHT",
        help=ABOUT["size"],
    ),
    click.option("--tileable", metavar="[=x|y|both|off]", callback=_tileable, help=ABOUT["tileable"]),
    click.option(
        "--preset",
        metavar="NAME",
        shell_complete=complete("presets"),
        help=ABOUT["preset"],
    ),
)
"""short options for params that most flows declare"""
flow_options = (
    click.argument("flow", required=False, shell_complete=complete("flow_names")),
    click.argument("pictures", nargs=-1, metavar="[PICTURE]...", shell_complete=complete("pictures")),
    click.option(
        "--source", "sources", multiple=True, metavar="NAME=PATH", callback=assignments,
        shell_complete=complete("sources"),
        help=ABOUT["sources"],
    ),
    click.option(
        "--set", "params", multiple=True, metavar="PARAM=VALUE", callback=assignments,
        shell_complete=complete("params"),
        help=ABOUT["params"],
    ),
    click.option(
        "--export", "exports", multiple=True, metavar="NAME.EXT=STEP.OUTPUT", callback=assignments,
        shell_complete=complete("exports"),
        help=ABOUT["exports"],
    ),
    *common_params,
    click.option("--seed", type=int, help=ABOUT["seed"]),
    click.option(
        "--seeds", metavar="N|A-B", callback=_seeds,
        help=ABOUT["seeds"],
    ),
    memory_option,
    store_option,
    report_option,
)  # fmt: skip

delivery_options = (
    click.option(
        "--layout", metavar="NAME", shell_complete=complete("layouts"),
        help=ABOUT["layout"],
    ),
    click.option(
        "--texel-size", metavar="LENGTH",
        help=ABOUT["texel_size"],
    ),
    click.option(
        "--color-space", metavar="NAME", shell_complete=complete("color_spaces"),
        help=ABOUT["color_space"],
    ),
    click.option(
        "--udim", metavar="COLUMNSxROWS",
        help=ABOUT["udim"],
    ),
)  # fmt: skip

out_option = click.option(
    "--out", "-o", type=click.Path(path_type=Path), metavar="FOLDER|PICTURE",
    help=ABOUT["out"],
)  # fmt: skip
force_option = click.option("--force", is_flag=True, help=ABOUT["force"])

out_options = (
    out_option, force_option,
    click.option(
        "--runner", metavar="NAME", shell_complete=complete("runners"),
        help=ABOUT["runner"],
    ),
    click.option(
        "--workers", type=int, metavar="N",
        help=ABOUT["workers"],
    ),
    click.option(
        "--address", metavar="tcp://HOST:PORT",
        help=ABOUT["address"],
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
def named_as_given(params: Mapping[str, Any]) -> Iterator[None]:
    """Errors of params that are not among those of ``--set`` name the short option."""
    from texloom.stages.vocabulary.declare import InputError

    try:
        yield
    except InputError as error:
        option = re.match(r"--set (size|tileable|preset):", str(error))
        if option is None or option[1] in params:
            raise
        raise InputError(str(error).replace("--set ", "--", 1)) from None
