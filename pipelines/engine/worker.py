"""What a worker does with an order: in a thread, in a process of its own, or on another machine."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import secrets
import socket
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

from texloom.pipelines.engine.keys import KeyParts
from texloom.pipelines.engine.task import Order, check_same, compute, provenance_of
from texloom.pipelines.errors import is_of_the_machine, one_line, told
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.store import Artifact, BrokenArtifactError, Store
from texloom.stages.declare import InputError, find_stage
from texloom.stages.kernels.core.threads import sharing, thread_count
from texloom.stages.progress import Listener, listening

PROBE = "probe"
"""the name of a lock that a run holds while it asks workers whether it keeps them out"""

State = Literal["ran", "cached", "failed", "refused", "unreadable", "broken", "lost"]

Ensure = Callable[[str, KeyParts, Callable[[], Artifact]], Artifact]
"""``ensure(label, parts, work)``: the artifact of a key, from the store or from ``work``"""


@dataclasses.dataclass(frozen=True)
class Task:
    """What travels to a worker: text and numbers."""

    order: str
    """see `Order.to_json`"""
    store: str
    identity: str
    """of the store, see `texloom.pipelines.store.store.Store.identity`"""
    threads: int | Mapping[str, int]
    """for this step alone; or, for each machine, how many steps share what it has"""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of an order: text and numbers, as it travels back."""

    state: State
    """``refused``: by the stage, for its inputs; ``unreadable``, ``broken``: a source or result that it takes;
    ``lost``: with its worker"""
    seconds: float = 0.0
    record: Mapping[str, Any] | None = None
    """see `texloom.pipelines.store.store.Artifact.record`"""
    problem: str = ""
    broken: str = ""
    """the key of the result that is broken"""
    details: str = ""
    """the traceback"""
    notes: tuple[str, ...] = ()


def carry_out(task: Task, ensure: Callable[[Store], Ensure], heard: Listener | None = None) -> Outcome:
    """Compute an order and file its result, unless the store has it by now.

    Parameters
    ----------
    ensure : makes of a store what keeps its records.
    heard : hears how far the stage is.
    """
    notes: list[str] = []
    began, ran = time.perf_counter(), False

    def work() -> Artifact:
        nonlocal ran
        ran = True
        with listening(heard or (lambda _: None)):
            result = compute(order, stage, store, notes.append)
        return store.save(stage, order.parts.key, result, provenance_of(order), time.perf_counter() - began)

    def refused(error: InputError) -> Outcome:
        where = "" if isinstance(task.threads, int) else f" (on {socket.gethostname()})"
        state: State = "unreadable" if isinstance(error, SourceError) else "refused"
        return outcome(state, problem=f"{error}{where}")

    def outcome(state: State, **more: Any) -> Outcome:
        return Outcome(state, time.perf_counter() - began, notes=tuple(notes), **more)

    try:
        order, store = Order.from_json(task.order), Store(Path(task.store))
        stage = find_stage(order.parts.stage)
        check_store(store, task.identity)
        check_same(order)
        threads = _threads(task.threads)
        with sharing(threads):
            artifact = ensure(store)(order.label, order.parts, work)
        return outcome("ran" if ran else "cached", record=artifact.record)
    except BrokenArtifactError as error:
        return outcome("broken", problem=str(error), broken=error.key)
    except InputError as error:
        return refused(error)
    except Exception as error:
        details = "" if is_of_the_machine(error) else traceback.format_exc()
        return outcome("failed", problem=one_line(told(error)), details=details)


def check_store(store: Store, identity: str) -> None:
    """`InputError` unless the folder at the store's path is the one that the run means."""
    try:
        seen = (store.root / "identity").read_text()
    except OSError:
        seen = None
    if seen != identity:
        what = "is not there" if seen is None else "is another folder there"
        raise InputError(f"the store {store.root} {what}; all workers must see the same one")


def _threads(given: int | Mapping[str, int]) -> int:
    if isinstance(given, int):
        return given
    return max(1, thread_count() // given.get(socket.gethostname(), 1))


@dataclasses.dataclass(frozen=True)
class Place:
    """A worker's answer to a run that wants to use it."""

    host: str
    problem: str = ""


def look_around(folder: str, identity: str, version: str) -> Place:
    """Whether a worker can work for a run that holds the lock `PROBE` of the store."""
    import filelock

    host, store = socket.gethostname(), Store(Path(folder))
    try:
        ours = program_version()
        if ours != version:
            return Place(host, f"it has {ours}, this is {version}")
        check_store(store, identity)
        probe = store.root / f".probe-{secrets.token_hex(4)}"
        probe.touch()
        probe.unlink()
        lock = store.lock(PROBE, timeout=0)
        lock.acquire()
        lock.release()
    except filelock.Timeout:
        return Place(host)
    except (InputError, OSError) as error:
        return Place(host, str(error))
    return Place(host, f"it can take a lock in {folder} that is held here: the file system must support flock")


def program_version() -> str:
    """What results are said to be made by."""
    return f"texloom {importlib.metadata.version('texloom')}"
