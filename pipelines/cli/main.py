"""The command ``texloom``. Heavy libraries are imported by the commands that need them, so that help is instant."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import os
import re
import signal
import sys
import textwrap
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from texloom.pipelines.cli.output import print_json, say, text_stream
from texloom.pipelines.cli.store import store, store_option
from texloom.pipelines.interruption import interruption_of

if TYPE_CHECKING:
    from texloom.pipelines.engine.events import StepReport
    from texloom.pipelines.engine.run import Run, StepPlan

_MOST_SEEDS = 1000
_WHICH_FLOW = """\
texloom: which flow? For a larger texture of one picture:

    texloom run self_tuning mine.png --size 1024 --tileable --out mine

    self_tuning        a larger texture of one exemplar, of the best quality
    quilting           the same in a second or two
    materials          the same for a folder of maps: albedo, normal, roughness, height
    make_tileable      a picture that tiles; only its borders change
    fill               holes of a picture filled from the rest of it
    photo_to_texture   a flat texture from a surface in a photograph

Without a picture, a flow uses an example that ships. `texloom flows` lists all flows."""
_ENDING = (signal.SIGINT, signal.SIGTERM)
_DONE, _FAILED, _WRONG, _INTERRUPTED, _TERMINATED = 0, 1, 2, 130, 143


class _WhichFlowError(Exception):
    """No flow is named."""


class _Commands(click.Group):
    """Commands, with a hint where a flow stands for one."""

    def resolve_command(self, context: click.Context, args: list[str]) -> Any:
        try:
            return super().resolve_command(context, args)
        except click.UsageError:
            from texloom.pipelines.flow.shipped import shipped_flows

            if args[0] not in shipped_flows():
                raise
            raise click.UsageError(f"{args[0]} is a flow: texloom run {args[0]}", context) from None


class _Termination(KeyboardInterrupt):
    """SIGTERM: whatever ends by Ctrl-C ends by it in the same way."""


def _end(number: int, _: object) -> None:
    """End the run in order, with what is finished kept; the next signal ends this process at once."""
    for one in _ENDING:
        if signal.getsignal(one) == _end:
            signal.signal(one, signal.SIG_DFL)
    raise _Termination if number == signal.SIGTERM else KeyboardInterrupt


def _ended_by(error: BaseException) -> tuple[str, int]:
    """How a run was ended from outside, in a word and as an exit code."""
    if isinstance(interruption_of(error), _Termination):
        return "terminated", _TERMINATED
    return "interrupted", _INTERRUPTED


def main() -> None:
    """Run the command line and exit.

    0: done, 1: a stage failed, 2: the request is wrong, 130: interrupted, 143: terminated.
    """
    gc.set_threshold(100_000, 20, 20)  # collecting the many objects of imports takes a tenth of a plan
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search for plug-ins takes as long
    before = {number: signal.getsignal(number) for number in _ENDING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:  # as in a shell's background, where Ctrl-C is not for this process
            signal.signal(number, _end)
    if os.environ.get("_TEXLOOM_COMPLETE"):
        from texloom.pipelines.cli.completion import register

        register()
    try:
        code = texloom.main(prog_name="texloom", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "")
        code = _WRONG
    except _WhichFlowError:
        click.echo(_WHICH_FLOW, err=True)
        code = _WRONG
    except click.ClickException as error:
        command = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "texloom"
        _complain(f"{command}: {error.format_message()}")
        code = _WRONG
    except ValueError as error:
        from texloom.stages.declare import InputError  # not at the top, as help does not need it

        if not isinstance(error, InputError):
            raise
        _complain(f"texloom: {error}")
        code = _WRONG
    except (KeyboardInterrupt, RuntimeError, ImportError) as error:
        if interruption_of(error) is None and not isinstance(error, click.Abort):
            raise
        ended, code = _ended_by(error)
        click.echo(f"texloom: {ended}", err=True)  # without imports: one of them may have been interrupted
    except OSError as error:  # a full disk, a folder that has gone; click leaves quietly when a pipe is closed
        named = error.errno is None or error.filename is not None  # as all that is written by name
        _complain(f"texloom: {'' if named else 'standard output: '}{error if named else error.strerror}")
        if not named:  # Python would try once more at its end, and complain
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = _FAILED
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) == _end:  # nothing has ended the run
                signal.signal(number, handler)
    if "OpenImageIO" not in sys.modules:  # which complains about what is not collected
        gc.freeze()  # to look through all that a run has loaded once more would take a quarter of a second
    sys.exit(code or _DONE)


def _complain(text: str) -> None:
    from texloom.pipelines.errors import one_line

    click.echo(one_line(text.replace("\n", " ")), err=True)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="texloom")
def texloom() -> None:
    """Make new textures from example textures; compute nothing twice.

    \b
    texloom flows                                        what it can make, and from what
    texloom run self_tuning                              the main method on an exemplar that ships
    texloom run self_tuning mine.png --size 1024x1536 --tileable --out mine
    texloom plan self_tuning mine.png --preset fast      what that would compute again, and why
    """


def _complete(what: str) -> Callable[[click.Context, click.Parameter, str], Any]:
    """A function of `texloom.pipelines.cli.completion`, which is imported when a shell asks."""

    def complete(context: click.Context, parameter: click.Parameter, typed: str) -> Any:
        from texloom.pipelines.cli import completion

        return getattr(completion, what)(context, parameter, typed)

    return complete


def _assignments(_context: click.Context, option: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
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


_memory_option = click.option(
    "--memory", metavar="SIZE", callback=_set_memory, expose_value=False,
    help="Refuse pictures that take more memory to decode, and keep larger arrays in files: 4GB or 4GiB; "
    "also TEXLOOM_MEMORY.  [default: half of the machine's]",
)  # fmt: skip
_common_params = (
    click.option("--size", metavar="N|HxW", help="Height and width of the result, px; short for --set size=..."),
    click.option("--tileable", is_flag=True, help="The result continues across its borders; --set tileable=true."),
    click.option(
        "--preset",
        metavar="NAME",
        shell_complete=_complete("presets"),
        help="Values for many params at once; short for --set preset=NAME.",
    ),
)
"""short options for params that most flows declare"""


def _with_options(*options: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that adds ``options`` in their order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


@contextlib.contextmanager
def _named_as_given(params: dict[str, str]) -> Iterator[None]:
    """Errors of params that are not among those of ``--set`` name the short option."""
    from texloom.stages.declare import InputError

    try:
        yield
    except InputError as error:
        option = re.match(r"--set (size|tileable|preset):", str(error))
        if option is None or option[1] in params:
            raise
        raise InputError(str(error).replace("--set ", "--", 1)) from None


def _with_common(params: dict[str, str], size: str | None, tileable: bool, preset: str | None) -> dict[str, str]:
    """The params of ``--set`` and of `_common_params`."""
    given = {"size": size, "tileable": "true" if tileable else None, "preset": preset}
    common = {name: value for name, value in given.items() if value is not None}
    twice = next((name for name in common if name in params), None)
    if twice is not None:
        raise click.UsageError(f"--{twice} and --set {twice}=... say the same; give one of them")
    return params | common


_flow_options = (
    click.argument("flow", required=False, shell_complete=_complete("flow_names")),
    click.argument("pictures", nargs=-1, metavar="[PICTURE]...", shell_complete=_complete("pictures")),
    click.option(
        "--source", "sources", multiple=True, metavar="NAME=PATH", callback=_assignments,
        shell_complete=_complete("sources"),
        help="Take another picture as a source of the flow: PNG, JPEG, TIFF, EXR ..., or one that ships, such "
        "as texloom:bricks or skimage:gravel.",
    ),
    click.option(
        "--set", "params", multiple=True, metavar="PARAM=VALUE", callback=_assignments,
        shell_complete=_complete("params"),
        help="Change a param of the flow, see `texloom flows NAME`, or of a step, such as texture.patch_size=12; "
        "lists are written a,b,c or none, entries of a mapping texture.weights.height=0.",
    ),
    click.option(
        "--export", "exports", multiple=True, metavar="NAME.EXT=STEP.OUTPUT", callback=_assignments,
        shell_complete=_complete("exports"),
        help="Also write another file, such as edges.png=edges.strength; `texloom stages STAGE` lists outputs.",
    ),
    *_common_params,
    click.option("--seed", type=int, help="Random seed; the same seed gives the same bits."),
    click.option(
        "--seeds", metavar="N|A-B", callback=_seeds,
        help="Run with N seeds from --seed on, or with those from A to B, and make a contact sheet.",
    ),
    _memory_option,
    store_option,
    click.option("--json", "as_json", is_flag=True, help="Print one machine-readable report on stdout."),
)  # fmt: skip

_delivery_options = (
    click.option(
        "--layout", metavar="NAME", shell_complete=_complete("layouts"),
        help="Write material sets with the file names, packed channels, normals and bits of a program: unreal, "
        "unity, blender, gltf, arnold, substance.",
    ),
    click.option(
        "--texel-size", metavar="LENGTH",
        help="Side of a pixel, such as 0.5mm: the size of the result in MaterialX, USD, glTF, EXR and tx, and the "
        "depth of its displacement.",
    ),
    click.option(
        "--color-space", metavar="NAME", shell_complete=_complete("color_spaces"),
        help="Colour space of EXR and tx: rec709 (linear), the default, or acescg.",
    ),
    click.option(
        "--udim", metavar="ROWSxCOLUMNS",
        help="Cut the maps of a layout into tiles, such as 2x3, with 1001 at the lower left.",
    ),
)  # fmt: skip

_out_options = (
    click.option(
        "--out", type=click.Path(path_type=Path), help="Folder of the exports.  [default: STORE/runs/FLOW-TIME]"
    ),
    click.option(
        "--runner", metavar="NAME", shell_complete=_complete("runners"),
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


def _chosen(**options: Any) -> dict[str, Any]:
    """What the command line says of the runner."""
    return {name: value for name, value in options.items() if value is not None}


texloom.add_command(store)


@texloom.command(short_help="Run a flow and write its exports.")
@_with_options(
    *_flow_options, *_delivery_options, *_out_options,
    click.option(
        "--item", metavar="NAME",
        help="Run only this item of a set, and no step that gathers, as the lines of `texloom commands` do.",
    ),
)  # fmt: skip
def run(
    flow: str | None,
    pictures: tuple[str, ...],
    as_json: bool,
    out: Path | None,
    runner: str | None,
    workers: int | None,
    address: str | None,
    **options: Any,
) -> int:
    """Run FLOW, one of `texloom flows` or a YAML file, and write its exports.

    \b
    texloom run self_tuning mine.png --size 1024 --tileable --out mine
    texloom run self_tuning mine.png --seeds 8           eight variants and a contact sheet
    texloom run self_tuning 'library/*.png' --out large  every picture of a folder
    texloom run materials moss --out moss_large          a folder of maps: albedo, normal, height ...
    texloom run fill mine.png --source holes=holes.png

    PICTURE replaces the flow's first source, --source any by its name. Several pictures, a folder of pictures or a
    quoted pattern are a set: the flow runs for each, with a folder of exports each; a file that fails is named at
    the end and does not stop the others. A folder of one material's maps is one picture.

    Steps whose result is in the store are not computed again. Interrupt at any time: what is finished is kept, and
    long steps go on at the scale where they were.
    """
    began = time.perf_counter()
    opened = _open(flow, pictures, **options, runner=_chosen(name=runner, workers=workers, address=address))
    return _execute(opened, out if out is not None else opened.default_out(), as_json, began)


def _execute(opened: Run, folder: Path, as_json: bool, began: float) -> int:
    """Run what has been opened and say how it went."""
    from texloom.pipelines.engine import scheduler
    from texloom.pipelines.engine.events import Recorder, summary_of
    from texloom.pipelines.engine.run import StepFailedError
    from texloom.pipelines.errors import is_resource_error
    from texloom.pipelines.memory import keep_freed_memory
    from texloom.pipelines.store.codec import ArtifactError
    from texloom.pipelines.store.store import BrokenStoreError
    from texloom.pipelines.terminal import Terminal
    from texloom.stages.declare import InputError

    opened.check(folder)
    terminal = Terminal(text_stream(as_json))
    recorder = Recorder(terminal)
    exports: dict[str, Path] = {}
    problem, code = None, _DONE
    gc.freeze()  # what is there stays; looking through it again and again takes a tenth of the run of a large set
    keep_freed_memory()
    try:
        exports = scheduler.execute(opened, recorder, folder)
        if recorder.problems:
            problem, code = summary_of(recorder.problems, len(opened.items)), _FAILED
    except InputError as error:
        problem, code = str(error), _WRONG
    except StepFailedError as error:
        terminal.close()
        if not is_resource_error(error.__cause__):
            for line in "".join(traceback.format_exception(error.__cause__)).splitlines():
                _complain(line)
        problem, code = f"{opened.flow.where('steps', error.step)}: failed: {error.reason}", _FAILED
    except ArtifactError as error:
        problem, code = f"--out: {error}", _FAILED
    except BrokenStoreError as error:
        problem, code = str(error), _FAILED
    except KeyboardInterrupt as error:
        ended, code = _ended_by(error)
        problem = f"{ended}; what is finished is kept, and the next run goes on from there"
    finally:
        terminal.close()
    if problem is not None:
        _complain(f"texloom: {problem}")
    if opened.items and exports:
        say(opened.out_folder(folder), as_json)
    for name, path in exports.items():
        if "/" not in name.removesuffix("/"):  # not an item's
            say(path, as_json)
    if code == _DONE:
        terminal.summarise(opened.main_scores(), opened.out_folder(folder) if exports else None)
    if as_json:
        print_json(
            {
                **_what(opened),
                "runner": opened.flow.runner.name,
                "steps": [_step(report) for report in recorder.reports.values()],
                **({"items": recorder.items(len(opened.items))} if opened.items else {}),
                "exports": {name: str(path) for name, path in exports.items()},
                "seconds": time.perf_counter() - began,
                "error": problem,
            }
        )
    return code


@texloom.command(short_help="Run several flows on the same exemplars and say which is better.")
@click.argument("flows", nargs=-1, metavar="FLOW...", shell_complete=_complete("flow_names"))
@click.option(
    "--over",
    required=True,
    metavar="PATH",
    shell_complete=_complete("paths"),
    help="The exemplars: a folder, a picture, or a pattern as 'library/*.png'.",
)
@click.option(
    "--against", multiple=True, metavar="NAME=FOLDER", callback=_assignments, shell_complete=_complete("paths"),
    help="Judge the pictures of FOLDER, named as the exemplars, as results of NAME. Larger ones are cropped to "
    "their centre; smaller ones are refused, and tileable ones of another size.",
)  # fmt: skip
@click.option("--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="Seeds an exemplar.")
@click.option("--seed", type=int, help="The first seed.")
@click.option(
    "--set", "params", multiple=True, metavar="PARAM=VALUE", callback=_assignments,
    shell_complete=_complete("params"),
    help="Change a param that all flows declare, as size, or that a step of all has, as texture.tileable; that of "
    "one flow is FLOW_STEP.PARAM.",
)  # fmt: skip
@_with_options(*_common_params)
@click.option(
    "--report", type=click.Path(path_type=Path), metavar="FILE.html",
    help="Write the page here too, and FILE.csv and FILE.json beside it.",
)  # fmt: skip
@_with_options(*_out_options)
@_memory_option
@store_option
@click.option("--json", "as_json", is_flag=True, help="Print one machine-readable report on stdout.")
def compare(
    flows: tuple[str, ...],
    over: str,
    against: dict[str, str],
    params: dict[str, str],
    size: str | None,
    tileable: bool,
    preset: str | None,
    seed: int | None,
    seeds: int,
    report: Path | None,
    out: Path | None,
    runner: str | None,
    workers: int | None,
    address: str | None,
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
    from texloom.pipelines.engine.run import Run
    from texloom.pipelines.errors import one_line
    from texloom.pipelines.flow.compare import EXPORTS, comparison_flow
    from texloom.pipelines.flow.model import Overrides
    from texloom.pipelines.store.atomic import write_atomically
    from texloom.pipelines.store.store import Store
    from texloom.stages.declare import InputError

    began = time.perf_counter()
    chosen = _chosen(name=runner, workers=workers, address=address)
    changed = _with_common(params, size, tileable, preset)
    overrides = Overrides(params=changed, seed=seed, seeds=seeds, runner=chosen)
    methods = [*flows, *(f"{name}={folder}" for name, folder in against.items())]
    with _named_as_given(params):
        opened = Run(comparison_flow(methods, overrides, over), Store(store_folder))
    folder = out if out is not None else opened.default_out()
    copies = {} if report is None else {name: report.with_suffix(Path(name).suffix) for name in EXPORTS}
    if report is not None:
        for path in (report, *copies.values()):
            opened.check_file("--report", path)
        if report.suffix.lower() != ".html":
            raise InputError(one_line(f"--report {report}: must be the name of an .html file"))
    code = _execute(opened, folder, as_json, began)
    for name, path in copies.items():
        made = opened.out_folder(folder) / name
        if made.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, made.read_bytes())
    return code


@texloom.command(short_help="Show what `run` would compute, and why.")
@_with_options(*_flow_options)
def plan(flow: str | None, pictures: tuple[str, ...], as_json: bool, **options: Any) -> int:
    """Show what `run` would do with the same options: which steps are cached, which would run, and why.

    \b
    texloom plan self_tuning mine.png --preset fast
    texloom plan self_tuning mine.png --set texture.occurrence=20 --set texture.patch_size=12

    Runs nothing and writes nothing.
    """
    opened = _open(flow, pictures, **options)
    steps = opened.plan()
    for note in opened.notes:
        _complain(note)
    taken = opened.footprint() if any(step.state != "cached" for step in steps) else None
    if as_json:
        needs = {} if taken is None else {"needs": {"memory": taken.memory, "disk": taken.disk}}
        print_json({**_what(opened), "steps": [_step(step) for step in steps], **needs})
    else:
        _print_plan(steps)
        if taken is not None:
            say(taken.problem or str(taken))
    return _DONE


def _print_plan(steps: list[StepPlan]) -> None:
    from texloom.pipelines.engine.events import label

    labels = [label(step.name, step.item) for step in steps]
    width = max(map(len, labels))
    for name, step in zip(labels, steps, strict=True):
        reasons = f"  {'; '.join(step.reasons)}" if step.reasons else ""
        say(f"{name:{width}}  {step.state:6}{reasons}".rstrip())


@texloom.command(short_help="Print one command line per item of a set, for a render farm.")
@_with_options(
    *_flow_options, *_delivery_options,
    click.option("--out", type=click.Path(path_type=Path), help="Folder of the exports, as of `run`."),
    click.option("--only", type=click.Choice(["items", "gather"]), help="Print the lines of one kind."),
)  # fmt: skip
def commands(
    flow: str | None, pictures: tuple[str, ...], as_json: bool, out: Path | None, only: str | None, **options: Any
) -> int:
    """Print the command lines that together do what `run` would: one per item of a set, and one that gathers.

    \b
    texloom commands self_tuning 'library/*.png' --seeds 0-3 --store /net/store --out /net/out > lines.txt

    The lines of items may run at the same time, on machines that share the store; the last one, if there are steps
    that gather, comes after all of them. A line that is repeated computes nothing twice. All paths are absolute.
    """
    from texloom.pipelines.flow.command_list import command_list

    opened = _open(flow, pictures, **options)
    folder = out if out is not None else opened.default_out()
    opened.check(folder)
    listed = command_list(opened.flow, opened.items, opened.store.root, folder)
    if as_json:
        return print_json({**_what(opened), "items": listed.items, "gather": listed.gather})
    for line in listed.lines(only):
        click.echo(line)  # whole, however long
    return _DONE


@texloom.command(short_help="List the flows, or explain one: sources, steps, exports.")
@click.argument("name", required=False, shell_complete=_complete("flow_names"))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def flows(name: str | None, as_json: bool) -> int:
    """List the flows that ship with texloom, or explain the one called NAME: sources, steps, exports.

    \b
    texloom flows
    texloom flows self_tuning

    NAME may also be a YAML file. `texloom stages` explains the params of the steps.
    """
    from texloom.pipelines.flow.shipped import flow_catalogue

    if name is None:
        return _print_catalogue(flow_catalogue(), "flows", as_json)
    from texloom.pipelines.cli.describe import flow_description, flow_explained

    found = flow_description(name)
    if as_json:
        return print_json(found)
    click.echo(flow_explained(found))
    click.echo("\ntexloom stages STAGE explains the params of a step.")
    return _DONE


def _print_catalogue(entries: dict[str, str], command: str, as_json: bool) -> int:
    if as_json:
        return print_json(entries)
    width = max(map(len, entries))
    for name, summary in entries.items():
        click.echo(f"{name:{width}}  {summary}")
    click.echo(f"\ntexloom {command} NAME explains one.")
    return _DONE


@texloom.command(short_help="List the stages, or explain one: inputs, params, outputs, source.")
@click.argument("name", required=False, shell_complete=_complete("stage_names"))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def stages(name: str | None, as_json: bool) -> int:
    """List the stages, or explain the one called NAME: inputs, params with defaults, outputs, source.

    \b
    texloom stages
    texloom stages optimise
    """
    from texloom.pipelines.cli.describe import catalogue, description, explained

    if name is None:
        return _print_catalogue(catalogue(), "stages", as_json)
    found = description(name)
    if as_json:
        return print_json(found)
    click.echo(explained(found))
    return _DONE


@texloom.command("check-stage", short_help="Test the properties that every stage must have, as of a plug-in.")
@click.argument("name", shell_complete=_complete("stage_names"))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def check_stage(name: str, as_json: bool) -> int:
    """Test a stage on small synthetic exemplars: documentation, equal bits, masks, tiling, maps, bad input.

    \b
    TEXLOOM_PLUGINS=~/my_method texloom check-stage my_method

    What does not apply to a stage is skipped. The exit code is 1 if a property does not hold.
    """
    from texloom.pipelines.cli import check_stage as checks

    outcomes = checks.check_stage(name)
    if as_json:
        print_json([dataclasses.asdict(one) for one in outcomes])
    else:
        for one in outcomes:
            say(f"{one.name:16}  {one.state:7}  {one.detail}".rstrip())
    return _FAILED if any(one.state == "failed" for one in outcomes) else _DONE


@texloom.command(short_help="Show the contents and provenance of EXR files.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option(
    "--png",
    "folder",
    type=click.Path(path_type=Path),
    help="Write each layer as a PNG into this folder; those of several files into folders of their own there. "
    "Files that are there and hold something else are not replaced.",
)
@_memory_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON; a list, if there are several files.")
def show(files: tuple[Path, ...], folder: Path | None, as_json: bool) -> int:
    """Show the contents of EXR files (layers, sizes, channels) and their provenance.

    \b
    texloom show mine/texture.exr
    texloom show mine/texture.exr --png layers
    """
    from texloom.pipelines.store import codec
    from texloom.pipelines.store.atomic import check_folder

    several = len(files) > 1
    folders: dict[Path, Path] = {}
    if folder is not None:
        check_folder("--png", folder)
        folders = _folders_of_pictures(files, folder) if several else {files[0]: folder}
        for file, place in folders.items():
            codec.check_pictures(file, place)
    reports = []
    for file in files:
        found = codec.describe(file)
        written = codec.pictures(file, folders[file]) if folders else []
        reports.append({**({"file": str(file)} if several else {}), **found, "pictures": list(map(str, written))})
        if not as_json:
            if several:
                say(f"{file}:")
            click.echo(textwrap.indent(_described(found), "  " if several else ""))
            for path in written:
                say(path)
    if as_json:
        print_json(reports if several else reports[0])
    return _DONE


def _folders_of_pictures(files: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """A folder inside of ``folder`` for each file, placed as the files are, whatever links and dots name them."""
    whole = {file: Path(os.path.realpath(file.parent), file.name) for file in files}
    common = Path(os.path.commonpath([path.parent for path in whole.values()]))
    # without what it ends in, where that leaves a name, and one of its own
    short = {path: path.with_name(path.stem) if path.stem.strip(".") else path for path in set(whole.values())}
    taken = Counter(short.values())
    return {
        file: folder / (short[path] if taken[short[path]] == 1 else path).relative_to(common)
        for file, path in whole.items()
    }


def _described(found: dict[str, Any]) -> str:
    import yaml

    provenance = found.get("provenance")
    if isinstance(provenance, dict) and isinstance(provenance.get("from"), dict):
        digests = dict(provenance.get("inputs") or {})
        inputs = {
            name: f"{label}, sha256 {str(digests.get(name))[:12]}" for name, label in provenance["from"].items()
        }
        rest = {name: value for name, value in provenance.items() if name != "from"}
        found = {**found, "provenance": {**rest, "inputs": {**digests, **inputs}}}
    return yaml.safe_dump(found, sort_keys=False, allow_unicode=True, width=100, default_flow_style=None).rstrip()


@texloom.command(short_help="Make textures in the browser, on this machine alone.")
@click.argument("folder", default=".", type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the address.  [default: a free one]")
@click.option("--no-browser", is_flag=True, help="Print the address and open no browser.")
@_memory_option
@store_option
def studio(folder: Path, port: int, no_browser: bool, store_folder: Path) -> int:
    """Serve a page to make textures of the pictures of FOLDER, by default the working folder.

    \b
    texloom studio
    texloom studio library --no-browser --port 8000

    The address that is printed holds a token, without which nothing is answered; nothing leaves this machine.
    Whatever is made there can be shown as a flow file or as a command. Ctrl-C ends the studio.
    """
    from texloom.pipelines.studio.launch import launch

    launch(folder, store_folder, port, browser=not no_browser)
    return _DONE


@texloom.command(short_help="Print what texloom runs on: versions, processors, caches, GPU, server.")
@click.option("--warm", is_flag=True, help="Compile the kernels of the common flows now, which takes minutes.")
@store_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor(warm: bool, store_folder: Path, as_json: bool) -> int:
    """Print what texloom runs on: versions, processors, kernel cache, store, free space, GPU and Prefect server.

    Kernels are compiled when they are first needed, and kept; --warm compiles them ahead, as for an image of a
    container.
    """
    from texloom.pipelines.cli import doctor as examination

    if warm:
        examination.warm(text_stream(as_json))
    found = examination.examine(store_folder)
    if as_json:
        return print_json(found)
    click.echo(examination.described(found))
    return _DONE


@texloom.command(short_help="Print the completion script of a shell.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> int:
    """Print what SHELL reads to complete commands, flows, steps and params.

    \b
    bash   echo 'eval "$(texloom completion bash)"' >> ~/.bashrc
    zsh    echo 'eval "$(texloom completion zsh)"' >> ~/.zshrc
    fish   texloom completion fish > ~/.config/fish/completions/texloom.fish
    """
    from texloom.pipelines.cli.completion import script

    click.echo(script(shell))
    return _DONE


def _open(
    flow: str | None,
    pictures: tuple[str, ...],
    sources: dict[str, str],
    params: dict[str, str],
    exports: dict[str, str],
    size: str | None,
    tileable: bool,
    preset: str | None,
    seed: int | None,
    seeds: int | range | None,
    store_folder: Path,
    runner: dict[str, Any] | None = None,
    item: str | None = None,
    **delivery: str | None,
) -> Run:
    """The flow with what the command line changes, checked whole; with a contact sheet over several seeds."""
    from texloom.pipelines.api import open_run
    from texloom.pipelines.flow.model import Overrides
    from texloom.pipelines.store.store import Store

    if flow is None:
        raise _WhichFlowError
    if seed is not None and isinstance(seeds, range):
        raise click.UsageError("--seed and a range of --seeds say the same; give one of them")
    changed = _with_common(params, size, tileable, preset)
    written = {name: text for name, text in delivery.items() if text is not None}
    overrides = Overrides(sources, changed, seed, seeds, runner or {}, pictures, exports, written, item)
    with _named_as_given(params):
        return open_run(flow, overrides, Store(store_folder))


def _what(opened: Run) -> dict[str, Any]:
    """How a report begins."""
    return {
        "flow": opened.flow.name,
        "file": str(opened.flow.path),
        "seed": opened.flow.seeds[0],
        "store": str(opened.store.root),
    }


def _step(entry: StepReport | StepPlan) -> dict[str, Any]:
    """A step's line of a report; ``item`` only over a set."""
    return {name: value for name, value in dataclasses.asdict(entry).items() if name != "item" or value is not None}
