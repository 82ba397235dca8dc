"""The commands ``run``, ``plan`` and ``commands``: what a flow does, would do, and does item by item."""

from __future__ import annotations

import dataclasses
import gc
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from texloom.pipelines.cli.exits import Exit, ended_by
from texloom.pipelines.cli.options import FlowCommand, named_as_given, request_options
from texloom.pipelines.cli.output import complain, print_json, say, text_stream
from texloom.pipelines.request_fields import RUNNER

if TYPE_CHECKING:
    from texloom.pipelines.engine.events import StepReport
    from texloom.pipelines.engine.run import Run, StepPlan


_FEW = 8
"""items whose steps a plan lists each by itself"""


class WhichFlowError(Exception):
    """No flow is named."""


@click.command(cls=FlowCommand, short_help="Run a flow and write its exports.")
@request_options()
def run(flow: str | None, as_json: bool, out: Path | None, force: bool, **options: Any) -> int:
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
    opened, folder = _open(flow, out=out, force=force, **options)
    return execute(opened, folder, as_json, began, force)


@click.command(cls=FlowCommand, short_help="Show what `run` would compute, and why.")
@request_options()
def plan(flow: str | None, as_json: bool, out: Path | None, force: bool, **options: Any) -> int:
    """Show what `run` would do with the same options: which steps are cached, which would run, and why.

    \b
    texloom plan self_tuning mine.png --preset fast
    texloom plan self_tuning mine.png --set texture.occurrence=20 --set texture.patch_size=12

    Runs nothing and writes nothing. Of a set with more than a few items each line is a step of all of them. The
    last line is a summary: items, steps, time, memory and disk, as the last results of the same steps took or
    estimated. Exit code 2 if something would be refused, such as exports over files of others.
    """
    from texloom.pipelines.engine.plan_summary import summary
    from texloom.pipelines.engine.preflight import Preflight

    opened, folder = _open(flow, out=out, force=force, **options)
    Preflight(opened).check(folder, force)
    steps = opened.first_plan
    for note in opened.notes:
        complain(note)
    if opened.outage:
        complain(f"shared store: {opened.outage}; what it has may be missing here")
    whole = summary(opened, steps)
    if as_json:
        taken = whole.footprint
        needs = {} if taken is None else {"needs": {"memory": taken.memory, "disk": taken.disk}}
        listed = [_step(step) for step in [*steps, *opened.skipped()]]
        numbers = {name: value for name, value in dataclasses.asdict(whole).items() if name != "footprint"}
        print_json({**_what(opened), "steps": listed, "summary": numbers, **needs})
    else:
        _print_plan([*steps, *opened.skipped()], whole.items > _FEW)
        say(str(whole))
    return Exit.WRONG if whole.is_refused else Exit.DONE


def _print_plan(steps: list[StepPlan], is_short: bool) -> None:
    """A line a step; ``is_short``: one for those of all items, but for what is refused."""
    from texloom.pipelines.engine.events import label

    rows: list[tuple[str, str, str]] = []
    counted: dict[str, Counter[str]] = {}
    for step in steps:
        if is_short and step.item is not None and step.state != "refused":
            counted.setdefault(step.name, Counter())[step.state] += 1
        else:
            rows.append((label(step.name, step.item), step.state, "; ".join(step.reasons)))
    rows += [
        (name, ", ".join(f"{count} {state}" for state, count in states.items()), "")
        for name, states in counted.items()
    ]
    width, states = max(len(name) for name, _, _ in rows), max(6, *(len(state) for _, state, _ in rows))
    for name, state, reasons in rows:
        say(f"{name:{width}}  {state:{states}}  {reasons}".rstrip())


@click.command(cls=FlowCommand, short_help="Print one command line per item of a set, for a render farm.")
@request_options(*RUNNER, "item")
@click.option("--only", type=click.Choice(["items", "gather"]), help="Print the lines of one kind.")
def commands(
    flow: str | None, as_json: bool, out: Path | None, force: bool, only: str | None,
    **options: Any,
) -> int:  # fmt: skip
    """Print the command lines that together do what `run` would: one per item of a set, and one that gathers.

    \b
    texloom commands self_tuning 'library/*.png' --seeds 0-3 --store /net/store --out /net/out > lines.txt

    The lines of items may run at the same time, on machines that share the store; the last one, if there are steps
    that gather, comes after all of them. A line that is repeated computes nothing twice. All paths are absolute.
    """
    from texloom.pipelines.engine.preflight import Preflight
    from texloom.pipelines.flow.command_list import command_list

    opened, folder = _open(flow, out=out, force=force, **options)
    Preflight(opened).check(folder, force)
    target = folder / (opened.flow.picture or "")
    listed = command_list(opened.flow, opened.items, opened.store.root, target, force, opened.store.remote)
    if as_json:
        return print_json({**_what(opened), "items": listed.items, "gather": listed.gather})
    for line in listed.lines(only):
        click.echo(line)  # whole, however long
    return Exit.DONE


def _open(flow: str | None, store_folder: Path, **options: Any) -> tuple[Run, Path]:
    """The flow with what the command line changes, checked whole, and the folder of its exports."""
    from texloom.pipelines.engine.opening import open_request
    from texloom.pipelines.flow.finding import file_called
    from texloom.pipelines.request import request

    if not flow:
        raise WhichFlowError
    asked = request(flow=flow, store=store_folder, **options)
    with named_as_given(asked.params):
        opened, folder = open_request(asked)
    if (file := file_called(flow)) is not None:
        complain(f"{flow} is a flow that ships; `texloom run {file}` runs the file here")
    return opened, folder


def execute(opened: Run, folder: Path, as_json: bool, began: float, force: bool) -> int:
    """Run what has been opened and say how it went."""
    from texloom.pipelines.engine import scheduler
    from texloom.pipelines.engine.events import Recorder, summary_of
    from texloom.pipelines.engine.preflight import Preflight
    from texloom.pipelines.engine.run import StepFailedError
    from texloom.pipelines.engine.run_scores import choices_of, main_scores
    from texloom.pipelines.errors import NoWorkersError
    from texloom.pipelines.memory import keep_freed_memory
    from texloom.pipelines.store.codec import ArtifactError
    from texloom.pipelines.store.store import BrokenStoreError
    from texloom.pipelines.terminal import Terminal
    from texloom.stages.vocabulary.declare import InputError

    Preflight(opened).check(folder, force)
    terminal = Terminal(text_stream(as_json))
    recorder = Recorder(terminal)
    exports = recorder.exports  # those of a run that fails
    problem, code = None, Exit.DONE
    gc.freeze()  # what is there stays; looking through it again and again takes a tenth of the run of a large set
    keep_freed_memory()
    try:
        exports = scheduler.execute(opened, recorder, folder)
        if recorder.problems:
            problem, code = summary_of(recorder.problems, len(opened.items)), Exit.FAILED
    except InputError as error:
        problem, code = str(error), Exit.WRONG
    except StepFailedError as error:
        terminal.close()
        for line in error.details.splitlines():
            complain(line)
        problem, code = f"{opened.flow.where('steps', error.step)}: failed: {error.reason}", Exit.FAILED
    except ArtifactError as error:
        problem, code = f"--out: {error}", Exit.FAILED
    except (BrokenStoreError, NoWorkersError) as error:
        problem, code = str(error), Exit.FAILED
    except KeyboardInterrupt as error:
        ended, code = ended_by(error)
        problem = f"{ended}; what is finished is kept, and the next run goes on from there"
    finally:
        terminal.close()
    if problem is not None:
        complain(f"texloom: {problem}")
    if opened.items and exports:
        say(folder, as_json)
    for name, path in exports.items():
        if "/" not in name.removesuffix("/"):  # not an item's
            say(path, as_json)
    choices = choices_of(opened) if code == Exit.DONE else {}
    if code == Exit.DONE:
        target = folder / (opened.flow.picture or "") if exports else None
        terminal.summarise(main_scores(opened), target, choices)
    if as_json:
        print_json(
            {
                **_what(opened),
                "runner": opened.flow.runner.name,
                "steps": [*map(_step, recorder.reports.values()), *map(_step, opened.skipped())],
                **({"items": recorder.items(len(opened.items))} if opened.items else {}),
                "exports": {name: str(path) for name, path in exports.items()},
                **({"choices": choices} if choices else {}),
                **({"left_out": _left_out(opened)} if opened.flow.intermediate else {}),
                "warnings": recorder.warnings,
                **({"shared": {"remote": opened.store.remote, **recorder.shared}} if opened.store.remote else {}),
                "seconds": time.perf_counter() - began,
                "error": problem,
            }
        )
    return code


def _what(opened: Run) -> dict[str, Any]:
    """How a report begins."""
    return {
        "flow": opened.flow.name,
        "file": str(opened.flow.path),
        "seed": opened.flow.seeds[0],
        "store": str(opened.store.root),
        "notes": opened.notes,
    }


def _left_out(opened: Run) -> dict[str, int]:
    return {"results": len(opened.left_out), "bytes": sum(opened.left_out.values())}


def _step(entry: StepReport | StepPlan) -> dict[str, Any]:
    """A step's line of a report; ``item`` only over a set, ``fetched`` only of what is to be fetched."""
    values = dataclasses.asdict(entry)
    left_out = {"problem", "details", *(name for name in ("item", "fetched") if not values.get(name))}
    return {name: value for name, value in values.items() if name not in left_out}
