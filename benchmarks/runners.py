"""How much of the speed-up that the cores allow the runners reach over a set.

    python -m benchmarks.runners --items 16 --size 256

synthesises so many textures by self_tuning with one thread, with all threads of one process, and with the runners
`threads` and `processes`, and prints wall time and the speed-up over one thread as a share of the number of cores.
Each is the second of two runs with different seeds in stores of their own, so that kernels are compiled; start-up
counts. The share of the CPU time that one thread needs is an upper bound of that of the speed-up, which also a busy
machine tells.
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

TARGET = 0.9  # of the speed-up that the cores allow


def seconds(folder: Path, size: int, seed: int, options: list[str], threads: int | None) -> tuple[float, float]:
    """Wall time and CPU time of a run, s, that of its workers included."""
    with tempfile.TemporaryDirectory() as store:
        words = ["run", "self_tuning", "crops", "--size", str(size), "--seed", str(seed), *options]
        command = [sys.executable, "-m", "texloom", *words, "--store", store, "--out", f"{store}/out"]
        environment = {**os.environ, **({} if threads is None else {"TEXLOOM_THREADS": str(threads)})}
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--items", type=int, default=16, help="textures")
    parser.add_argument("--size", type=int, default=256, help="px of a texture's side")
    options = parser.parse_args()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    print(
        f"{cores} cores; {options.items} textures of {options.size}x{options.size} px; target {100 * TARGET:.0f} %"
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_crops(folder / "crops", options.items)
        alone, needed = 0.0, 0.0
        for label, words, threads in (
            ("one thread", ["--runner", "local"], 1),
            ("all threads of one process", ["--runner", "local"], None),
            ("--runner threads", ["--runner", "threads"], None),
            ("--runner processes", ["--runner", "processes"], None),
        ):
            took, cpu = [seconds(folder, options.size, seed, words, threads) for seed in (1, 2)][-1]
            alone, needed = alone or took, needed or cpu
            speed_up, share = alone / took, alone / took / cores
            print(
                f"{label:28} {took:8.1f} s, {speed_up:5.2f} times as fast, {100 * share:4.0f} %; "
                f"{cpu:8.1f} s of CPU time, of which one thread needs {100 * needed / cpu:4.0f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
