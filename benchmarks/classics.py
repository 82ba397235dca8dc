"""Times of the patch-based methods.

    python -m benchmarks.classics --exemplar green_scales.png          to 256x256, relative to quilting
    python -m benchmarks.classics --exemplar bricks.png --side 512      lattice methods too, if it has a lattice

Every line is the best of ``--repeats`` runs of the stage in this process, after one that compiles kernels. On a
busy machine CPU time is more reliable than wall time.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import numpy as np

from benchmarks.timing import Seconds, fastest
from texloom.pipelines.media.sources import open_source
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size

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
    """The inputs of lattice methods; `InputError` if the exemplar has no lattice."""
    density = find_stage("analysis.autocorrelation").function(
        image, find_stage("analysis.autocorrelation").params()
    )
    stage, deformed = find_stage("analysis.lattice"), find_stage("analysis.deformed_lattice")
    detected = stage.function(image, density.density, stage.params.model_validate({"beta": 3.0}))
    lattice = deformed.function(image, deformed.params(), detected.best)
    straighten = find_stage("analysis.straighten")
    straight = straighten.function(image, lattice.vertices, lattice.regular, straighten.params())
    return {**vars(lattice), "source": straight.source}


def needs_lattice(method: str) -> bool:
    """Whether a method takes a lattice."""
    return "vertices" in find_stage(f"synthesis.{method}").inputs


def seconds(method: str, image: Image, params: dict[str, Any], repeats: int) -> Seconds:
    """Times of the fastest of several runs of a stage."""
    stage = find_stage(f"synthesis.{method}")
    known = lattice_of(image) if needs_lattice(method) else {}
    inputs = {name: known[name] for name in stage.inputs if name in known}
    if method == "near_regular":  # its vertices are those of the straightened exemplar
        inputs["vertices"] = known["regular"]
    run = partial(stage.function, image, **inputs, params=stage.params(**params))
    return fastest(lambda: run(rng=np.random.default_rng(7)), repeats)[0]


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
        methods = tuple(entry for entry in methods if not needs_lattice(entry[0]))
        print(f"Lattice methods are skipped: {error}")
    for method, params in methods:
        seconds(method, image, {"size": (64, 64), **params}, 1)
    print(f"{options.exemplar}, {format_size(image)} to {options.side}, {thread_count()} threads\n")
    print(f"{'method':20}{'s':>8}{'CPU s':>10}{'relative':>14}")
    first = 0.0
    for method, params in methods:
        wall, cpu, _ = seconds(method, image, {"size": (options.side, options.side), **params}, options.repeats)
        first = first or wall
        name = " ".join([method, *(f"{key}={value}" for key, value in params.items())])
        print(f"{name:20}{wall:8.2f}{cpu:10.2f}{wall / first:14.1f}", flush=True)


if __name__ == "__main__":
    main()
