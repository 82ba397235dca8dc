"""Times of the stitched syntheses, side by side.

    python benchmarks/classics.py --exemplar green_scales.png          to 256x256, relative to quilting
    python benchmarks/classics.py --exemplar bricks.png --side 512      those on a lattice too, where there is one

Every line is the best of ``--repeats`` runs of the stage alone in this process, after one that compiles kernels.
Where the machine has other work to do, seconds of the processors tell more than those of the clock.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.kernels.core.threads import thread_count

METHODS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("quilting", {}),
    ("adaptive", {"k": 1.0}),
    ("adaptive", {"k": 0.8}),
    ("adaptive", {"k": 0.5}),
    ("adaptive", {"k": 0.2}),
    ("hybrid", {}),
    ("patch_based", {}),
    ("graph_cut", {}),
    ("near_regular", {}),
    ("regularised_patches", {}),
)


def lattice_of(image: Image) -> dict[str, Any]:
    """What methods on a lattice are given: the exemplar must have one."""
    density = find_stage("analysis.autocorrelation").function(
        image, find_stage("analysis.autocorrelation").params()
    )
    stage, deformed = find_stage("analysis.lattice"), find_stage("analysis.deformed_lattice")
    found = stage.function(image, density.density, stage.params.model_validate({"beta": 3.0}))
    lattice = deformed.function(image, deformed.params(), found.best)
    straighten = find_stage("analysis.straighten")
    straight = straighten.function(image, lattice.vertices, lattice.regular, straighten.params())
    return {**vars(lattice), "source": straight.source}


def on_a_lattice(method: str) -> bool:
    """Whether a method asks for a lattice."""
    return "vertices" in find_stage(f"synthesis.{method}").inputs


def seconds(method: str, image: Image, params: dict[str, Any], repeats: int) -> tuple[float, float]:
    """The fastest of some runs of a stage, by the clock and by the processors."""
    stage = find_stage(f"synthesis.{method}")
    known = lattice_of(image) if on_a_lattice(method) else {}
    given = {name: known[name] for name in stage.inputs if name in known}
    if method == "near_regular":  # whose vertices are those of the straightened exemplar
        given["vertices"] = known["regular"]
    times = []
    for _ in range(repeats):
        began = time.perf_counter(), time.process_time()
        stage.function(image, **given, params=stage.params(**params), rng=np.random.default_rng(7))
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    clock, processors = zip(*times, strict=True)
    return min(clock), min(processors)


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exemplar", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--methods", nargs="+", metavar="NAME", help="only these (default: all)")
    parser.add_argument("--side", type=int, default=256, help="side of the result, px (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="(default: %(default)s)")
    options = parser.parse_args()
    image = open_source("exemplar", options.exemplar).read()
    methods = tuple(entry for entry in METHODS if not options.methods or entry[0] in options.methods)
    try:
        lattice_of(image)
    except InputError as error:
        methods = tuple(entry for entry in methods if not on_a_lattice(entry[0]))
        print(f"Methods on a lattice are left out: {error}")
    for method, params in methods:
        seconds(method, image, {"size": (64, 64), **params}, 1)
    print(f"{options.exemplar}, {image.height}x{image.width} px to {options.side}, {thread_count()} threads\n")
    print(f"{'method':20}{'s':>8}{'s of CPU':>10}{'to the first':>14}")
    first = 0.0
    for method, params in methods:
        took, busy = seconds(method, image, {"size": (options.side, options.side), **params}, options.repeats)
        first = first or took
        name = " ".join([method, *(f"{key}={value}" for key, value in params.items())])
        print(f"{name:20}{took:8.2f}{busy:10.2f}{took / first:14.1f}", flush=True)


if __name__ == "__main__":
    main()
