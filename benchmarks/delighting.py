"""How close colours are to the true ones after known light was put on them and removed again.

    python -m benchmarks.delighting FOLDER... [--side 512] [--half 0]

Each FOLDER, or the environment variable TEXLOOM_MATERIALS, holds pictures or material sets, of which the albedo is
taken. Printed is the mean CIELAB difference, up to a common factor on linear light, of the lit picture, of what
`delight` makes of it, and of what `tone` makes of that; for each picture and kind of light, and the means by kind.
``none`` is the picture without other light than it has: it must come back as it was.

Shadows leave between a fifth and a half of the light, neutral or bluish; they have penumbra. Results are noisy and
rounded to 8 bits.
"""

from __future__ import annotations

import argparse
import os
import zlib
from collections import defaultdict
from pathlib import Path

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.exemplars.tone import ToneParams, tone
from texloom.stages.analysis.light.delight import DelightParams, delight
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_srgb, srgb_from_linear
from texloom.stages.vocabulary.masks import valid_pixels

KINDS = (
    *("none", "vignette", "gradient", "reflection", "highlight"),
    *("edge", "wide edge", "bars", "blob", "dapple"),
)
_AMBIENT = ((0.3, 0.3, 0.3), (0.22, 0.27, 0.36), (0.5, 0.52, 0.56), (0.33, 0.36, 0.42))  # of sun and sky
_NOISE = 0.004
_FACTORS = (0.8, 0.87, 0.93, 1.0, 1.07, 1.15, 1.25)  # around the ratio of medians


def light(kind: str, shape: tuple[int, int], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """What linear light is multiplied by, and what is added: (h, w, 1 or 3) each."""
    from scipy.ndimage import gaussian_filter

    side = min(shape)
    down, across = np.indices(shape)
    row, column = (2 * (at - length / 2) / side for at, length in zip((down, across), shape, strict=True))
    angle = rng.uniform(0, 2 * np.pi)
    along = np.cos(angle) * column + np.sin(angle) * row
    even, nothing = np.ones((*shape, 1)), np.zeros((*shape, 1))
    center = rng.uniform(-0.5, 0.5, 2)
    near = np.square(row - center[0]) + np.square((column - center[1]) / 1.3)
    if kind == "none":
        return even, nothing
    if kind == "vignette":
        return ((1 + 0.45 * (row**2 + column**2)) ** -2)[..., None], nothing
    if kind == "gradient":
        return np.maximum(0.75 + 0.3 * along, 0.2)[..., None], nothing
    if kind == "reflection":
        return even, 0.3 * np.exp(-near / 0.18)[..., None]
    if kind == "highlight":
        return even, 1.6 * np.exp(-near / 0.03)[..., None]
    penumbra = {"edge": 0.004, "wide edge": 0.02, "bars": 0.006, "blob": 0.01, "dapple": 0.008}[kind]
    if kind in ("edge", "wide edge"):
        dark = along > rng.uniform(-0.3, 0.3)
    elif kind == "bars":
        dark = (np.abs(along + 0.45) < 0.16) | (np.abs(along - 0.4) < 0.1)
    else:
        count, span, radii = (4, 0.6, (0.2, 0.45)) if kind == "blob" else (40, 1.05, (0.07, 0.2))
        spots = np.zeros(shape, bool)
        for _ in range(count):
            (y, x), (one, other), turn = rng.uniform(-span, span, 2), rng.uniform(*radii, 2), rng.uniform(0, np.pi)
            first = (column - x) * np.cos(turn) + (row - y) * np.sin(turn)
            second = (row - y) * np.cos(turn) - (column - x) * np.sin(turn)
            spots |= np.square(first / one) + np.square(second / other) < 1
        dark = spots if kind == "blob" else ~spots
    share = 1 - gaussian_filter(dark.astype(np.float64), max(penumbra * side, 0.3))[..., None]
    ambient = np.array(_AMBIENT[int(rng.integers(len(_AMBIENT)))]) * rng.uniform(0.8, 1.5)
    return ambient + share * (1 - ambient), nothing


def photographed(albedo: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    """The albedo in a light, as a camera gives it."""
    if kind == "none":
        return albedo
    factor, more = light(kind, albedo.shape[:2], rng)
    seen = albedo * factor + more
    seen = seen + rng.normal(0, _NOISE, seen.shape) * np.sqrt(np.maximum(seen, 0.01))
    return np.asarray(linear_from_srgb(np.rint(255 * srgb_from_linear(seen)) / 255), np.float32)


def difference(image: Image, albedo: np.ndarray) -> float:
    """Mean over pixels that are not excluded, see the top of this file."""
    valid = valid_pixels(image)
    counted = np.ones(albedo.shape[:2], bool) if valid is None else valid
    true, color = lab_from_linear(albedo), image.color
    ratio = float(
        np.median(albedo[counted].mean(axis=1)) / max(float(np.median(color[counted].mean(axis=1))), 1e-4)
    )
    tried = [lab_from_linear((color * np.float32(ratio * factor)).astype(np.float32)) for factor in _FACTORS]
    return min(float(np.linalg.norm(lab - true, axis=2)[counted].mean()) for lab in tried)


def albedos(folders: list[Path], side: int) -> list[tuple[str, np.ndarray]]:
    """Linear colours of all pictures and sets, reduced."""
    import cv2

    found = []
    for folder in folders:
        for path in sorted(folder.iterdir()):
            source = open_source("picture", str(path)) if path.is_file() else open_source("material", str(path))
            image = source.read()
            if image.channels[0] != "R":
                continue
            factor = side / max(image.height, image.width)
            color = np.ascontiguousarray(image.color)
            if factor < 1:
                size = round(image.width * factor), round(image.height * factor)
                color = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
            found.append((path.stem, color))
    return found


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--side", type=int, default=512, help="longest side, px")
    parser.add_argument("--half", type=int, choices=(0, 1), help="every other picture only")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    options = parser.parse_args()
    folders = options.folders or [Path(os.environ[name]) for name in ("TEXLOOM_MATERIALS",) if name in os.environ]
    if not folders:
        parser.error("name a folder of pictures or material sets, or set TEXLOOM_MATERIALS")
    rows = defaultdict(list)
    print(f"{'':36} before delight    tone  found")
    for name, albedo in albedos(folders, options.side)[options.half :: 2 if options.half is not None else 1]:
        for kind in options.kinds:
            lit = photographed(albedo, kind, np.random.default_rng(zlib.crc32(f"{name} {kind}".encode())))
            image = Image(lit, ("R", "G", "B"))
            made = delight(image, DelightParams())
            even = tone(made.image, ToneParams(warn=False)).image
            found = [(row["kind"], round(row["confidence"], 2)) for row in made.table["found"] if row["removed"]]
            row = [difference(each, albedo) for each in (image, made.image, even)]
            rows[kind].append((*row, bool(found)))
            print(f"{name[:24]:24} {kind:10} " + "".join(f"{value:8.2f}" for value in row), *found, flush=True)
    print()
    for kind, each in rows.items():
        means = np.mean(each, axis=0)
        worse = sum(row[1] > row[0] + 0.1 for row in each)
        print(
            f"{'mean':24} {kind:10} " + "".join(f"{value:8.2f}" for value in means[:3]),
            f"found in {means[3]:.0%} of {len(each)}, worse in {worse}",
        )


if __name__ == "__main__":
    main()
