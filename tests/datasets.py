"""A whole data set compacted by one command while its workers are killed, and a second run of the finished set.

``python -m tests.datasets`` compacts 1,000 textures of 256 x 256 px with control maps, one of which is broken,
by worker processes and by a local Dask cluster of two workers, kills a worker ten times each, and prints what
went wrong. Without kills it also prints the share of the time that was spent outside stages.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import random
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import psutil

from tests.pipelines.flows import start_run
from tests.synthetic import smooth_noise

WORKERS = 2
_FLOW = """
flow: library
include: inverse
sources:
  texture: {each: data/color/*.png}
  control: {each: data/control/*.png, pair: texture}
"""


@dataclasses.dataclass(frozen=True)
class Ended:
    """A run of the set that has ended."""

    code: int
    report: dict[str, Any]
    errors: str
    seconds: float
    killed: int

    @property
    def overhead(self) -> float:
        """Share of the workers' time that was not spent in stages, start and end of the program included."""
        inside = sum(step["seconds"] or 0.0 for step in self.report["steps"])
        return 1 - inside / (WORKERS * self.seconds)


@dataclasses.dataclass(frozen=True)
class Library:
    """Textures with control maps in a folder, and the flow that compacts them."""

    flow: Path
    items: tuple[str, ...]
    broken: str
    """the item whose texture is truncated"""
    options: tuple[str, ...]
    """of every run"""

    @classmethod
    def made(cls, folder: Path, items: int, side: int, size: int) -> Library:
        """Draw the textures: spots that grow with the control map."""
        for kind in ("color", "control"):
            (folder / "data" / kind).mkdir(parents=True)
        names = tuple(f"texture_{number:04}" for number in range(items))
        broken = names[items // 2]
        for number, name in enumerate(names):
            rng = np.random.default_rng(number)
            control, spots = (smooth_noise((side, side), sigma, rng) for sigma in (side / 8, 2.0))
            colors = np.stack([control * spots, spots, (1 - control) * spots], axis=2)
            for kind, planes in (("color", colors), ("control", control)):
                PIL.Image.fromarray(np.uint8(255 * planes)).save(folder / "data" / kind / f"{name}.png")
        torn = folder / "data" / "color" / f"{broken}.png"
        torn.write_bytes(torn.read_bytes()[:-200])
        (folder / "library.yaml").write_text(_FLOW)
        return cls(folder / "library.yaml", names, broken, ("--size", str(size)))

    def run(self, runner: str, kills: int = 0, rng: random.Random | None = None, expected: float = 0.0) -> Ended:
        """Run all items with a store and an output folder for each runner; kill workers on the way.

        ``expected``: seconds over which the kills are spread, from the first result on.
        """
        options = [*self.options, "--store", f"store-{runner}", "--out", f"out-{runner}", "--runner", runner]
        began = time.monotonic()
        process = start_run(self.flow, *options, "--workers", WORKERS)
        records = self.flow.parent / f"store-{runner}" / "records"
        with ThreadPoolExecutor(1) as reader:  # a run waits while nobody reads what it prints
            ended = reader.submit(process.communicate)
            while kills and process.poll() is None and not list(records.glob("*")):
                time.sleep(0.1)
            killed = _kill_workers(process, kills, rng or random.Random(0), expected)
            output, errors = ended.result()
        seconds = time.monotonic() - began
        return Ended(process.returncode, json.loads(output or "{}"), errors, seconds, killed)

    def run_again(self, runner: str) -> tuple[Ended, list[str]]:
        """Run the finished set, without the broken item; what is wrong unless all of it is cached."""
        hidden = self.flow.parent / "hidden"
        hidden.mkdir(exist_ok=True)
        for path in self.flow.parent.glob(f"data/*/{self.broken}.png"):
            path.rename(hidden / path.parent.name)
        try:
            again = self.run(runner)
        finally:
            for path in hidden.iterdir():
                path.rename(self.flow.parent / "data" / path.name / f"{self.broken}.png")
        steps = again.report.get("steps", [])
        states = [step["state"] for step in steps if step["state"] != "skipped"]  # those that nobody asked for
        problems = [] if again.code == 0 else [f"the second run: exit code {again.code}: {again.errors[-300:]}"]
        if set(states) != {"cached"}:
            problems.append(f"the second run: {len(states) - states.count('cached')} steps were not cached")
        return again, problems

    def problems(self, ended: Ended, runner: str) -> list[str]:
        """What is wrong with a run: anything but one failure that names the broken item."""
        problems = []
        if ended.code != 1:
            problems.append(f"exit code {ended.code}: {ended.errors[-600:]}")
        failed = dict(ended.report.get("items", {}).get("problems", {}))
        if failed.pop(self.broken, None) is None:
            problems.append(f"{self.broken} did not fail")
        problems += [f"{name} failed: {problem}" for name, problem in failed.items()]
        out = self.flow.parent / f"out-{runner}"
        missing = [
            name for name in self.items if name != self.broken and not (out / name / "texture.exr").is_file()
        ]
        if missing:
            problems.append(f"{len(missing)} items have no result, such as {missing[0]}")
        if "Traceback" in ended.errors:
            problems.append(f"a traceback: {ended.errors[-600:]}")
        return problems


def _kill_workers(process: subprocess.Popen[str], kills: int, rng: random.Random, expected: float) -> int:
    """Kill a worker at each of some random times of a run; how many were killed."""
    began, killed = time.monotonic(), 0
    for at in sorted(rng.random() * expected for _ in range(kills)):
        while time.monotonic() < began + at and process.poll() is None:
            time.sleep(0.05)
        workers = _workers(process.pid)
        while not workers and process.poll() is None:  # they start late, and anew after a kill
            time.sleep(0.2)
            workers = _workers(process.pid)
        if process.poll() is not None:
            break
        rng.choice(workers).kill()
        killed += 1
    return killed


def _workers(run: int) -> list[psutil.Process]:
    """The worker processes of a run; the helpers of multiprocessing are none."""
    found = []
    try:
        for child in psutil.Process(run).children(recursive=True):
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    except psutil.Error:  # one has just ended
        pass
    return found


def main() -> int:
    """Run the set by each runner and print what is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.datasets", description=__doc__)
    parser.add_argument("--items", type=int, default=1000)
    parser.add_argument("--side", type=int, default=256, help="of the textures, px")
    parser.add_argument("--size", type=int, default=64, help="of the compactions, px")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--expected", type=float, default=600, help="seconds over which the kills are spread")
    parser.add_argument("--runner", choices=("processes", "dask"), action="append")
    given = parser.parse_args()
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        library = Library.made(Path(folder) / "library", given.items, given.side, given.size)
        for runner in given.runner or ("processes", "dask"):
            ended = library.run(runner, given.kills, random.Random(given.items), given.expected)
            again, problems = library.run_again(runner)
            problems = library.problems(ended, runner) + problems
            outside = f", {100 * ended.overhead:.1f} % of the time outside stages" if not given.kills else ""
            print(
                f"{runner}: {given.items} items in {ended.seconds:.0f} s, {ended.killed} workers killed{outside}; "
                f"the second run in {again.seconds:.1f} s"
            )
            for problem in problems:
                print(f"  {problem}")
            count += len(problems)
    return int(bool(count))


if __name__ == "__main__":
    sys.exit(main())
