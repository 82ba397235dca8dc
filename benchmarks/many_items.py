"""Overhead of sets of many items: first run, run again, plan and prune.

    python -m benchmarks.many_items --items 1000 10000

makes so many crops of 80 x 80 px, runs two quick steps over them, and prints wall time, CPU time and peak memory of
each command, its CPU time per item, and the number and size of the store's files. Each command is a process of its
own; its start-up is the time of the same command over one item. The cold run, where the system permits it, has no
files in memory.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import skimage.data
from PIL import Image

SIDE = 80  # px
FLOW = """\
flow: many
sources:
  crop: {each: crops/*.png}
steps:
  structure: {stage: analysis.otsu, inputs: {strength: strength.strength}}
  strength: {stage: analysis.edges, inputs: {image: crop}, params: {detector: gradient}}
exports:
  structure.exr: structure.structure
"""


def make_crops(folder: Path, count: int) -> None:
    """Write so many crops and the flow."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    picture = skimage.data.gravel()
    for number in range(count):
        top, left = rng.integers(0, np.array(picture.shape) - SIDE)
        Image.fromarray(picture[top : top + SIDE, left : left + SIDE]).save(folder / f"c{number:06d}.png")
    (folder.parent / "many.yaml").write_text(FLOW)


def drop_caches() -> bool:
    """Make the system forget what it holds of files; whether that is possible and permitted here."""
    try:
        os.sync()
        Path("/proc/sys/vm/drop_caches").write_text("3")
    except OSError:
        return False
    return True


def run(folder: Path, *arguments: str) -> tuple[float, float, float]:
    """Wall time and CPU time of a command, s, and its peak memory, MB."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "texloom", *arguments, "--store", "store"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: ended with {process.returncode}")
    unit = 1024 if sys.platform != "darwin" else 1
    return time.perf_counter() - began, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit / 1e6


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--items", type=int, nargs="+", default=[1000, 10_000], help="sizes of the sets")
    options = parser.parse_args()
    print(f"{'items':>7} {'command':10} {'wall time':>10} {'CPU time':>10} {'an item':>10} {'memory':>8}")
    alone: dict[str, float] = {}
    for count in [1, *options.items]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            make_crops(folder / "crops", count)
            commands = {
                "plan": ["plan", "many.yaml"],
                "run": ["run", "many.yaml", "--out", "out"],
                "run again": ["run", "many.yaml", "--out", "out"],
                "run third": ["run", "many.yaml", "--out", "out"],
                "run cold": ["run", "many.yaml", "--out", "out"],
                "plan again": ["plan", "many.yaml"],
                "store ls": ["store", "ls"],
                "prune": ["store", "prune", "--days", "0"],
            }
            for label, arguments in commands.items():
                if label == "run cold" and not drop_caches():
                    continue
                wall, cpu, memory = run(folder, *arguments)
                alone.setdefault(label, cpu)
                each = 1000 * (cpu - alone[label]) / count
                print(
                    f"{count:7} {label:10} {wall:8.2f} s {cpu:8.2f} s {each:7.2f} ms {memory:5.0f} MB", flush=True
                )
                if label == "run again":
                    files = [path for path in (folder / "store").rglob("*") if path.is_file()]
                    total = sum(path.stat().st_size for path in files)
                    print(f"{count:7} store: {len(files)} files, {total / 1e6:.1f} MB", flush=True)


if __name__ == "__main__":
    main()
