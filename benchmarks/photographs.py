"""How long photographs take: the analysis of a region, synthesis from it, and how true the result is.

    python -m benchmarks.photographs --side 1000 --size 512

prints wall clock and processor seconds of every step, of the second of two runs (the first compiles), on all
threads that TEXLOOM_THREADS allows, and the most memory held; then, for rendered photographs whose textures are
known, what the measures say of the flat textures beside the true ones. Of the processor seconds those of the system
are told apart: it takes them to give out memory.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.photographs import analysed, made, repeating, surfaces
from texloom.stages.analysis.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.analysis.gaussian_stack import GaussianStackParams, gaussian_stack
from texloom.stages.analysis.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.arrays import Image
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.synthesis.per_pixel import PerPixelParams, per_pixel


def seconds() -> np.ndarray:
    """Of the wall clock, of the processors, and of those the system's."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return np.array([time.perf_counter(), used.ru_utime + used.ru_stime, used.ru_stime])


def told(spent: np.ndarray) -> str:
    """As a part of a line."""
    return f"{spent[0]:7.2f} s wall clock {spent[1]:7.2f} s of processors, {spent[2]:.2f} of them the system's"


def timed(name: str, function: Callable[[], Any], shown: bool, total: np.ndarray) -> Any:
    """The result; `seconds` are added to ``total``."""
    before = seconds()
    found = function()
    spent = seconds() - before
    total += spent
    if shown:
        print(f"{name:24} {told(spent)}", flush=True)
    return found


def photograph(side: int) -> Image:
    """Coloured noise, as fine as a photograph may be."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(1).random((side, side, 3))
    return Image(np.clip(4 * gaussian_filter(noise, (1.5, 1.5, 0)) - 1.5, 0, 1).astype(np.float32), ("R", "G", "B"))


def run(photo: Image, geometry: Path, size: int, shown: bool) -> None:
    """Analyse and synthesise once."""
    analysis, synthesis = np.zeros(3), np.zeros(3)
    surface = timed(
        "jacobian_field",
        lambda: jacobian_field(photo, JacobianFieldParams(geometry=geometry)),
        shown,
        analysis,
    )
    levels = timed(
        "gaussian_stack",
        lambda: gaussian_stack(
            photo, surface.jacobian, surface.level, surface.region, GaussianStackParams(even=0.8)
        ),
        shown,
        analysis,
    )
    timed("what repeats", lambda: repeating(levels), shown, analysis)
    look = timed(
        "appearance_stack",
        lambda: appearance_stack(
            levels.image,
            AppearanceStackParams(),
            jacobian=levels.jacobian,
            stack=levels.stack,
            valid=levels.valid,
            known=levels.known,
        ),
        shown,
        analysis,
    )
    timed(
        "per_pixel",
        lambda: per_pixel(
            levels.image,
            look.appearance,
            look.basis,
            look.candidates,
            look.toroidal,
            PerPixelParams(size=(size, size)),
            np.random.default_rng(1),
            jacobian=levels.jacobian,
        ),
        False,
        synthesis,
    )
    if shown:
        pixels = np.count_nonzero(surface.region)
        print(f"{pixels / 1e6:.2f} Mpx in {len(levels.stack)} levels; wanted on 2 cores: 10 s and 3 s")
        print(f"{'analysis':24} {told(analysis)}")
        print(f"{f'synthesis of {size}x{size} px':24} {told(synthesis)}")
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"at most {most / 1024:.0f} MB")


def truth(folder: Path) -> None:
    """Rendered photographs of a plane and a column, flattened."""
    from tests.flows import test_from_photographs as known
    from texloom.stages.evaluation.metrics import MetricsParams, metrics

    photo, patch = known.column(known.stripes)
    cases: list[tuple[str, known.Pattern, Image, dict[str, Any]]] = [
        ("stripes, column", known.stripes, photo, {"patches": [patch]})
    ]
    plane: dict[str, Any] = {"patches": [{"corners": known.PLANE, "size": [2, 1]}], "region": [known.REGION]}
    for name, flat_one in (("stripes, plane", known.stripes), ("checkerboard, plane", known.checkers)):
        cases.append((name, flat_one, known.plane(flat_one), plane))
    for name, pattern, photo, content in cases:
        surface = surfaces(photo, folder, **content)
        levels, look = analysed(photo, surface)
        flat = made(levels, look, size=(known.SIDE, known.SIDE), inputs=repeating(levels)).image
        true = known.true_texture(pattern, surface.scale)
        borders = [
            float(np.mean(lines[1:] != lines[:-1]))
            for lines in (flat.color[..., 0] > 0.5, true.color[..., 0] > 0.5)
        ]
        summary = metrics(true, flat, MetricsParams()).table["summary"]
        print(
            f"{name:24} borders by true ones {borders[0] / borders[1]:.3f}, scores {json.dumps(summary)}",
            flush=True,
        )


def main() -> None:
    """Time and judge."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=1000, help="px of the photograph")
    parser.add_argument("--size", type=int, default=512, help="px of the texture")
    given = parser.parse_args()
    side = given.side
    print(f"{thread_count()} threads, photograph of {side}x{side} px")
    with tempfile.TemporaryDirectory() as folder:
        geometry = Path(folder) / "geometry.json"
        corners = [[0, 0.3 * side], [0, 0.7 * side], [side - 1, side], [side - 1, 0]]
        region = [[0, 0], [0, side - 1], [side - 1, side - 1], [side - 1, 0]]
        patch = {"corners": corners, "size": [1, 1], "beyond": 0.2}
        geometry.write_text(json.dumps({"patches": [patch], "region": [region]}))
        photo = photograph(side)
        for shown in (False, True):
            run(photo, geometry, given.size, shown)
        truth(Path(folder))


if __name__ == "__main__":
    main()
