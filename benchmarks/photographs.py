"""Times and accuracy of synthesis from photographs: analysis of a region, and synthesis from it.

    python -m benchmarks.photographs --side 1000 --size 512

prints wall time and CPU time of every step in the second of two runs (the first compiles), on all threads that
TEXLOOM_THREADS allows, and the peak memory; then the measures of flat textures from rendered photographs whose
textures are known. System time, mostly of memory allocation, is listed separately.
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
    """Wall time, CPU time, and the system's part of it."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return np.array([time.perf_counter(), used.ru_utime + used.ru_stime, used.ru_stime])


def formatted(spent: np.ndarray) -> str:
    """`seconds` as text."""
    return f"{spent[0]:7.2f} s wall time {spent[1]:7.2f} s CPU time, {spent[2]:.2f} s of it system time"


def timed(name: str, function: Callable[[], Any], shown: bool, total: np.ndarray) -> Any:
    """Call ``function`` and add its `seconds` to ``total``."""
    before = seconds()
    result = function()
    spent = seconds() - before
    total += spent
    if shown:
        print(f"{name:24} {formatted(spent)}", flush=True)
    return result


def photograph(side: int) -> Image:
    """Coloured noise with the detail of a sharp photograph."""
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
    timed("repetition", lambda: repeating(levels), shown, analysis)
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
        print(f"{pixels / 1e6:.2f} Mpx in {len(levels.stack)} levels; target on 2 cores: 10 s and 3 s")
        print(f"{'analysis':24} {formatted(analysis)}")
        print(f"{f'synthesis of {size}x{size} px':24} {formatted(synthesis)}")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"peak memory {peak / 1024:.0f} MB")


def truth(folder: Path) -> None:
    """Print the measures of textures from rendered photographs of a plane and a column."""
    from tests.flows import test_from_photographs as known
    from texloom.stages.evaluation.metrics import MetricsParams, metrics

    photo, patch = known.column(known.stripes)
    cases: list[tuple[str, known.Pattern, Image, dict[str, Any]]] = [
        ("stripes, column", known.stripes, photo, {"patches": [patch]})
    ]
    plane: dict[str, Any] = {"patches": [{"corners": known.PLANE, "size": [2, 1]}], "region": [known.REGION]}
    for name, flat_pattern in (("stripes, plane", known.stripes), ("checkerboard, plane", known.checkers)):
        cases.append((name, flat_pattern, known.plane(flat_pattern), plane))
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
            f"{name:24} border length to the true one {borders[0] / borders[1]:.3f}, scores {json.dumps(summary)}",
            flush=True,
        )


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=1000, help="px of the photograph")
    parser.add_argument("--size", type=int, default=512, help="px of the texture")
    options = parser.parse_args()
    side = options.side
    print(f"{thread_count()} threads, photograph of {side}x{side} px")
    with tempfile.TemporaryDirectory() as folder:
        geometry = Path(folder) / "geometry.json"
        corners = [[0, 0.3 * side], [0, 0.7 * side], [side - 1, side], [side - 1, 0]]
        region = [[0, 0], [0, side - 1], [side - 1, side - 1], [side - 1, 0]]
        patch = {"corners": corners, "size": [1, 1], "beyond": 0.2}
        geometry.write_text(json.dumps({"patches": [patch], "region": [region]}))
        photo = photograph(side)
        for shown in (False, True):
            run(photo, geometry, options.size, shown)
        truth(Path(folder))


if __name__ == "__main__":
    main()
