"""Runs whose surroundings fail: the store's disk, memory, clock, Prefect server, another texloom. Nothing is lost.

``python -m tests.faults`` tries each fault with each runner, and prints every problem; ``--fault`` and ``--runner``
choose some. After each fault a run without it has to end with the files that are expected, and no finished step may
be computed again.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.conftest import ROOT
from tests.kills import RUNNERS, _finished, _last, _raised
from tests.pipelines.engine.prefect.server import Server
from tests.pipelines.flows import SET, environment, files, paint, write_set

_SECONDS = 240  # that a run may take
_DAY = 86400


class Place:
    """A folder with a set of pictures, a store, and the faults that hold."""

    def __init__(self, folder: Path, runner: str):
        self.folder, self.runner = folder, runner
        self.flow = write_set(_made(folder / "set"), SET)
        self.store, self.faults = folder / "store", _made(folder / "faults")
        self.server: dict[str, str] = {}
        """variables by which runs find a Prefect server"""
        self.problems: list[str] = []

    def start(
        self, out: str = "out", store: Path | None = None, code: Path | None = None, limit: int = 0
    ) -> subprocess.Popen[str]:
        """A run under the faults; ``code``: of another texloom; ``limit``: bytes of its address space."""
        variables = environment(self.folder)
        store = store or self.store
        path = [str(ROOT / "tests" / "faulty"), variables["PYTHONPATH"]] if code is None else [str(code)]
        faults = {"FAULTY": str(self.faults), "FAULTY_STORE": str(store)} if code is None else {}
        options = ["--workers", "2"] if self.runner != "local" else []
        command = [
            sys.executable, "-m", "texloom", "run", str(self.flow), "--store", str(store), "--out",
            str(self.folder / out), "--runner", self.runner, *options,
        ]  # fmt: skip
        if limit:
            command = ["sh", "-c", 'ulimit -v "$0"; exec "$@"', str(limit // 1024), *command]
        return subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder,
            env={**variables, **faults, **self.server, "PYTHONPATH": os.pathsep.join(path)}, start_new_session=True,
        )  # fmt: skip

    def set_fault(self, name: str, value: float | None) -> None:
        """Let a fault begin, or end."""
        path = self.faults / name
        if value is None:
            path.unlink(missing_ok=True)
        else:
            (self.folder / "fault").write_text(str(value))
            (self.folder / "fault").rename(path)

    def wait_for_results(self, process: subprocess.Popen[str], count: int, store: Path | None = None) -> None:
        """Wait until a run has stored so many results, or has ended."""
        while process.poll() is None and len(_finished_in(store or self.store)) < count:
            time.sleep(0.02)

    def end(self, process: subprocess.Popen[str], codes: tuple[int, ...] = (0,)) -> str:
        """Wait for the end of a run, which has to be one of these; what it has printed as errors."""
        try:
            _, errors = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            self.problems.append("the run did not end")
            return ""
        if process.returncode not in codes:
            self.problems.append(f"exit code {process.returncode}: {_last(errors)}")
        if "Traceback" in errors:
            self.problems.append(f"a traceback: {_raised(errors)}")
        return errors

    def interrupt(self, process: subprocess.Popen[str]) -> None:
        """Interrupt a run that waits for its store."""
        time.sleep(5)
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        if "; waiting for it" not in self.end(process, (130,)):
            self.problems.append("the run did not wait")

    def check(self, store: Path | None = None, code: Path | None = None) -> None:
        """Run again without faults: the same files, what was finished is cached, and nothing is left."""
        for fault in list(self.faults.iterdir()):
            fault.unlink()
        store = store or self.store
        finished = _finished_in(store)
        self.end(self.start("again", store, code))
        expected = files(self.folder.parent / "expected")
        made = files(self.folder / "again")
        if code is None and made != expected:
            names = sorted(name for name in {*made, *expected} if made.get(name) != expected.get(name))
            self.problems.append(f"other files: {', '.join(names)}")
        after = _finished_in(store)
        if {name: after.get(name) for name in finished} != finished:
            self.problems.append("a finished step was computed again, or is lost")
        if left := [path.name[:5] for path in store.rglob(".new-*")]:
            self.problems.append(f"left in the store: {left[0]}")


def _made(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _finished_in(store: Path) -> dict[str, int]:
    return _finished(store.parent) if store.name == "store" else _finished(_as_store(store))


def _as_store(store: Path) -> Path:
    """A folder in which this one is called ``store``."""
    place = store.with_name(f"{store.name}-place")
    place.mkdir(exist_ok=True)
    if not (place / "store").is_symlink():
        (place / "store").symlink_to(store)
    return place


# -- faults


def slow(place: Place) -> None:
    """Each call on the store takes 5 ms more, as on a mount far away."""
    place.set_fault("slow", 0.005)
    place.end(place.start())
    place.check()


def comes_back(place: Place) -> None:
    """The mount is stale for 3 seconds in the middle of the set."""
    process = place.start()
    place.wait_for_results(process, 3)
    place.set_fault("gone", errno.ESTALE)
    time.sleep(3)
    place.set_fault("gone", None)
    if "; waiting for it" not in place.end(process):
        place.problems.append("the run did not wait")
    place.check()


def vanishes(place: Place) -> None:
    """All calls fail from the middle of the set on, until somebody interrupts the run."""
    process = place.start()
    place.wait_for_results(process, 3)
    place.set_fault("gone", errno.EIO)
    place.interrupt(process)
    place.check()


def moved(place: Place) -> None:
    """The store is renamed while a run works, and used under the other name."""
    process = place.start()
    place.wait_for_results(process, 3)
    other = place.folder / "moved"
    place.store.rename(other)
    place.interrupt(process)
    if any((place.store / name).exists() for name in ("cache", "records", "identity")):  # `filelock` makes folders
        place.problems.append("something was written where the store was")
    place.check(other)


def copied(place: Place) -> None:
    """The store is copied while a run works, without times, and the copy is used."""
    process = place.start()
    place.wait_for_results(process, 4)
    other = place.folder / "copied"
    subprocess.run(["cp", "-r", place.store, other], check=False, capture_output=True)  # temporary files may vanish
    place.end(process)
    place.check(other)
    place.check()


def _versions(place: Place) -> Path:
    """The code of another texloom, in which edges are found otherwise."""
    code = place.folder / "code" / "texloom"
    code.mkdir(parents=True)
    for name in ("stages", "pipelines", "configs"):
        ignored = shutil.ignore_patterns("client", "page", "__pycache__")
        shutil.copytree(ROOT / name, code / name, ignore=ignored)
    for path in (ROOT / ".import" / "texloom").glob("*.py"):
        shutil.copy(path, code)
    edited = code / "stages" / "analysis" / "structure" / "edges.py"
    edited.write_text(edited.read_text() + "\n\n_OF_ANOTHER_VERSION = 1\n")
    return code.parent


def versions(place: Place) -> None:
    """Another texloom works on the same store at the same time, and prunes it afterwards."""
    code = _versions(place)
    ours, theirs = place.start(), place.start("theirs", code=code)
    place.end(ours)
    place.end(theirs)
    place.check()
    place.check(code=code)
    variables = {**environment(place.folder), "PYTHONPATH": str(code)}
    for command in (["verify"], ["prune", "--days", "30"], ["ls"]):
        words = [sys.executable, "-m", "texloom", "store", *command, "--store", str(place.store)]
        done = subprocess.run(words, env=variables, cwd=place.folder, capture_output=True, text=True, check=False)
        if done.returncode or "Traceback" in done.stderr:
            place.problems.append(f"store {command[0]} of the other: {_last(done.stderr or done.stdout)}")
    place.check()


def clock(place: Place) -> None:
    """The clock jumps ten years ahead, a day back, and to its place; a run by a wrong clock prunes meanwhile."""
    process = place.start()
    for count, wrong in ((2, 3650 * _DAY), (4, -_DAY), (6, None)):
        place.wait_for_results(process, count)
        place.set_fault("clock", wrong)
        words = [sys.executable, "-m", "texloom", "store", "prune", "--days", "1", "--store", str(place.store)]
        variables = environment(place.folder)
        path = os.pathsep.join([str(ROOT / "tests" / "faulty"), variables["PYTHONPATH"]])
        done = subprocess.run(
            words, env={**variables, "PYTHONPATH": path, "FAULTY": str(place.faults)}, cwd=place.folder,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode or "Traceback" in done.stderr:
            place.problems.append(f"prune: {_last(done.stderr)}")
    place.end(process)
    place.check()


def memory(place: Place) -> None:
    """One picture is too large for the address space that the shell allows: its item fails, the others do not."""
    paint(place.folder / "set" / "pictures" / "large.png", side=4500, seed=9)
    errors = place.end(place.start(limit=1_600_000_000), (1,))
    if "1 of 8" not in errors and "2 of 8" not in errors:
        place.problems.append(f"not the large item alone failed: {_last(errors)}")
    (place.folder / "set" / "pictures" / "large.png").unlink()
    place.check()


@contextlib.contextmanager
def _serving(place: Place) -> Iterator[Server]:
    """A Prefect server that runs tell what they do, which has to know in the end that the run has completed."""
    server = Server(_made(place.folder / "server"))
    place.set_fault("slow", 0.03)  # so that the set takes longer than the server is away
    try:
        place.server = {name: value for name, value in server.environment.items() if name.startswith("PREFECT_")}
        yield server
        runs = server.post("flow_runs/filter", {})
        if [run["state"]["name"] for run in runs] != ["Completed"]:
            place.problems.append(f"the server knows of {[run['state']['name'] for run in runs]}")
        steps = server.post("task_runs/filter", {"limit": 200})
        if states := {step["state"]["name"] for step in steps} - {"Completed", "Cached"}:
            place.problems.append(f"the server knows of steps that are {', '.join(sorted(states))}")
        place.server = {}
    finally:
        server.stop()


def server(place: Place) -> None:
    """The Prefect server is killed in the middle of the set, and started again after 5 seconds."""
    with _serving(place) as serving:
        process = place.start()
        place.wait_for_results(process, 3)
        serving.started[-1].kill()
        time.sleep(5)
        serving.serve()
        place.end(process)
    place.check()


def database(place: Place) -> None:
    """The database of the Prefect server is locked for 20 seconds in the middle of the set."""
    with _serving(place) as serving:
        process = place.start()
        place.wait_for_results(process, 3)
        with contextlib.closing(sqlite3.connect(serving.folder / "home" / "prefect.db", timeout=30)) as locking:
            locking.execute("BEGIN EXCLUSIVE")
            time.sleep(20)
            locking.rollback()
        place.end(process)
    place.check()


FAULTS: dict[str, Callable[[Place], None]] = {
    one.__name__: one
    for one in (slow, comes_back, vanishes, moved, copied, versions, clock, memory, server, database)
}


def tried(folder: Path, fault: str, runner: str) -> list[str]:
    """What goes wrong under a fault."""
    if not (folder / "expected").exists():
        whole = Place(_made(folder / "whole"), "local")
        whole.end(whole.start())
        assert not whole.problems, whole.problems
        (whole.folder / "out").rename(folder / "expected")
    place = Place(_made(folder / "place"), runner)
    FAULTS[fault](place)
    return place.problems


def main() -> int:
    """Try the faults, and print what went wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--fault", choices=FAULTS, action="append")
    parser.add_argument("--runner", choices=RUNNERS, action="append")
    given = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        for fault in given.fault or FAULTS:
            for runner in given.runner or RUNNERS:
                began = time.monotonic()
                problems = tried(Path(folder), fault, runner)
                told = "; ".join(problems) or "nothing lost"
                print(f"{fault}, {runner}, {time.monotonic() - began:.0f} s: {told}", flush=True)
                count += len(problems)
    return int(bool(count))


if __name__ == "__main__":
    sys.exit(main())
