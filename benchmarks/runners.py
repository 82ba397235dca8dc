"""How much of the speed-up that the cores allow the runners reach over a set.

    python -m benchmarks.runners --items 16 --size 256

synthesises so many textures by self_tuning with one thread, by as many runs of one thread at once as there are
cores, each over its part of the set, with all threads of one process, and with the runners `threads` and
`processes`. It prints wall time and the speed-up over one thread as a share of the number of cores, and of the
speed-up of the runs at once, which is what the cores allow: they share caches and memory, and may be halves of
one. Each is the second of two runs with different seeds in stores of their own, so that kernels are compiled;
start-up counts. The share of the CPU time that one thread needs is an upper bound of that of the speed-up,
which also a busy machine tells.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.many_items import make_crops
from texloom.stages.kernels.core.threads import processors

TARGET = 0.9  # of the speed-up that the cores allow


def seconds(sets: list[Path], size: int, seed: int, options: list[str], threads: int | None) -> tuple[float, float]:
    """Wall time and CPU time of runs at once, one for each set, s, that of their workers included."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, **({} if threads is None else {"TEXLOOM_THREADS": str(threads)})}
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        running = []
        for number, crops in enumerate(sets):
            words = ["run", "self_tuning", str(crops), "--size", str(size), "--seed", str(seed), *options]
            places = ["--store", f"{folder}/store{number}", "--out", f"{folder}/out{number}"]
            command = [sys.executable, "-m", "texloom", *words, *places]
            quiet = subprocess.DEVNULL
            running.append(subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet))
        if sum(process.wait() != 0 for process in running):
            raise SystemExit("a run has failed")
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--items", type=int, default=16, help="textures")
    parser.add_argument("--size", type=int, default=256, help="px of a texture's side")
    options = parser.parse_args()
    cores = processors()
    textures = f"{options.items} textures of {options.size}x{options.size} px"
    print(f"{cores} cores; {textures}; target {100 * TARGET:.0f} %")
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name) / "crops"
        make_crops(whole, options.items)
        parts = [Path(name) / f"part{number}" for number in range(cores)]
        for part in parts:
            part.mkdir()
        for number, crop in enumerate(sorted(whole.iterdir())):
            (parts[number % cores] / crop.name).symlink_to(crop)
        alone, needed, allowed = 0.0, 0.0, 0.0
        for label, sets, runner, threads in (
            ("one thread", [whole], "local", 1),
            ("runs of one thread at once", parts, "local", 1),
            ("all threads of one process", [whole], "local", None),
            ("--runner threads", [whole], "threads", None),
            ("--runner processes", [whole], "processes", None),
        ):
            took, cpu = [seconds(sets, options.size, seed, ["--runner", runner], threads) for seed in (1, 2)][-1]
            alone, needed = alone or took, needed or cpu
            if sets is parts:
                allowed = alone / took
            speed_up, share = alone / took, alone / took / cores
            of_allowed = f", {100 * speed_up / allowed:4.0f} % of what the cores allow" if allowed else ""
            print(
                f"{label:28} {took:8.1f} s, {speed_up:5.2f} times as fast, {100 * share:4.0f} %{of_allowed}; "
                f"{cpu:8.1f} s of CPU time, of which one thread needs {100 * needed / cpu:4.0f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
