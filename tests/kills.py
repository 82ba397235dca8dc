"""Runs that are killed at random times: nothing finished is lost, and the next run ends with the same files.

``python -m tests.kills --runs 1000`` kills that many runs and prints every distinct failure.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.pipelines.flows import ANALYSIS, SET, environment, files, write_flow, write_set

RUNNERS = ("local", "threads", "processes", "dask")
SIGNALS = {
    "KILL of the group": -signal.SIGKILL,
    "KILL": signal.SIGKILL,
    "TERM": signal.SIGTERM,
    "INT": signal.SIGINT,
}
CODES = {signal.SIGTERM: 143, signal.SIGINT: 130}
_SECONDS = 180  # that a run may take


@dataclasses.dataclass(frozen=True)
class Kill:
    """How a run was ended."""

    flow: str
    runner: str
    signal: str
    share: float
    """of the time that a whole run takes"""

    def __str__(self) -> str:
        return f"{self.flow}, {self.runner}, {self.signal} at {100 * self.share:.0f} %"


class Victims:
    """Flows to kill, with the files and times of whole runs."""

    def __init__(self, folder: Path, runners: tuple[str, ...] = RUNNERS):
        self.folder = folder
        self.runners = runners
        self.paths = {"one": write_flow(folder / "one", ANALYSIS), "set": write_set(_made(folder / "set"), SET)}
        self.expected: dict[str, dict[str, bytes]] = {}
        self.seconds: dict[tuple[str, str], float] = {}
        self.counts: Counter[str] = Counter()

    def _start(self, flow: str, runner: str, place: Path) -> subprocess.Popen[str]:
        options = ["--store", place / "store", "--out", place / "out", "--runner", runner]
        options += ["--workers", "2"] if runner != "local" else []
        return subprocess.Popen(
            [sys.executable, "-m", "texloom", "run", str(self.paths[flow]), *map(str, options)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=place, env=environment(self.folder),
            start_new_session=True,
        )  # fmt: skip

    def _whole(self, flow: str, runner: str) -> float:
        """The seconds of a run that nobody ends; its files become those that are expected."""
        if (flow, runner) not in self.seconds:
            place = _made(self.folder / f"whole-{flow}-{runner}")
            began = time.monotonic()
            process = self._start(flow, runner, place)
            _, errors = process.communicate(timeout=_SECONDS)
            assert process.returncode == 0, errors
            self.seconds[flow, runner] = time.monotonic() - began
            self.expected.setdefault(flow, files(place / "out"))
        return self.seconds[flow, runner]

    def chosen(self, rng: random.Random) -> Kill:
        """A kill at random."""
        return Kill(rng.choice(list(self.paths)), rng.choice(self.runners), rng.choice(list(SIGNALS)), rng.random())

    def kill(self, kill: Kill) -> list[str]:
        """End a run so, run it again, and say what is wrong."""
        seconds = self._whole(kill.flow, kill.runner)
        place = _made(self.folder / "killed")
        process = self._start(kill.flow, kill.runner, place)
        time.sleep(kill.share * seconds)
        number = SIGNALS[kill.signal]
        over = process.poll() is not None
        if not over:
            (os.killpg if number < 0 else os.kill)(process.pid, abs(number))
        try:
            _, errors = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return ["the run did not end"]
        self.counts["too late" if over or process.returncode == 0 else "killed"] += 1
        problems = []
        if number in CODES and process.returncode not in (CODES[number], 0, -number):  # -: Python was starting
            problems.append(f"exit code {process.returncode}: {_last(errors)}")
        if "Traceback" in errors and process.returncode != -number:
            problems.append(f"a traceback: {_last(errors)}")
        finished = _finished(place)
        again = self._start(kill.flow, kill.runner, place)
        try:
            _, errors = again.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(again.pid, signal.SIGKILL)
            return [*problems, "the next run did not end"]
        if again.returncode != 0:
            problems.append(f"the next run ended with {again.returncode}: {_last(errors)}")
        made, expected = files(place / "out"), self.expected[kill.flow]
        differing = sorted(name for name in {*made, *expected} if made.get(name) != expected.get(name))
        if differing and again.returncode == 0:
            problems.append(f"other files: {', '.join(map(_without_digits, differing))}")
        if {name: stamp for name, stamp in _finished(place).items() if name in finished} != finished:
            problems.append("a finished step was computed again")
        if left := [path.name for path in (place / "store").rglob(".new-*")]:
            problems.append(f"left in the store: {_without_digits(left[0])}")
        return problems


def _made(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _finished(place: Path) -> dict[str, int]:
    """When the result of each record was written."""
    records = (path for path in (place / "store" / "records").glob("*") if not path.name.startswith("."))
    return {path.name: path.stat().st_mtime_ns for path in records}


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "nothing was printed"


def _without_digits(name: str) -> str:
    return "".join("#" if character in "0123456789abcdef" else character for character in name)


def main() -> int:
    """Kill runs, print how many, and every distinct failure."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--runner", choices=RUNNERS, action="append")
    given = parser.parse_args()
    rng, failures, began = random.Random(given.seed), Counter[str](), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        victims = Victims(Path(folder), tuple(given.runner or RUNNERS))
        count = 0
        while count < given.runs and time.monotonic() < began + given.seconds:
            kill = victims.chosen(rng)
            count += 1
            for problem in victims.kill(kill):
                failures[problem] += 1
                print(f"{kill}: {problem}", flush=True)
    print(f"{count} runs in {time.monotonic() - began:.0f} s, {dict(victims.counts)}, {failures.total()} failures")
    for problem, times in failures.most_common():
        print(f"{times:5} x {problem}")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
