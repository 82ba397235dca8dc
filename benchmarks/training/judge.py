"""Accuracy of contour detectors on held-out procedural textures.

    python -m benchmarks.training.judge                        the model that ships
    python -m benchmarks.training.judge --model try.yml.gz --pictures 20

Textures are from the generator of the training set with other random numbers. F by tolerance in pixels: ODS at the
best threshold for all textures, OIS at the best of each, Otsu at the threshold used by the flows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from benchmarks.training.boundaries import THRESHOLDS, Counts, count, ods, ois, thinned
from benchmarks.training.pictures import Picture, picture_of
from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.numerics.threshold import otsu_threshold
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.color import linear_from_srgb

TOLERANCES = (1.0, 2.0, 3.0)
"""px"""
SCALES = (1, 2, 4)
"""factors by which textures are reduced"""


def _grey(color: np.ndarray, blur: float) -> ScalarMap:
    import cv2

    return np.asarray(cv2.GaussianBlur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), blur))


def _stage(params: EdgesParams, color: np.ndarray) -> ScalarMap:
    linear = np.asarray(linear_from_srgb(color.astype(np.float32) / 255), np.float32)
    return edges(Image(linear, ("R", "G", "B")), params).strength


def _filtered(kind: str, color: np.ndarray) -> ScalarMap:
    """Filters of OpenCV on grey values, blurred like the finer scale of `gradient`."""
    import cv2

    grey = _grey(color, 1.5)
    if kind == "laplacian":
        return np.asarray(np.abs(cv2.Laplacian(grey, cv2.CV_32F)))
    operator: Any = {"sobel": cv2.Sobel, "scharr": cv2.Scharr}[kind]
    return np.asarray(np.hypot(operator(grey, cv2.CV_32F, 0, 1), operator(grey, cv2.CV_32F, 1, 0)))


def detectors(model: Path | None) -> Mapping[str, Callable[[np.ndarray], ScalarMap]]:
    """The detectors by name, without Canny, which has no strength."""
    return {
        "structured": partial(_stage, EdgesParams(detector="structured", model=model)),
        "gradient": partial(_stage, EdgesParams(detector="gradient")),
        **{name: partial(_filtered, name) for name in ("sobel", "scharr", "laplacian")},
    }


def _maps(strength: ScalarMap) -> tuple[list[Bool[np.ndarray, "h w"]], Bool[np.ndarray, "h w"]]:
    """Thinned contours at shares of the picture's largest strength, and at Otsu's threshold."""
    strength = np.asarray(strength / max(float(strength.max()), 1e-9), np.float32)
    thin = thinned(strength)
    levels = (np.arange(THRESHOLDS) + 0.5) / THRESHOLDS
    return [thin > level for level in levels], thin > otsu_threshold(strength)


def _canny(color: np.ndarray) -> list[Bool[np.ndarray, "h w"]]:
    import cv2

    grey = np.rint(_grey(color, 1.5)).astype(np.uint8)
    return [cv2.Canny(grey, 0.4 * high, high, L2gradient=True) > 0 for high in np.geomspace(8, 800, THRESHOLDS)]


def reduced(picture: Picture, factor: int) -> Picture:
    """The picture reduced by ``factor``, with thinned contours."""
    import cv2

    if factor == 1:
        return picture
    side = picture.color.shape[0] // factor
    color = cv2.resize(picture.color, (side, side), interpolation=cv2.INTER_AREA)
    contours = picture.contours.reshape(side, factor, side, factor).any(axis=(1, 3))
    return Picture(color, _thin(contours), picture.kind)


def _thin(contours: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    from skimage.morphology import skeletonize

    return np.asarray(skeletonize(contours), bool)


Scores = dict[tuple[str, int, float], tuple[Counts, Counts | None]]


def judge_picture(number: int, model: Path | None, side: int, seed: int) -> Scores:
    """Counts of every detector, scale and tolerance on one held-out texture: at all thresholds, and at Otsu's."""
    import cv2

    cv2.setNumThreads(1)
    original = picture_of("judge", number, side, seed)
    scores: Scores = {}
    for times in SCALES:
        picture = reduced(original, times)
        for name, detect in detectors(model).items():
            maps, chosen = _maps(detect(picture.color))
            pairs = zip(*(count(binary, picture.contours, TOLERANCES) for binary in (maps, [chosen])), strict=True)
            scores |= {(name, times, t): pair for t, pair in zip(TOLERANCES, pairs, strict=True)}
        counts = count(_canny(picture.color), picture.contours, TOLERANCES)
        scores |= {("canny", times, t): (figures, None) for t, figures in zip(TOLERANCES, counts, strict=True)}
    return scores


def table(judged: list[Scores]) -> str:
    """A line for each detector: ODS, OIS and F at Otsu's threshold for all scales and tolerances."""
    names = list(dict.fromkeys(name for name, _, _ in judged[0]))
    lines = ["| detector | resolution | " + " | ".join(f"ODS {t:.0f} px | OIS {t:.0f} px | Otsu {t:.0f} px" for t in TOLERANCES) + " |"]  # fmt: skip # noqa: E501
    lines.append("|---|---|" + "---|" * (3 * len(TOLERANCES)))
    for times in SCALES:
        for name in names:
            cells = []
            for tolerance in TOLERANCES:
                pairs = [scores[name, times, tolerance] for scores in judged]
                cells += [f"{measure([counts for counts, _ in pairs]):.3f}" for measure in (ods, ois)]
                at_otsu = [counts for _, counts in pairs if counts is not None]
                cells.append(f"{ods(at_otsu):.3f}" if at_otsu else "-")
            lines.append(f"| {name} | 1/{times} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, default=None)
    parser.add_argument("--pictures", type=int, default=60)
    parser.add_argument("--side", type=int, default=384)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    job = partial(judge_picture, model=options.model, side=options.side, seed=options.seed)
    with ProcessPoolExecutor(options.processes) as pool:
        judged = list(pool.map(job, range(options.pictures)))
    print(table(judged))


if __name__ == "__main__":
    main()
