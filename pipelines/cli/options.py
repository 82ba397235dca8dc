"""Options that several commands share."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from texloom.pipelines.request_fields import MOST_SEEDS, OPTIONS


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


_TILEABLE = ("x", "y", "both", "off")


def _tileable(_context: click.Context, _option: click.Parameter, value: str | None) -> str | None:
    """How the result is tileable; what follows a bare ``--tileable`` is no value, see `FlowCommand`."""
    if value not in (None, *_TILEABLE):
        raise click.BadParameter(f"{value!r} is none of x, y, both, which may be left out, and off")
    return value


class FlowCommand(click.Command):
    """A command whose ``--tileable`` may stand alone: a word that follows is its value, unless it is a file."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """See click."""
        end = args.index("--") if "--" in args else len(args)
        options = args[:end]
        for place in reversed([place for place, word in enumerate(options) if word == "--tileable"]):
            value = next(iter(options[place + 1 :]), "")
            is_value = value in _TILEABLE and not Path(value).exists()
            options[place : place + 1 + is_value] = [f"--tileable={value if is_value else 'both'}"]
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


class _NamedPath(click.Path):
    """A path; an empty word, as of a variable that is not set, is not the working folder."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """See click."""
        if value == "":
            self.fail("the path is empty", param, ctx)
        return super().convert(value, param, ctx)


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
    type=_NamedPath(),
    callback=_store_folder,
    help=OPTIONS["store"].help,
)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
report_option = click.option("--json", "as_json", is_flag=True, help="Print one machine-readable report on stdout.")
_PARSED = {"tileable": _tileable, "seeds": _seeds}
_COMPLETED = {
    **{name: name for name in ("sources", "params", "exports")},
    **{name: f"{name}s" for name in ("preset", "layout", "color_space", "runner")},
}


def request_option(field: str) -> Callable[..., Any]:
    """The option of a field of `RunRequest`."""
    option = OPTIONS[field]
    kinds: dict[type, dict[str, Any]] = {
        bool: {"is_flag": True},
        dict: {"multiple": True, "callback": assignments},
        Path: {"type": _NamedPath()},
    }
    more = kinds.get(option.kind, {"type": option.kind})
    if field in _PARSED:
        more["callback"] = _PARSED[field]
    if field in _COMPLETED:
        more["shell_complete"] = complete(_COMPLETED[field])
    flags = option.flags or (f"--{field.replace('_', '-')}",)
    return click.option(*flags, field, metavar=option.metavar or None, help=option.help, **more)


def request_options(*without: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that adds the arguments and options of a `RunRequest`, but for some fields."""
    others = {
        "flow": (click.argument("flow", required=False, shell_complete=complete("flow_names")),),
        "pictures": (
            click.argument("pictures", nargs=-1, metavar="[PICTURE]...", shell_complete=complete("pictures")),
        ),
        "store": (memory_option, store_option, report_option),
    }
    fields = [field for field in OPTIONS if field not in without]
    return with_options(*(one for field in fields for one in others.get(field) or (request_option(field),)))


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
