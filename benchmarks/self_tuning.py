"""Times of the self-tuning method, stage by stage and scale by scale, and the patch distances of its search.

    python -m benchmarks.self_tuning                        one run, 512x512 to 1024x1024
    python -m benchmarks.self_tuning --growth               results from 256x256 to 2048x2048
    python -m benchmarks.self_tuning --presets              the presets, relative to `default`
    python -m benchmarks.self_tuning --large 1024 2048 4096 seconds and memory of large results, a process each

Every line of figures is the best of ``--repeats`` runs in this process, after one run that compiles the kernels.
Each run has a store of its own, so times include reading and writing artifacts.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, ClassVar

from benchmarks.timing import peak_memory, timed
from texloom.pipelines.engine.events import Event, Recorder, StepProgress, StepReport
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.synthesis.optimisation import optimise

os.environ.pop("PREFECT_API_URL", None)


_Search: Any = vars(optimise)["Search"]


class CountedSearch(_Search):  # type: ignore[misc]
    """A search that is listed, so that its distances can be read afterwards."""

    made: ClassVar[list[CountedSearch]] = []

    def __init__(self, *args: Any, **named: Any):
        super().__init__(*args, **named)
        self.made.append(self)


def compared_at_scales() -> list[int]:
    """Patch distances of each scale, of all starts."""
    scales = itertools.groupby(CountedSearch.made, lambda search: search.counts.shape)
    return [sum(search.compared for search in searches) for _, searches in scales]


class ScaleClock:
    """A listener that notes when each scale of the optimisation begins, and the CPU time of each step."""

    def __init__(self) -> None:
        self.reports: list[tuple[int, float]] = []
        self.cpu: dict[str, float] = {}
        self._cpu = time.process_time()

    def __call__(self, event: Event) -> None:
        """Note the time of the first report of each scale, and of the end."""
        if isinstance(event, StepReport):
            before, self._cpu = self._cpu, time.process_time()
            self.cpu[event.name] = self._cpu - before
        if isinstance(event, StepProgress) and event.step == "texture":
            if not self.reports or self.reports[-1][0] != event.progress.scale:
                self.reports.append((event.progress.scale, time.perf_counter()))
        elif isinstance(event, StepReport) and event.name == "texture":
            self.reports.append((0, time.perf_counter()))

    def seconds(self) -> list[float]:
        """From the first report of a scale to that of the next; the last one holds the end of the stage."""
        times = [when for _, when in self.reports]
        return [after - before for before, after in itertools.pairwise(times)]


@dataclasses.dataclass(frozen=True)
class Timing:
    """Seconds of one run."""

    whole: float
    steps: dict[str, float]
    cpu: dict[str, float]
    """CPU seconds of each step, with what is done before it"""
    scales: list[dict[str, Any]]
    """as `texloom.stages.synthesis.optimisation.optimise` reports them, with
    ``seconds`` and ``distances`` per pixel"""


def run_flow(exemplar: str, params: dict[str, str]) -> Timing:
    """Run the flow in a new store."""
    with tempfile.TemporaryDirectory(prefix="texloom-benchmark-") as folder:
        flow = load_flow(find_flow("self_tuning"), Overrides({"exemplar": exemplar}, params))
        clock = ScaleClock()
        CountedSearch.made.clear()
        run, recorder = Run(flow, Store(Path(folder))), Recorder(clock)
        seconds, _ = timed(lambda: execute(run, recorder, Path(folder) / "out"))
        artifact = run.store.find("synthesis.optimise", str(recorder.reports["texture"].key))
        assert artifact is not None
        scales = run.store.load(artifact, flow.steps["texture"].stage.result, ["scales"])["scales"]
    scales = [
        {**scale, "seconds": seconds, "distances": compared / (scale["height"] * scale["width"])}
        for scale, seconds, compared in zip(scales, clock.seconds(), compared_at_scales(), strict=True)
    ]
    steps = {name: report.seconds for name, report in recorder.reports.items()}
    return Timing(seconds.wall, steps, clock.cpu, scales)


def best(exemplar: str, params: dict[str, str], repeats: int) -> Timing:
    """The fastest of some runs."""
    return min((run_flow(exemplar, params) for _ in range(repeats)), key=lambda timing: timing.whole)


def one_run(exemplar: str, side: int, repeats: int) -> None:
    """Print a table of stages and one of scales."""
    timing = best(exemplar, {"start.size": str(side)}, repeats)
    print(f"{'step':12}{'s':>8}{'share':>8}{'cpu s':>8}")
    for name, seconds in timing.steps.items():
        print(f"{name:12}{seconds:8.2f}{seconds / timing.whole:8.0%}{timing.cpu[name]:8.2f}")
    cpu = sum(timing.cpu.values())
    print(f"{'all':12}{timing.whole:8.2f}{1:8.0%}{cpu:8.2f}   peak memory {peak_memory():.0f} MB\n")
    print(f"{'scale':>5}{'height':>8}{'width':>7}{'rounds':>8}{'energy':>9}{'s':>8}{'distances/px':>14}")
    for number, scale in enumerate(timing.scales, start=1):
        print(
            f"{number:5}{scale['height']:8}{scale['width']:7}{scale['rounds']:8}"
            f"{scale['energy']:9.2f}{scale['seconds']:8.2f}{scale['distances']:14.1f}"
        )


def growth(exemplar: str, repeats: int) -> None:
    """Print how time grows with the size of the result."""
    print(f"{'result':>11}{'s':>8}{'texture s':>11}{'us/px':>8}{'to 256':>8}")
    first = 0.0
    for side in (256, 512, 1024, 2048):
        timing = best(exemplar, {"start.size": str(side)}, repeats)
        whole, texture = timing.whole, timing.steps["texture"]
        first = first or whole
        rate = whole / side**2 * 1e6
        print(f"{side:6}x{side:<4}{whole:8.2f}{texture:11.2f}{rate:8.1f}{whole / first:8.1f}", flush=True)
    print(f"peak memory {peak_memory():.0f} MB")


def large(exemplar: str, sides: list[int], keep: Path | None) -> None:
    """Print how time and memory grow, up to the texture without its scores; each size has a process of its own."""
    print(f"{'result':>11}{'texture s':>11}{'cpu s':>8}{'cpu us/px':>11}{'MB':>8}{'MB more':>9}{'bytes/px':>10}")
    first: tuple[int, float] | None = None
    for side in sides:
        command = [sys.executable, "-m", "benchmarks.self_tuning", "--exemplar", exemplar, "--one-large", str(side)]
        command += ["--keep", str(keep)] if keep else []
        printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        seconds, cpu, memory = (float(word) for word in printed.split()[-3:])
        first_side, first_memory = first = first or (side, memory)
        beyond, grown = memory - first_memory, side**2 - first_side**2
        each = f"{beyond * 1e6 / grown:10.0f}" if grown else ""
        figures = f"{seconds:11.1f}{cpu:8.1f}{cpu / side**2 * 1e6:11.2f}{memory:8.0f}{beyond:9.0f}{each}"
        print(f"{side:6}x{side:<4}{figures}", flush=True)


def one_large(exemplar: str, side: int, keep: Path | None) -> None:
    """Print the seconds and processor seconds of the texture, and the most memory the flow has held in MB."""
    run_flow(exemplar, {"start.size": "128", "texture.preset": "fast"})
    params = {"start.size": str(side)}
    with tempfile.TemporaryDirectory(prefix="texloom-benchmark-") as folder:
        flow = load_flow(find_flow("self_tuning"), Overrides({"exemplar": exemplar}, params))
        kept = {name: step for name, step in flow.steps.items() if name != "scores"}
        exports = {name: export for name, export in flow.exports.items() if name == "texture.exr"}
        flow = dataclasses.replace(flow, steps=kept, exports=exports)
        run, recorder = Run(flow, Store(Path(folder))), Recorder(lambda _: None)
        out = keep / str(side) if keep else Path(folder) / "out"
        seconds, _ = timed(lambda: execute(run, recorder, out))
        print(recorder.reports["texture"].seconds, seconds.cpu, peak_memory())


def presets(exemplar: str, side: int, repeats: int) -> None:
    """Print the presets side by side."""
    size = str(side)
    base = best(exemplar, {"start.size": size}, repeats).steps["texture"]
    print(f"{'preset':12}{'texture s':>10}{'to default':>12}")
    print(f"{'default':12}{base:10.2f}{1:12.2f}")
    for preset in ("fast", "kaspar2015"):
        seconds = best(exemplar, {"start.size": size, "texture.preset": preset}, repeats).steps["texture"]
        print(f"{preset:12}{seconds:10.2f}{seconds / base:12.2f}")


def main() -> None:
    """Read the options and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exemplar", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--side", type=int, default=1024, help="side of the result, px (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=1, help="(default: %(default)s)")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--presets", action="store_true")
    parser.add_argument("--large", type=int, nargs="+", metavar="SIDE", help="sides of results, px")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where large results are left, for looking at")
    parser.add_argument("--one-large", type=int, metavar="SIDE", help=argparse.SUPPRESS)
    options = parser.parse_args()
    vars(optimise)["Search"] = CountedSearch
    exemplar = options.exemplar if ":" in options.exemplar else str(Path(options.exemplar).resolve())
    if options.one_large:
        one_large(exemplar, options.one_large, options.keep)
        return
    if not options.large:
        run_flow(exemplar, {"start.size": "128", "texture.preset": "fast"})
    print(f"{exemplar}, {thread_count()} threads\n")
    if options.growth:
        growth(exemplar, options.repeats)
    elif options.large:
        large(exemplar, options.large, options.keep)
    elif options.presets:
        presets(exemplar, options.side, options.repeats)
    else:
        one_run(exemplar, options.side, options.repeats)


if __name__ == "__main__":
    main()
