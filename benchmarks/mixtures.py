"""Statistics along a mixture of two exemplars: whether those in its middle lie between those of its ends.

    python -m benchmarks.mixtures FIRST.png SECOND.png

runs `mix` from the one to the other, with and without gradual statistics, and prints of ten strips across the
gradient: mean lightness and its deviation, the deviation of its finest and of its coarsest band, all CIELAB units,
and the distances of all histograms of bands and colours (Wasserstein, mean over planes) to those of the first and
of the last strip. Below, the share of steps along which each changes in the direction from end to end, weighted by
their size: 1 where it is monotone, and the distances' balance in the middle: 0.5 where it lies halfway.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

import texloom
from texloom.pipelines.media.sources import open_source
from texloom.stages.synthesis.remix.colour_statistics import Statistics
from texloom.stages.vocabulary.color import lab_from_linear

STRIPS = 10
SIDE = 512
"""px, to which larger exemplars are reduced"""


def distance(one: Statistics, other: Statistics) -> float:
    """Mean difference of quantiles, over all planes of bands and turned colours, CIELAB units."""
    pairs = zip((*one.bands, *one.colors), (*other.bands, *other.colors), strict=True)
    return float(
        np.mean([np.abs(a - b).mean() for first, second in pairs for a, b in zip(first, second, strict=True)])
    )


def measured(lab: np.ndarray) -> np.ndarray:
    """(STRIPS, 6): what is printed, of strips from left to right."""
    parts = np.array_split(lab, STRIPS, axis=1)
    found = [Statistics.of(np.ascontiguousarray(part), np.ones(part.shape[:2], bool)) for part in parts]
    rows = [
        [part[..., 0].mean(), part[..., 0].std(), own.bands[0][0].std(), own.bands[-1][0].std(),
         distance(own, found[0]), distance(own, found[-1])]
        for part, own in zip(parts, found, strict=True)
    ]  # fmt: skip
    return np.array(rows)


def line(row: np.ndarray) -> str:
    """Six values below their names."""
    return "".join(f"{value:{width}.2f}" for value, width in zip(row, (11, 11, 8, 10, 10, 9), strict=True))


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("exemplars", nargs=2, type=Path)
    parser.add_argument("--size", default="1024x256")
    asked = parser.parse_args()
    for gradual in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            pictures = Path(folder) / "exemplars"
            pictures.mkdir()
            for number, path in enumerate(asked.exemplars, 1):
                pixels = cv2.imread(str(path))
                if pixels is None:
                    parser.error(f"{path}: no picture")
                factor = min(1.0, SIDE / max(pixels.shape))
                smaller = cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
                cv2.imwrite(str(pictures / f"{number}.png"), smaller)
            texloom.run(
                "mix", {"exemplars": f"{pictures}/*"}, out=Path(folder) / "out",
                params={"size": asked.size, "gradual": gradual}, store=Path(folder) / "store",
            )  # fmt: skip
            table = measured(lab_from_linear(open_source("texture", f"{folder}/out/texture.exr").read().color))
        print("gradual" if gradual else "patches of either")
        print("strip  lightness  deviation  finest  coarsest  to first  to last")
        for number, row in enumerate(table):
            print(f"{number:5d}" + line(row))
        steps = np.diff(table, axis=0)
        along = np.where(table[-1] >= table[0], 1, -1) * steps
        shares = np.maximum(along, 0).sum(axis=0) / np.maximum(np.abs(along).sum(axis=0), 1e-9)
        print("share" + line(shares))
        middle = table[STRIPS // 2 - 1 : STRIPS // 2 + 1, 4:].mean(axis=0)
        print(f"balance in the middle: {middle[0] / middle.sum():.2f}\n")


if __name__ == "__main__":
    main()
