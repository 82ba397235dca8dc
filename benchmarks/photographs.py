"""Times and accuracy of synthesis from photographs: analysis of a region, and synthesis from it.

    python -m benchmarks.photographs --side 1000 --size 512

prints wall time and CPU time of every step in the second of two runs (the first compiles), on all threads that
TEXLOOM_THREADS allows, and the peak memory; then how close reduced textures are to means over their pixels, and the
measures of flat textures from rendered photographs whose textures are known. System time, mostly of memory
allocation, is listed separately.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import peak_memory, timed
from tests.photographs import analysed, made, psnr, reduced, repeating, surfaces
from texloom.stages.analysis.photographs.gaussian_stack import GaussianStackParams, gaussian_stack
from texloom.stages.analysis.photographs.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixelParams, flat, per_pixel
from texloom.stages.synthesis.photographs.place_texture import PlaceTextureParams, place_texture
from texloom.stages.vocabulary.arrays import Image


def formatted(seconds: np.ndarray) -> str:
    """Wall time, CPU time and the system's part of it as text."""
    return f"{seconds[0]:7.2f} s wall time {seconds[1]:7.2f} s CPU time, {seconds[2]:.2f} s of it system time"


def photograph(side: int) -> Image:
    """Coloured noise with the detail of a sharp photograph."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(1).random((side, side, 3))
    return Image(np.clip(4 * gaussian_filter(noise, (1.5, 1.5, 0)) - 1.5, 0, 1).astype(np.float32), ("R", "G", "B"))


def run(photo: Image, geometry: Path, size: int, shown: bool) -> None:
    """Analyse and synthesise once; print the times if ``shown``."""
    times: dict[str, np.ndarray] = {}

    def step(name: str, function: Callable[..., Any], *inputs: Any, **options: Any) -> Any:
        seconds, result = timed(partial(function, *inputs, **options))
        times[name] = np.array(seconds)
        return result

    surface = step("jacobian_field", jacobian_field, photo, JacobianFieldParams(geometry=geometry))
    areas = (surface.jacobian, surface.level, surface.region)
    levels = step("gaussian_stack", gaussian_stack, photo, *areas, GaussianStackParams(even=0.8))
    step("repetition", repeating, levels)
    inputs = {name: getattr(levels, name) for name in ("jacobian", "stack", "valid", "known")}
    look = step("appearance_stack", appearance_stack, levels.image, AppearanceStackParams(), **inputs)
    step(
        f"synthesis of {size}x{size} px", per_pixel, levels.image, look.appearance, look.basis, look.candidates,
        look.toroidal, PerPixelParams(size=(size, size)), np.random.default_rng(1), jacobian=levels.jacobian,
    )  # fmt: skip
    if shown:
        *analysis, _ = times.values()
        for name, seconds in {**times, "analysis": np.sum(analysis, axis=0)}.items():
            print(f"{name:24} {formatted(seconds)}")
        pixels = np.count_nonzero(surface.region)
        print(f"{pixels / 1e6:.2f} Mpx in {len(levels.stack)} levels; target on 2 cores: 5 s and 1.5 s")
        print(f"peak memory {peak_memory():.0f} MB", flush=True)


def truth(folder: Path) -> None:
    """Print the measures of textures from rendered photographs of a plane and a column."""
    from tests.flows import test_from_photographs as known
    from texloom.stages.evaluation.metrics import MetricsParams, metrics

    photo, patch = known.column(known.stripes)
    plane: dict[str, Any] = {"patches": [{"corners": known.PLANE, "size": "1x2"}], "region": [known.REGION]}
    cases: list[tuple[str, known.Pattern, Image, dict[str, Any]]] = [
        ("stripes, column", known.stripes, photo, {"patches": [patch]}),
        ("stripes, plane", known.stripes, known.plane(known.stripes), plane),
        ("checkerboard, plane", known.checkers, known.plane(known.checkers), plane),
    ]
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


def footprints() -> None:
    """Print how close reduced textures are to means over their pixels ([Eisenacher2008]_ Figure 13)."""
    import skimage.data

    fine = skimage.data.brick()[:480, :480, None].repeat(3, axis=2)
    exemplar = Image.of(fine)
    for factor in (2, 4, 8):
        shape = (480 // factor, 480 // factor)
        own = ((np.moveaxis(np.indices(shape), 0, 2) + 0.5) * factor - 0.5).astype(np.float32)
        photo = Image(np.zeros((*shape, 3), np.float32), ("R", "G", "B"))
        made = place_texture(
            own, exemplar, flat((480, 480)), flat(shape) / np.float32(factor), photo, np.ones(shape, bool),
            PlaceTextureParams(),
        ).image.pixels  # fmt: skip
        wanted = reduced(exemplar.color, factor)
        contrast = made.std() / wanted.std()
        print(f"1/{factor} of the size: PSNR {psnr(made, wanted):.1f} dB, contrast {contrast:.3f} of the true one")


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
        patch = {"corners": corners, "size": "1x1", "beyond": 0.2}
        geometry.write_text(json.dumps({"patches": [patch], "region": [region]}))
        photo = photograph(side)
        for shown in (False, True):
            run(photo, geometry, options.size, shown)
        footprints()
        truth(Path(folder))


if __name__ == "__main__":
    main()
