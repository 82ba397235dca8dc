"""How close maps estimated from colour are to true ones, beside luminance taken for height.

    python -m benchmarks.estimated_maps FOLDER

FOLDER, or the environment variable TEXLOOM_MATERIALS, holds material sets with albedo, height and normals, a folder
each. Printed are, for each set:

- the correlation of heights. Waves longer than an eighth of the side are removed from both before, softly, by a
  Gaussian: a picture of a level surface does not tell whether its left half lies lower. The mean and the factor of
  heights in files are arbitrary too, and do not count in a correlation.
- the mean angle between normals, after the slopes are scaled to the root mean square of the true ones, as the depth
  is arbitrary too. Normals all straight up are named beside: normals that are right nowhere are worse than these.

A height map that is white where the surface is low, by its normals, is inverted, as is green that points down.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from texloom.pipelines.media.plausibility import plausible_green
from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.relief.height_from_colour import HeightFromColourParams, height_from_colour
from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.analysis.structure.otsu import OtsuParams, otsu
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL

_LONGEST = 8  # waves in the picture's side below which they do not count
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def without_slow(plane: np.ndarray) -> np.ndarray:
    """Less its Gaussian mean, which keeps half of a wave that fits `_LONGEST` times into the shorter side."""
    from scipy.ndimage import gaussian_filter

    deviation = np.sqrt(2 * np.log(2)) * min(plane.shape) / (2 * np.pi * _LONGEST)
    return np.asarray(plane - gaussian_filter(plane.astype(np.float64), deviation, mode="wrap"))


def correlation(plane: np.ndarray, true: np.ndarray) -> float:
    """Of heights, see the top of this file."""
    return float(np.corrcoef(without_slow(plane).ravel(), without_slow(true).ravel())[0, 1])


def mean_angle(plane: np.ndarray, true: np.ndarray) -> float:
    """Degrees between the normals of heights and (h, w, 3) true ones, see the top of this file."""
    down, across = np.gradient(plane.astype(np.float64))
    steepness = np.square(true[..., :2] / np.maximum(true[..., 2:], 0.1)).sum(axis=2).mean()
    factor = np.sqrt(steepness / max(float((down**2 + across**2).mean()), 1e-20))
    made = np.stack([-factor * across, factor * down, np.ones_like(down)], axis=2)
    cosine = (made * true).sum(axis=2) / np.linalg.norm(made, axis=2) / np.linalg.norm(true, axis=2)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def truth(material: Image) -> tuple[np.ndarray, np.ndarray]:
    """Heights and normals of a set, high is bright and green points up."""
    height = material.pixels[..., material.channels.index("height")]
    normal = material.pixels[..., [material.channels.index(name) for name in NORMAL]].astype(np.float64)
    found = plausible_green(material) or {}
    if found.get("height") == "depth":
        height = 1 - height
    if found.get("green") == "down" and material.facts.of_map("normal").green != "down":
        normal = normal * [1, -1, 1]
    return height, normal


def main() -> None:
    """Read the option and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=os.environ.get("TEXLOOM_MATERIALS"))
    folder = parser.parse_args().folder
    if folder is None:
        parser.error("name a folder of material sets, or set TEXLOOM_MATERIALS")
    print(f"{'':20} correlation of heights       mean angle of normals, degrees")
    print(f"{'':20} luminance estimated better   luminance estimated straight up")
    rows = []
    for path in sorted(path for path in Path(folder).iterdir() if path.is_dir()):
        material = open_source("material", str(path)).read()
        if not {"height", *NORMAL} <= set(material.channels):
            continue
        height, normal = truth(material)
        colors = Image(np.ascontiguousarray(material.color), ("R", "G", "B"))
        structure = otsu(edges(colors, EdgesParams()).strength, OtsuParams(), image=colors).structure
        made = height_from_colour(colors, HeightFromColourParams(), structure=structure).image.pixels[..., -1]
        luminance = colors.pixels @ _LUMINANCE
        found = [correlation(plane, height) for plane in (luminance, made)]
        angles = [mean_angle(plane, normal) for plane in (luminance, made, np.zeros_like(made))]
        rows.append((*found, found[1] > found[0], *angles))
        print(f"{path.name:20} {_shown(rows[-1])}", flush=True)
    print(f"{'mean':20} {_shown(tuple(np.mean(rows, axis=0)))}")


def _shown(row: tuple[float, ...]) -> str:
    """A line of the table; of truth values their mean."""
    return "{:9.3f} {:9.3f} {:6.2f} {:11.1f} {:9.1f} {:11.1f}".format(*map(float, row))


if __name__ == "__main__":
    main()
