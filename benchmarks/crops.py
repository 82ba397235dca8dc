"""How evenly `self_tuning` uses twelve exemplars, and how like them its results are, against an earlier commit.

    TEXLOOM_TEXTURES=folder python -m benchmarks.crops
    TEXLOOM_TEXTURES=folder python -m benchmarks.crops --against OTHER/.venv/bin/python --keep results
    TEXLOOM_TEXTURES=folder python -m benchmarks.crops --half 1 --seeds 1 --preset fast

Crops of 256 px become 512 px. Printed of each, as means over seeds: the sliced Wasserstein distance of its patches,
coherence, completeness, repetition, copies and contents, as in `metrics`; the mean score of `regularity`; the share
of the cells of a 12x12 grid over the exemplar, half a patch at its border left out, that are used between .7 and
1.4 times their fair share, by the source map, and the same with a lattice's phases exempt, where a fair share is
that of pixels in the same places of lattice cells; the relative standard deviation of their use; the mean use of
the 44 outermost cells, relative to their fair share; and the CPU seconds of a run without scores, the median of
the seeds, since the first may compile. ``--against`` also runs the texloom that another interpreter imports. Half
0 was used to choose parameters, half 1 was not.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.store.store import Store
from texloom.stages.analysis.exemplars.tone import Tone
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelection
from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.common.source_maps.exemplar_use import source_counts
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity
from texloom.stages.synthesis.optimisation.optimise import Optimised
from texloom.stages.vocabulary.arrays import Correspondence, Image

_SIDE = 256  # px, of the crops
_SIZE = 512  # px, of the results
_CELLS = 12  # of the grid, along a side
_RIM = 6  # px of the exemplar's border that are left out
_BOUNDS = 0.7, 1.4  # of a cell's use, relative to its fair share
_PHASES = 6  # along each generator of a lattice
CROPS = (
    ("exemplars/gravel_skimage.png", 100, 60),
    ("exemplars/beach_stones_ogre.jpg", 100, 60),
    ("near_regular/brick_skimage.png", 100, 60),
    ("near_regular/knit_ns217.jpg", 100, 60),
    ("exemplars/olives_ns407.jpg", 0, 0),
    ("exemplars/radishes_ns408.jpg", 0, 0),
    ("near_regular/diamond_plate_blue_ns200.jpg", 100, 60),
    ("near_regular/honeycomb_ns214.jpg", 100, 60),
    ("exemplars/ivy_ns240.png", 100, 60),
    ("exemplars/fieldstone_panda.jpg", 100, 60),
    ("exemplars/cracked_mud_ns12.jpg", 100, 60),
    ("exemplars/moss_ground_nobiax104.jpg", 100, 60),
)
"""file, left and top px"""
FIGURES = (
    "swd", "coherence", "complete", "regular", "repeat", "copies", "contents", "in bounds", "exempt", "spread",
    "rim", "CPU s",
)  # fmt: skip


def use_of_cells(match: Correspondence, generators: np.ndarray, side: int = _SIDE) -> np.ndarray:
    """How often each cell of the grid is a source, relative to its fair share: (12, 12) float64.

    ``generators``: of the lattice whose phases are exempt, px; no rows for even use of all.
    """
    inner = slice(_RIM, side - _RIM)
    counts = source_counts(match, (side, side))[inner, inner]
    phase = np.zeros(counts.shape, np.int64)
    if len(generators):
        position = np.moveaxis(np.indices(counts.shape), 0, 2) @ steps_along(generators.astype(np.float64))
        phase = np.floor(position % 1 * _PHASES).astype(np.int64) @ _PHASES ** np.arange(len(generators))
    fair = (np.bincount(phase.ravel(), counts.ravel()) / np.maximum(np.bincount(phase.ravel()), 1))[phase]
    place = np.arange(len(counts)) * _CELLS // len(counts)
    cell = (place[:, None] * _CELLS + place).ravel()
    use = np.bincount(cell, counts.ravel()) / np.bincount(cell, fair.ravel())
    return np.asarray(use.reshape(_CELLS, _CELLS))


def figures_of(exemplar: Image, result: Image, match: Correspondence, generators: np.ndarray) -> dict[str, float]:
    """All figures but the time."""
    lines = metrics(exemplar, result, MetricsParams(), match).table["measures"]
    lattice = generators if len(generators) == 2 else None
    regular = regularity(exemplar, result, RegularityParams(), lattice).table["summary"]["regularity"]
    use, exempt = (use_of_cells(match, one) for one in (np.zeros((0, 2)), generators))
    return {
        "swd": lines["patches"]["value"],
        "coherence": lines["coherence"]["value"],
        "complete": lines["completeness"]["value"],
        "regular": np.nan if regular is None else regular,
        "repeat": lines["repetition"]["value"],
        "copies": lines["copies"]["value"],
        "contents": lines["contents"]["value"],
        "in bounds": _share_in_bounds(use),
        "exempt": _share_in_bounds(exempt),
        "spread": float(use.std()),
        "rim": float(np.concatenate([use[[0, -1]].ravel(), use[1:-1, [0, -1]].ravel()]).mean()),
    }


def _share_in_bounds(use: np.ndarray) -> float:
    return float(((use >= _BOUNDS[0]) & (use <= _BOUNDS[1])).mean())


def run(interpreter: str, crop: Path, picture: Path, seed: int, preset: str) -> dict[str, float]:
    """Make the picture and measure it."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["run", "self_tuning", str(crop), "--size", str(_SIZE), "--seed", str(seed), "--preset", preset]
        places = ["--store", folder, "--out", str(picture), "--force", "--json"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [interpreter, "-P", "-m", "texloom", *words, *places]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{crop.name}: exit code {done.returncode}\n{done.stderr}")
        steps = {step["name"]: step for step in json.loads(done.stdout)["steps"]}
        texture = _load(Path(folder), steps["texture"], Optimised, ("image", "match"))
        generators = _load(Path(folder), steps["lattice"], LatticeSelection, ("generators",))["generators"]
        exemplar = _load(Path(folder), steps["tone"], Tone, ("image",))["image"]
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**figures_of(exemplar, texture["image"], texture["match"], generators), "CPU s": seconds}


def _load(store: Path, step: Mapping[str, Any], kind: type[Any], names: Sequence[str]) -> dict[str, Any]:
    opened = Store(store)
    artifact = opened.find(step["stage"], step["key"])
    assert artifact is not None
    return opened.load(artifact, kind, names)


def mean_of(figures: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The means of several runs, of their times the median; NaN where none has a figure."""
    means = {}
    for name in FIGURES:
        known = [one[name] for one in figures if not np.isnan(one[name])]
        means[name] = float(np.median(known) if name == "CPU s" else np.mean(known)) if known else np.nan
    return means


def line(label: str, means: Mapping[str, float]) -> str:
    """A row of the table."""
    shown = ("-" if np.isnan(means[name]) else f"{means[name]:.4f}" for name in FIGURES)
    return f"{label:32}" + "".join(f"{text:>11}" for text in shown)


def main() -> None:
    """Read the options; make, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--against", metavar="PYTHON", help="interpreter of another environment to compare with")
    parser.add_argument("--half", type=int, choices=(0, 1), help="six of the twelve (default: all)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--preset", default="default")
    parser.add_argument("--textures", type=Path, default=os.environ.get("TEXLOOM_TEXTURES"), help="their folder")
    parser.add_argument("--keep", type=Path, help="folder where crops and results stay")
    options = parser.parse_args()
    if options.textures is None:
        parser.error("name the folder of the pictures by --textures or TEXLOOM_TEXTURES")
    programs = {"before": options.against} if options.against else {}
    programs["now"] = sys.executable
    chosen = [crop for number, crop in enumerate(CROPS) if options.half in (None, number % 2)]
    total: dict[str, list[dict[str, float]]] = {name: [] for name in programs}
    print(f"{'':32}" + "".join(f"{name:>11}" for name in FIGURES))
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for file, left, top in chosen:
            crop = folder / f"{Path(file).stem}.png"
            write_crop(options.textures / file, left, top, crop)
            for name, interpreter in programs.items():
                made = []
                for seed in options.seeds:
                    picture = folder / f"{crop.stem}_{seed}_{name}.png"
                    made.append(run(interpreter, crop, picture, seed, options.preset))
                total[name].append(mean_of(made))
                print(line(f"{crop.stem[:24]} {name}", total[name][-1]), flush=True)
    for name, means in total.items():
        print(line(f"all {name}", mean_of(means)))


def write_crop(picture: Path, left: int, top: int, file: Path) -> None:
    """Write the crop of a picture as PNG."""
    from PIL import Image as Pillow

    with Pillow.open(picture) as opened:
        opened.convert("RGB").crop((left, top, left + _SIDE, top + _SIDE)).save(file)


if __name__ == "__main__":
    main()
