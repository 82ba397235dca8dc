"""Times of per-pixel synthesis: whole images, and strokes on a canvas.

    python -m benchmarks.per_pixel                                     a wall, with its lightness as control
    python -m benchmarks.per_pixel --exemplar rust.png --control wetness.png --side 128
    python -m benchmarks.per_pixel --device gpu                        with frames per second

Every line is the median of ``--repeats`` runs after one that compiles kernels, and the CPU time of all threads.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.timing import timed
from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.interactive.canvas import Canvas
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.arrays import Image

DAB = 32


def small(name: str, source: str, side: int) -> Image:
    """An image scaled to ``side`` px squared, in place of a compaction."""
    image = open_source(name, source).read()
    return Image(np.ascontiguousarray(np.clip(resize(image.pixels, side, side), 0, None)), image.channels)


def median(work: Callable[[int], object], repeats: int) -> tuple[float, float]:
    """Median wall time and CPU time of ``work(number)`` after a first call, s."""
    walls, cpus, _ = zip(*(timed(partial(work, number))[0] for number in range(repeats + 1)), strict=True)
    return statistics.median(walls[1:]), statistics.median(cpus[1:])


def show(name: str, seconds: tuple[float, float], first: float) -> None:
    """Print a line of the table."""
    print(f"{name:44}{1000 * seconds[0]:10.1f}{1000 * seconds[1]:12.1f}{seconds[0] / first:14.2f}", flush=True)


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exemplar", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--control", default="skimage:brick", help="its control map (default: %(default)s)")
    parser.add_argument("--side", type=int, default=128, help="of the exemplar, px (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=15, help="(default: %(default)s)")
    parser.add_argument("--device", choices=("cpu", "gpu"), default="cpu", help="(default: %(default)s)")
    options = parser.parse_args()
    image, control = (small(name, getattr(options, name), options.side) for name in ("exemplar", "control"))
    stack = appearance_stack(image, AppearanceStackParams())
    hardware = f"{thread_count()} threads" if options.device == "cpu" else gpu_name()
    print(f"{options.exemplar}, {options.side}x{options.side} px, {hardware}\n")
    print(f"{'':44}{'ms':>10}{'CPU ms':>12}{'relative':>14}")

    canvas = Canvas(image, control, (512, 512), stack=stack, device=options.device)
    rows, columns = np.indices((512, 512)) / 512
    waves = (0.5 + 0.5 * np.sin(6 * columns + 3 * np.sin(5 * rows))).astype(np.float32)
    maps = [np.repeat(part[..., None], canvas.planes, axis=2) for part in (waves, 1 - waves)]

    def frame(number: int) -> None:
        """Synthesise the picture without reading its pixels back."""
        canvas.paint(maps[number % 2])

    def whole(number: int) -> None:
        frame(number)
        canvas.picture()

    first = median(whole, options.repeats)
    show("512 x 512 px under another control map", first, first[0])

    frames = median(frame, options.repeats)
    show("the same, and no pixels fetched", frames, first[0])

    values = np.repeat(np.repeat(maps[0], 2, 0), 2, 1)
    large = Canvas(image, control, (1024, 1024), stack=stack, values=values, device=options.device)
    random = np.random.default_rng(1)
    places = random.integers(0, 1024 - DAB, (options.repeats + 1, 2))

    def dab(number: int) -> None:
        value = np.full((DAB, DAB, large.planes), random.random(), np.float32)
        for area in large.paint(value, *(int(side) for side in places[number])):
            large.picture(area)

    show(f"a dab of {DAB} px on 1024 x 1024 px", median(dab, options.repeats), first[0])
    show(
        f"analysis of {options.side}x{options.side} px",
        median(lambda _: appearance_stack(image, AppearanceStackParams()), 2),
        first[0],
    )
    print(f"\n{1 / frames[0]:.0f} frames of 512 x 512 px a second")


def gpu_name() -> str:
    """The GPU, by name."""
    from numba import cuda

    return str(cuda.get_current_device().name)


if __name__ == "__main__":
    main()
