"""Runs that are killed at random times: nothing finished is lost, and the next run ends with the same files.

``python -m tests.kills --runs 1000 --log FILE`` kills that many runs, those of the file included, and prints every
distinct failure; so it can be ended and called again.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
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
SIGNALS = {"KILL": signal.SIGKILL, "TERM": signal.SIGTERM, "INT": signal.SIGINT}
CODES = {signal.SIGTERM: 143, signal.SIGINT: 130}
_SECONDS = 180  # that a run may take


@dataclasses.dataclass(frozen=True)
class Kill:
    """How a run was ended."""

    flow: str
    runner: str
    signal: str
    is_group: bool
    """whether the run's workers receive the signal too, as they do from a terminal"""
    times: int
    share: float
    """of the time that a whole run takes"""
    next_runner: str

    def __str__(self) -> str:
        whom = " of the group" if self.is_group else ""
        times = f", {self.times} times" if self.times > 1 else ""
        return f"{self.flow}, {self.runner}, {self.signal}{whom}{times} at {100 * self.share:.0f} %"


class Victims:
    """Flows to kill, with the files and times of whole runs."""

    def __init__(self, folder: Path, runners: tuple[str, ...] = RUNNERS):
        self.folder = folder
        self.runners = runners
        self.paths = {"one": write_flow(folder / "one", ANALYSIS), "set": write_set(_made(folder / "set"), SET)}
        self.expected: dict[str, dict[str, bytes]] = {}
        self.seconds: dict[tuple[str, str], float] = {}

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
        name = rng.choice(list(SIGNALS))
        return Kill(
            flow=rng.choice(list(self.paths)),
            runner=rng.choice(self.runners),
            signal=name,
            is_group=rng.random() < 0.5,
            times=1 if name == "KILL" else rng.choice((1, 2)),
            share=rng.random(),
            next_runner=rng.choices(self.runners, [6 if one == "local" else 1 for one in self.runners])[0],
        )

    def kill(self, kill: Kill) -> tuple[str, list[str]]:
        """End a run so, run it again, and say whether it was in time, and what is wrong."""
        seconds = self._whole(kill.flow, kill.runner)
        place = _made(self.folder / "killed")
        process = self._start(kill.flow, kill.runner, place)
        time.sleep(kill.share * seconds)
        number = SIGNALS[kill.signal]
        over = process.poll() is not None
        for index in range(kill.times):
            time.sleep(0.2 * bool(index))
            if process.poll() is None:
                (os.killpg if kill.is_group else os.kill)(process.pid, number)
        try:
            _, errors = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return "killed", ["the run did not end"]
        outcome = "too late" if over or process.returncode == 0 else "killed"
        problems = []
        if number in CODES and not _was_starting(process.returncode, number, errors):
            if process.returncode not in (CODES[number], 0):
                problems.append(f"exit code {process.returncode}: {_last(errors)}")
            if "Traceback" in errors:
                problems.append(f"a traceback: {_raised(errors)}")
        finished = _finished(place)
        again = self._start(kill.flow, kill.next_runner, place)
        try:
            _, errors = again.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(again.pid, signal.SIGKILL)
            return outcome, [*problems, "the next run did not end"]
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
        return outcome, problems


def _made(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _finished(place: Path) -> dict[str, int]:
    """When the result of each record was written; its record has the time when it was used."""
    records = [path for path in (place / "store" / "records").glob("*") if not path.name.startswith(".")]
    made = {
        path.parent.name: path.stat().st_mtime_ns for path in (place / "store" / "cache").glob("*/*/manifest.json")
    }
    return {path.name: made.get(path.name.rpartition("-")[2], 0) for path in records}


def _was_starting(code: int, number: int, errors: str) -> bool:
    """Whether a signal came before Python had loaded the first line of texloom."""
    return code == -number or "init_import_site" in errors or "Could not import runpy" in errors


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "nothing was printed"


def _raised(errors: str) -> str:
    """What the first traceback ends with, and where it was raised."""
    lines = errors[errors.index("Traceback") :].splitlines()[1:]
    end = next((index for index, line in enumerate(lines) if line and not line.startswith(" ")), len(lines))
    places = [line.strip() for line in lines[:end] if line.strip().startswith("File ")]
    return " ".join([*lines[end : end + 1], *places[-1:]])[:300]


def _without_digits(name: str) -> str:
    return "".join("#" if character in "0123456789abcdef" else character for character in name)


def main() -> int:
    """Kill runs, print how many, and every distinct failure."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--runner", choices=RUNNERS, action="append")
    parser.add_argument("--log", type=Path, default=Path(os.devnull), help="of the runs; those in it count")
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # or runs would ignore it in a shell's background
    rng, began = random.Random(given.seed), time.monotonic()
    with tempfile.TemporaryDirectory() as folder, given.log.open("a+") as log:
        log.seek(0)
        done = [json.loads(line) for line in log]
        victims = Victims(Path(folder), tuple(given.runner or RUNNERS))
        for index in range(given.runs):
            kill = victims.chosen(rng)
            if index < len(done):
                continue
            if time.monotonic() > began + given.seconds:
                break
            outcome, problems = victims.kill(kill)
            done.append({"kill": str(kill), "runner": kill.runner, "outcome": outcome, "problems": problems})
            print(json.dumps(done[-1]), file=log, flush=True)
            for problem in problems:
                print(f"{kill}: {problem}", flush=True)
    counts = Counter(f"{one['runner']} {one['outcome']}" for one in done)
    print(f"{len(done)} runs, {time.monotonic() - began:.0f} s, {dict(sorted(counts.items()))}")
    failures = Counter(problem for one in done for problem in one["problems"])
    for problem, times in failures.most_common():
        print(f"{times:5} x {problem}")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
