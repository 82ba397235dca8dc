"""``texloom store``: what the store holds, whether it is sound, and how large it may be."""

from __future__ import annotations

import dataclasses
import os
import re
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from texloom.pipelines.byte_size import format_byte_size, parse_byte_size
from texloom.pipelines.cli.options import json_option, request_option, store_option
from texloom.pipelines.cli.output import complain, print_json, say

if TYPE_CHECKING:
    from texloom.pipelines.store.housekeeping import StoreEntry
    from texloom.pipelines.store.run_log import LoggedRun
    from texloom.pipelines.store.store import Store

_NAME = re.compile(r"[^/\\]+$")
_ARRAY = re.compile(r".*/[0-9a-f]{64}(\.png|\.exr|/maps\.yaml)?")  # as `file_source` names them


def _store_options(command: Callable[..., Any]) -> Callable[..., Any]:
    return store_option(json_option(command))


@click.group()
def store() -> None:
    """List, check and prune the stored results."""


# -- listing


@store.command("ls", short_help="List the results by run, with their sizes and last use.")
@_store_options
def list_store(store_folder: Path, as_json: bool) -> int:
    """List the results in the store by the run that used them last, with their sizes and when that was."""
    from texloom.pipelines.store import housekeeping

    opened = _existing(store_folder)
    results, others = housekeeping.entries(opened), housekeeping.other_entries(opened)
    users = _users_of(opened)
    if as_json:
        return print_json([_described(entry, *users.get(entry.key, (None, None))) for entry in (*results, *others)])
    _print_entries(results, others, users)
    size = format_byte_size(sum(entry.size for entry in (*results, *others)))
    most = housekeeping.limit(opened)
    limit = "" if most is None else f"; limit {format_byte_size(most)}"
    say(f"{opened.root}: {size} in {_count(len(results), 'result')}{limit}")
    _warn_of_limit(opened)
    return 0


_Users = dict[str | None, tuple["LoggedRun", str]]


def _users_of(opened: Store) -> _Users:
    """For each key the last run that used it, and for which step."""
    from texloom.pipelines.store import run_log

    users: _Users = {}
    for run in run_log.read(opened.root):
        for step, key in run.steps.items():
            users.setdefault(key, (run, step))
    return users


def _print_entries(results: Sequence[StoreEntry], others: Sequence[StoreEntry], users: _Users) -> None:
    arrays = [entry for entry in others if _ARRAY.fullmatch(entry.folder.as_posix())]
    named = [(_other(entry), [entry]) for entry in others if entry not in arrays]
    if arrays:  # whose names are digests
        named.append((_count(len(arrays), "array"), arrays))
    _print_table([
        ("FLOW", "PICTURE", "STEP", "SIZE", "LAST USED"), *_rows(results, users),
        *(("", "", what, *_size_and_age(listed)) for what, listed in named),
    ])  # fmt: skip


def _size_and_age(listed: Sequence[StoreEntry]) -> tuple[str, str]:
    return format_byte_size(sum(entry.size for entry in listed)), _age(max(entry.used for entry in listed))


def _rows(results: Sequence[StoreEntry], users: _Users) -> Iterable[tuple[str, ...]]:
    """A row for each step of each run, the last run first; over a set, one for all items of a step."""
    groups: dict[int, dict[str, list[StoreEntry]]] = defaultdict(lambda: defaultdict(list))
    runs: dict[int, LoggedRun | None] = {}
    for entry in results:
        run, step = users.get(entry.key, (None, str(entry.stage)))
        runs[id(run)] = run
        groups[id(run)][step.rpartition("/")[2]].append(entry)
    for number, run in sorted(runs.items(), key=lambda one: 0.0 if one[1] is None else -one[1].used):
        names = ("", "") if run is None else (run.flow, _pictures(run))
        order = [] if run is None else [step.rpartition("/")[2] for step in run.steps]
        for step in sorted(groups[number], key=lambda step: order.index(step) if step in order else 0):
            listed = groups[number][step]
            what = step if len(listed) == 1 else f"{step} ({_count(len(listed), 'result')})"
            yield (*names, what, *_size_and_age(listed))
            names = ("", "")


def _pictures(run: LoggedRun) -> str:
    return ", ".join(
        "array" if _ARRAY.fullmatch(source) else found[0] if (found := _NAME.search(source)) else source
        for source in run.sources.values()
    )


def _other(entry: StoreEntry) -> str:
    return f"{entry.folder.parent.name}/{entry.folder.name}"


def _described(entry: StoreEntry, run: LoggedRun | None, step: str | None) -> dict[str, Any]:
    """An entry for JSON, with the last run that used it."""
    item, _, name = (step or "").rpartition("/")
    return {
        **_entry(entry),
        "flow": None if run is None else run.flow,
        "sources": None if run is None else dict(run.sources),
        "seeds": None if run is None else list(run.seeds),
        "item": item or None,
        "step": name or None,
    }


# -- sharing


@store.command(short_help="Upload results to a shared store.")
@_store_options
@request_option("remote")
def push(store_folder: Path, as_json: bool, remote: str | None) -> int:
    """Upload the results that a shared store lacks, as those from before it was named.

    Each is compared with its digests before; what the shared store has stays as it is. Exit code 1 if a result is
    broken or the storage does not answer.
    """
    from texloom.pipelines.errors import refused
    from texloom.pipelines.store import exchange
    from texloom.pipelines.store.location import shared_store

    opened = _existing(store_folder)
    opened.remote = shared_store(remote)
    if not opened.remote:
        raise refused("--remote: required; or set TEXLOOM_REMOTE")
    pushed = exchange.push(opened)
    if as_json:
        print_json({"remote": opened.remote, **dataclasses.asdict(pushed)})
    else:
        left_out = f", {pushed.left_out} without files" if pushed.left_out else ""
        counts = f"{pushed.uploaded} uploaded, {pushed.present} there before, {pushed.broken} broken{left_out}"
        say(f"{opened.remote}: {counts}")
    if pushed.outage:
        complain(f"texloom: {pushed.outage}; push again to go on")
    return 1 if pushed.broken or pushed.outage else 0


# -- verifying and removing


@store.command(short_help="Compare every byte with the digests.")
@_store_options
def verify(store_folder: Path, as_json: bool) -> int:
    """Compare every byte with the digests; exit code 1 if a result is broken. `run` computes those again.

    Results that a run is computing are passed over. Of those whose files were left out, by `run --keep final`, only
    the manifest can be compared; they are counted.
    """
    from texloom.pipelines.store import housekeeping

    results = list(housekeeping.verify(_existing(store_folder)))
    broken = [(entry, problem) for entry, problem in results if problem is not None]
    if as_json:
        print_json(
            [{**_entry(entry), "problem": problem, "left_out": entry.left_out} for entry, problem in results]
        )
    else:
        for entry, problem in broken:
            say(f"{entry.folder}: {problem}")
        without = sum(entry.left_out > 0 for entry, _ in results)
        told = f", {without} without files" if without else ""
        say(f"{_count(len(results), 'result')}, {len(broken)} broken{told}")
    return 1 if broken else 0


@store.command(short_help="Remove what no run has used for some days.")
@_store_options
@click.option("--days", type=click.FloatRange(min=0), default=30.0, show_default=True, help="How long unused.")
@click.option("--dry-run", is_flag=True, help="Only say what would go.")
def prune(store_folder: Path, as_json: bool, days: float, dry_run: bool) -> int:
    """Remove results, exports below STORE/runs and arrays that no run has used for some days.

    Also removes what killed runs have left. What is in use by a run that is going on is kept, and so are files that
    texloom did not write, or that were changed since.
    """
    from texloom.pipelines.store import housekeeping

    opened = _existing(store_folder)
    if not dry_run:
        opened.check_writable()
    users = _users_of(opened)
    removed = housekeeping.prune(opened, days, dry_run)
    told = "would go" if dry_run else "removed"
    told += "" if removed else f"; nothing has been unused for {days:g} days"
    return _print_removed(removed, users, told, as_json)


@store.command(short_help="Keep the store within a size, from now on.")
@_store_options
@click.argument("size", required=False)
@click.option("--dry-run", is_flag=True, help="Only say what would go; the limit stays as it is.")
def limit(store_folder: Path, as_json: bool, size: str | None, dry_run: bool) -> int:
    """Keep the store within SIZE, as 20GB, 500MB or 20GiB: GB is 10^9 bytes, GiB 2^30.

    `none` removes the limit, and without SIZE it is printed.

    The least recently used results, exports below STORE/runs and arrays are removed now and at the end of every
    run. What runs that are going on use is kept, even if it is more.
    """
    from texloom.pipelines.errors import refused
    from texloom.pipelines.store import housekeeping
    from texloom.pipelines.store.store import Store

    if size is None:
        found = _existing(store_folder)
        most = housekeeping.limit(found)
        _warn_of_limit(found)
        if as_json:
            return print_json({"limit": most})
        say("no limit" if most is None else format_byte_size(most))
        return 0
    most = None if size.lower() == "none" else _parsed(size)
    if dry_run:
        found = _existing(store_folder)
        return _print_removed(housekeeping.over(found, most), _users_of(found), "would go", as_json)
    opened = Store(store_folder)
    opened.create()
    problem = housekeeping.removes_nothing(opened)
    if problem is not None:
        raise refused(f"--store {store_folder}: {problem}")
    housekeeping.set_limit(opened, most)
    users = _users_of(opened)
    done = f"removed; {opened.root} has {'no limit' if most is None else f'a limit of {format_byte_size(most)}'}"
    return _print_removed(housekeeping.keep_limit(opened), users, done, as_json)


def _warn_of_limit(opened: Store) -> None:
    from texloom.pipelines.store import housekeeping

    problem = housekeeping.foreign_limit(opened)
    if problem is not None:
        complain(problem)


@store.command(short_help="Take over a store that another user or machine made.")
@click.option("--store", "folder", envvar="TEXLOOM_STORE", type=click.Path(path_type=Path), help="Its folder.")
@json_option
def adopt(folder: Path | None, as_json: bool) -> int:
    """Take over the store in a folder, by default `artifacts`, that another user or machine made, or was copied.

    From then on it is used as if you had made it: results in it are believed, and `prune` and a limit that you set
    remove from it. Do so only with a folder whose origin you know.
    """
    from texloom.pipelines.errors import refused
    from texloom.pipelines.store import housekeeping, ownership
    from texloom.pipelines.store.location import PROJECT_STORE
    from texloom.pipelines.store.store import Store

    opened = Store(folder or Path(PROJECT_STORE))
    if not ownership.has_form(opened.root):
        raise refused(f"--store {opened.root}: no store there")
    problem = ownership.keeps_no_key()
    if problem is not None:
        raise refused(f"--store {opened.root}: {problem}")
    is_new = ownership.marked(opened.root) is None
    results, others = housekeeping.entries(opened), housekeeping.other_entries(opened)
    size = sum(entry.size for entry in (*results, *others))
    if is_new:
        opened.adopt()
    if as_json:
        found = {"store": str(opened.root), "results": len(results), "others": len(others), "size": size}
        return print_json({**found, "adopted": is_new})
    what = f"{_count(len(results), 'result')} and {_count(len(others), 'other folder')}, {format_byte_size(size)}"
    say(f"{opened.root}: {what}, {'taken over' if is_new else 'yours already'}")
    _warn_of_limit(opened)
    return 0


def _parsed(size: str) -> int:
    try:
        most = parse_byte_size(size)
    except ValueError as error:
        raise click.BadParameter(f"{error}; none removes the limit", param_hint="SIZE") from None
    if size.strip()[-1].isdigit():  # somebody may mean 20 GB, and 20 bytes would empty the store at once
        raise click.BadParameter(f"{size} has no unit; give {size}GB, or {size}B for bytes", param_hint="SIZE")
    return most


def _print_removed(removed: Sequence[StoreEntry], users: _Users, verb: str, as_json: bool) -> int:
    """List by run what goes; ``users`` as they were before."""
    if as_json:
        return print_json([_entry(entry) for entry in removed])
    results = [entry for entry in removed if entry.stage is not None]
    others = [entry for entry in removed if entry.stage is None]
    if removed:
        _print_entries(results, others, users)
    what = _count(len(results), "result") + (f" and {_count(len(others), 'other folder')}" if others else "")
    say(f"{what}, {format_byte_size(sum(entry.size for entry in removed))} {verb}")
    return 0


def _existing(folder: Path) -> Store:
    from texloom.pipelines.store.location import passed_over
    from texloom.pipelines.store.store import Store
    from texloom.stages.vocabulary.declare import InputError

    found = Store(folder)
    if not (found.root / "cache").is_dir():
        raise InputError(f"--store {folder}: no store there")
    found.check_owned()
    note = passed_over(found.root)
    if note is not None:
        complain(note)
    return found


# -- words


def _entry(entry: StoreEntry) -> dict[str, Any]:
    return {
        "stage": entry.stage, "key": entry.key, "folder": entry.place.replace("/", os.sep), "size": entry.size,
        "used": entry.used,
    }  # fmt: skip


def _print_table(rows: Sequence[tuple[str, ...]]) -> None:
    """Columns as wide as they need to be; the one of sizes to the right."""
    from texloom.pipelines.errors import one_line

    shown = [tuple(map(one_line, row)) for row in rows]
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    for flow, picture, step, size, used in shown:
        say(f"{flow:{widths[0]}}  {picture:{widths[1]}}  {step:{widths[2]}}  {size:>{widths[3]}}  {used}".rstrip())


def _age(used: float) -> str:
    """How long ago, in the largest unit that fits."""
    seconds = max(0.0, time.time() - used)
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{seconds // length:.0f} {unit} ago"
    return "just now"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
