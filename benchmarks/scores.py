"""How well each measure detects known faults: the area under the ROC curve.

    TEXLOOM_TEXTURES=folder python -m benchmarks.scores                    all pictures of it and its subfolders
    TEXLOOM_TEXTURES=folder python -m benchmarks.scores --half 1           every other one, as for design and test
    TEXLOOM_TEXTURES=folder python -m benchmarks.scores --weak quilting per_pixel
    TEXLOOM_TEXTURES=folder python -m benchmarks.scores --results made         results are kept in the folder `made`

Every exemplar is reduced to 256 px and synthesised to 384x384 by `self_tuning`. These results count as good; those
that are not, by eye, are named by ``--exclude``. Faults are put into each: shifted rows, kinks, waves, steps of
tone, merged cells, random blocks, cells of two tones, dead ends, lighter pieces, a piece that returns, blur, a
collapse to one piece, and a crop of the exemplar; ``--weak`` adds results of other methods. A figure is the
probability that a faulty result scores worse than a good one, of any exemplars, and after the bar the share of the
exemplars whose faulty result scores worse than their own good one; 0.5 is chance. Both are printed of values and of
scores. Seams are those of crops of periodic results.
"""

from __future__ import annotations

import argparse
import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import texloom
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear

_SIDE = 256  # px, of exemplars
_SIZE = 384  # px, of results
_SMALLER_IS_WORSE = ("sharpness", "continuity")

Sample: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""exemplar and result, sRGB in 0..1, and the source map"""


# -- faults


def shifted_rows(sample: Sample, rng: np.random.Generator) -> Sample:
    """The result below three lines is shifted by 8 to 40 px."""
    exemplar, result, match = (part.copy() for part in sample)
    for third in range(3):
        line = int(len(result) * (third + rng.uniform(0.2, 0.8)) / 3)
        shift = int(rng.integers(8, 40))
        result[line:], match[line:] = np.roll(result[line:], shift, 1), np.roll(match[line:], shift, 1)
    return exemplar, result, match


def kinks(sample: Sample, rng: np.random.Generator) -> Sample:
    """Columns of 40 to 90 px are shifted by 3 to 5 px."""
    exemplar, result, match = (part.copy() for part in sample)
    start = 0
    while start < result.shape[1]:
        columns = np.s_[:, start : start + int(rng.integers(40, 90))]
        shift = int(rng.choice([-5, -4, -3, 3, 4, 5]))
        result[columns], match[columns] = np.roll(result[columns], shift, 0), np.roll(match[columns], shift, 0)
        start = columns[1].stop
    return exemplar, result, match


def waves(sample: Sample, rng: np.random.Generator) -> Sample:
    """Lines waver by 4 to 7 px."""
    import cv2

    exemplar, result, match = sample
    height, width = result.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    period, amplitude = rng.uniform(60, 110), rng.uniform(4, 7)
    down = (rows + amplitude * np.sin(2 * np.pi * columns / period)).astype(np.float32)
    right = (columns + amplitude * np.sin(2 * np.pi * rows / period)).astype(np.float32)
    # in double precision, OpenCV 5.0 leaves black what comes from beyond the border
    bent = cv2.remap(result.astype(np.float32), right, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    nearest = (np.clip(np.rint(down), 0, height - 1).astype(int), np.clip(np.rint(right), 0, width - 1).astype(int))
    return exemplar, bent, match[nearest]


def tone_steps(sample: Sample, rng: np.random.Generator) -> Sample:
    """The exemplar's light drifts by a quarter to a half, and the result ignores it."""
    exemplar, result, match = sample
    height, width = exemplar.shape[:2]
    rows, columns = np.mgrid[:height, :width] / np.array([height, width])[:, None, None] - 0.5
    turn = rng.uniform(0, 2 * np.pi)
    gain = np.exp((np.cos(turn) * rows + np.sin(turn) * columns) * rng.uniform(0.25, 0.5))[..., None]
    return np.clip(exemplar * gain, 0, 1), np.clip(result * gain[match[..., 0], match[..., 1]], 0, 1), match


def merged_cells(sample: Sample, rng: np.random.Generator, count: int = 14) -> Sample | None:
    """Some gaps between cells are filled with pixels beside them; None where there is room for less than five."""
    import cv2
    from skimage.filters import threshold_otsu

    exemplar, result, match = (part.copy() for part in sample)
    grey = cv2.GaussianBlur(result.mean(axis=2).astype(np.float32), (0, 0), 1)
    gap = grey < threshold_otsu(grey)
    gap = gap if gap.mean() < 0.5 else ~gap
    thickness = cv2.distanceTransform(gap.astype(np.uint8), cv2.DIST_L2, 5)
    places = np.argwhere(gap & (thickness >= 1))
    done = 0
    for row, column in rng.permutation(places)[:4000]:
        radius = int(np.clip(2.5 * thickness[row, column] + 5, 6, 14))
        near = [
            (int(row + length * np.sin(turn)), int(column + length * np.cos(turn)))
            for turn in rng.permutation(16) * np.pi / 8
            for length in (radius + 4, radius + 8, radius + 12)
        ]
        boxes = [np.s_[i - radius : i + radius + 1, j - radius : j + radius + 1] for i, j in near]
        limit = radius + 26
        if not (limit < row < len(result) - limit and limit < column < result.shape[1] - limit):
            continue
        shares = [float(gap[box].mean()) for box in boxes]
        best = int(np.argmin(shares))
        if shares[best] > 0.15:
            continue
        here = np.s_[row - radius : row + radius + 1, column - radius : column + radius + 1]
        distance = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1])
        weight = np.clip((radius - distance) / 2.5, 0, 1)[..., None]
        result[here] = result[here] * (1 - weight) + result[boxes[best]].copy() * weight
        match[here] = np.where(weight > 0.5, match[boxes[best]], match[here])
        done += 1
        if done == count:
            break
    return (exemplar, result, match) if done >= 5 else None


def random_blocks(sample: Sample, rng: np.random.Generator, side: int | None = None) -> Sample:
    """Blocks of ``side`` or 32 to 64 px from anywhere."""
    exemplar, result, match = sample
    side = side or int(rng.integers(32, 64))
    match = np.zeros_like(match)
    for row in range(0, len(result), side):
        for column in range(0, result.shape[1], side):
            corner = [int(rng.integers(0, extent - side)) for extent in exemplar.shape[:2]]
            block = match[row : row + side, column : column + side]
            grid = np.mgrid[corner[0] : corner[0] + side, corner[1] : corner[1] + side].transpose(1, 2, 0)
            block[...] = grid[: block.shape[0], : block.shape[1]]
    return exemplar, exemplar[match[..., 0], match[..., 1]], match


def _pasted(part: Sample, place: tuple[int, int], source: tuple[int, int], weight: np.ndarray) -> None:
    """Show in a square of a result, about ``place``, what is about ``source``, by a weight in 0..1."""
    exemplar, result, match = part
    reach = len(weight) // 2
    here, there = (np.s_[i - reach : i + reach + 1, j - reach : j + reach + 1] for i, j in (place, source))
    result[here] = result[here] * (1 - weight[..., None]) + exemplar[there] * weight[..., None]
    around = np.mgrid[-reach : reach + 1, -reach : reach + 1].transpose(1, 2, 0) + source
    match[here] = np.where(weight[..., None] > 0.5, around, match[here])


def _apart(rng: np.random.Generator, places: np.ndarray, margin: int, limits: tuple[int, ...], count: int) -> list:
    """Some random places that are ``2 * margin`` px from each other and ``margin`` from the border."""
    chosen: list[tuple[int, int]] = []
    for row, column in rng.permutation(places)[:4000].tolist():
        inside = margin < row < limits[0] - margin and margin < column < limits[1] - margin
        if inside and all(max(abs(row - one), abs(column - other)) > 2 * margin for one, other in chosen):
            chosen.append((row, column))
        if len(chosen) == count:
            break
    return chosen


def _disc(reach: int) -> np.ndarray:
    return np.asarray(np.clip((reach - np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])) / 3, 0, 1))


def repeated(sample: Sample, rng: np.random.Generator) -> Sample:
    """The piece of most contrast, a sixth of the exemplar's side, is shown eight more times."""
    import cv2

    exemplar, result, match = (part.copy() for part in sample)
    reach = min(exemplar.shape[:2]) // 12
    grey = exemplar.mean(axis=2)
    contrast = cv2.blur((grey - grey.mean()) ** 2, (2 * reach + 1, 2 * reach + 1))[reach:-reach, reach:-reach]
    row, column = np.unravel_index(int(contrast.argmax()), contrast.shape)
    for place in _apart(rng, np.argwhere(np.ones(result.shape[:2], bool)), reach, result.shape, 8):
        _pasted((exemplar, result, match), place, (int(row) + reach, int(column) + reach), _disc(reach))
    return exemplar, result, match


def two_tones(sample: Sample, rng: np.random.Generator) -> Sample:
    """Sixteen half-discs show a part of the exemplar of another tone."""
    import cv2

    exemplar, result, match = (part.copy() for part in sample)
    reach = min(exemplar.shape[:2]) // 12
    tone = cv2.GaussianBlur(exemplar.mean(axis=2), (0, 0), 6)
    inside = np.argwhere(np.ones(np.array(tone.shape) - 2 * reach, bool)) + reach
    for place in _apart(rng, np.argwhere(np.ones(result.shape[:2], bool)), reach, result.shape, 16):
        tried = rng.permutation(inside)[:40]
        other = tried[np.abs(tone[tuple(tried.T)] - tone[tuple(match[place])]).argmax()]
        turn = rng.uniform(0, 2 * np.pi)
        down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        half = (np.hypot(down, right) <= reach) & (down * np.cos(turn) + right * np.sin(turn) > 0)
        _pasted((exemplar, result, match), place, (int(other[0]), int(other[1])), half.astype(float))
    return exemplar, result, match


def dead_ends(sample: Sample, rng: np.random.Generator) -> Sample:
    """Forty contours are cut by discs of the tone beside them, from the exemplar's smoothest places."""
    import cv2

    exemplar, result, match = (part.copy() for part in sample)
    reach, (tone, own) = 7, (cv2.GaussianBlur(one.mean(axis=2), (0, 0), 1.5) for one in (result, exemplar))
    edges, rough = (np.hypot(cv2.Sobel(one, -1, 1, 0), cv2.Sobel(one, -1, 0, 1)) for one in (tone, own))
    rough = cv2.blur(rough, (17, 17))[reach:-reach, reach:-reach]
    smooth = np.argwhere(rough <= np.quantile(rough, 0.1)) + reach
    for row, column in _apart(rng, np.argwhere(edges >= np.quantile(edges, 0.9)), 12, result.shape, 40):
        beside = np.array(
            [tone[row + 6, column], tone[row - 6, column], tone[row, column + 6], tone[row, column - 6]]
        )
        tried = rng.permutation(smooth)[:200]
        best = tried[np.abs(own[tuple(tried.T)][:, None] - beside).min(axis=1).argmin()]
        _pasted((exemplar, result, match), (row, column), (int(best[0]), int(best[1])), _disc(reach))
    return exemplar, result, match


def lighter_pieces(sample: Sample, rng: np.random.Generator) -> Sample:
    """Ten rectangles are lighter or darker by a sixth."""
    exemplar, result, match = (part.copy() for part in sample)
    for _ in range(10):
        height, width = rng.integers(50, 110, 2)
        row, column = rng.integers(0, len(result) - height), rng.integers(0, result.shape[1] - width)
        result[row : row + height, column : column + width] *= np.exp(rng.choice([-1, 1]) * rng.uniform(0.12, 0.22))
    return exemplar, np.clip(result, 0, 1), match


def blurred(sample: Sample, rng: np.random.Generator) -> Sample:  # noqa: ARG001
    """The result, blurred by 1.2 px."""
    import cv2

    return sample[0], cv2.GaussianBlur(sample[1], (0, 0), 1.2), sample[2]


def collapsed(sample: Sample, rng: np.random.Generator) -> Sample:
    """All of the result comes from a square of a quarter of the exemplar's side."""
    exemplar, _, match = sample
    side = min(exemplar.shape[:2]) // 4
    top, left = (int(rng.integers(0, extent - side)) for extent in exemplar.shape[:2])
    part = random_blocks((exemplar[top : top + side, left : left + side], sample[1], match), rng, side // 2)[2]
    match = part + np.array([top, left])
    return exemplar, exemplar[match[..., 0], match[..., 1]], match


def crop(sample: Sample, rng: np.random.Generator) -> Sample:  # noqa: ARG001
    """The middle of the exemplar."""
    exemplar = sample[0]
    height, width = exemplar.shape[:2]
    match = np.mgrid[height // 16 : height * 15 // 16, width // 16 : width * 15 // 16].transpose(1, 2, 0)
    return exemplar, exemplar[match[..., 0], match[..., 1]], match


FAULTS: dict[str, Callable[[Sample, np.random.Generator], Sample | None]] = {
    "shifted": shifted_rows,
    "kinks": kinks,
    "waves": waves,
    "tone": tone_steps,
    "merged": merged_cells,
    "blocks": random_blocks,
    "two tones": two_tones,
    "dead ends": dead_ends,
    "pieces": lighter_pieces,
    "repeated": repeated,
    "blurred": blurred,
    "collapsed": collapsed,
    "crop": crop,
}


# -- results and scores


def exemplars(folder: Path, half: int | None, exclude: list[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Names and pictures, their middle, reduced to 256 px."""
    import cv2

    files = sorted(one for one in folder.rglob("*") if one.suffix.lower() in (".jpg", ".jpeg", ".png"))
    for file in files if half is None else files[half::2]:
        if any(name in str(file) for name in exclude):
            continue
        picture = cv2.imread(str(file))
        if picture is None:
            continue
        height, width = picture.shape[:2]
        scale = min(1.0, _SIDE / min(height, width))
        size = (round(width * scale), round(height * scale))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        row, column = (max(0, extent - _SIDE) // 2 for extent in picture.shape[:2])
        name = "/".join(file.relative_to(folder).parts[-2:])
        yield name, np.ascontiguousarray(picture[row : row + _SIDE, column : column + _SIDE, ::-1])


def made(
    picture: np.ndarray,
    method: str,
    folder: Path | None,
    *,
    tileable: bool = False,
    preset: str | None = None,
    seed: int = 3,
) -> Sample:
    """A result of 8 bits of a method, from ``folder`` where it is there, and written to it otherwise."""
    parts = [method, *([preset] if preset else []), *(["tileable"] if tileable else []), str(seed)]
    file = f"{zlib.crc32(np.ascontiguousarray(picture).tobytes()):08x}-{'-'.join(parts)}.npz"
    if folder is not None and (folder / file).exists():
        with np.load(folder / file) as known:
            return picture / 255, known["result"] / 255, known["match"].astype(np.int64)
    texture = texloom.synthesize(picture, size=_SIZE, method=method, seed=seed, preset=preset, tileable=tileable)
    values = srgb_from_linear(Image.of(np.asarray(texture.image)).color)
    result, match = np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8), np.asarray(texture.source_map)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(folder / file, result=result, match=match)
    return picture / 255, result / 255, match.astype(np.int64)


def table_of(sample: Sample, tileable: bool = False) -> dict[str, Any]:
    """The table of scores of a result."""
    exemplar, result, match = sample
    source, image = (
        Image.of(np.rint(np.clip(part, 0, 1) * 65535).astype(np.uint16)) for part in (exemplar, result)
    )
    return metrics(source, image.wrapping(tileable), MetricsParams(), match.astype(np.uint32)).table


Figures: TypeAlias = dict[str, tuple[float, float | None]]
"""measure to its value, larger is worse, and 1 less its score"""


def figures(sample: Sample, tileable: bool = False) -> Figures:
    """The figures of each measure; those that cannot be measured are left out."""
    table = table_of(sample, tileable)["measures"]
    return {
        name: (
            abs(line["value"] - 1) if name in _SMALLER_IS_WORSE else line["value"],
            None if line["score"] is None else 1 - line["score"],
        )
        for name, line in table.items()
        if line["value"] is not None
    }


def area_under_curve(good: list[float], bad: list[float]) -> float:
    """Probability that one of ``bad`` is larger than one of ``good``, ties counted half."""
    from scipy.stats import rankdata

    ranks = rankdata([*good, *bad])
    excess = float(ranks[len(good) :].sum()) - len(bad) * (len(bad) + 1) / 2
    return excess / (len(good) * len(bad))


Scores: TypeAlias = dict[str, dict[str, Figures]]
"""fault, or empty where there is none, to exemplar to figures"""


def scores_of(name: str, picture: np.ndarray, weak: list[str], folder: Path | None) -> dict[str, Figures]:
    """The figures of the good result of one exemplar and of those with faults, by fault."""
    good = made(picture, "self_tuning", folder)
    scores = {"": figures(good)}
    for fault, spoil in FAULTS.items():
        sample = spoil(good, np.random.default_rng(zlib.crc32(f"{name} {fault}".encode())))
        if sample is not None:
            scores[fault] = figures(sample)
    for method in weak:
        scores[method] = figures(made(picture, method, folder))
    periodic = made(picture, "self_tuning", folder, tileable=True)
    cut = np.s_[9:-11, 13:-7]
    scores["wraps"] = figures(periodic, tileable=True)
    scores["cropped"] = figures((periodic[0], periodic[1][cut], periodic[2][cut]), tileable=True)
    return scores


def report(scores: Scores) -> None:
    """Print the areas of all measures and faults."""
    good = scores[""]
    faults = [fault for fault in scores if fault not in ("", "wraps", "cropped")]
    print(f"{len(good)} results without faults; " + ", ".join(f"{len(scores[one])} {one}" for one in faults) + "\n")
    print(f"{'measure':25}" + "".join(f"{fault:>13}" for fault in faults))
    for measure in dict.fromkeys(measure for one in good.values() for measure in one):
        for part, kind in enumerate(("value", "score")):
            own = {name: known for name, one in good.items() if (known := _known(one, measure, part)) is not None}
            cells = []
            for fault in faults:
                pairs = [
                    (own[name], known)
                    for name, bad in scores[fault].items()
                    if name in own and (known := _known(bad, measure, part)) is not None
                ]
                cells.append(_cell(list(own.values()), pairs))
            label = f"{measure} ({len(own)})" if part == 0 else ""
            print(f"{label:20}{kind:5}" + "".join(f"{cell:>13}" for cell in cells))
    for part, kind in enumerate(("value", "score")):
        wraps, cropped = (
            [known for one in scores[name].values() if (known := _known(one, "seams", part)) is not None]
            for name in ("wraps", "cropped")
        )
        area = area_under_curve(wraps, cropped)
        print(f"\nseams, {kind}: {area:.2f} for {len(cropped)} crops of {len(wraps)} tileable results")


def _known(one: Figures, measure: str, part: int) -> float | None:
    """The value or the score of a measure."""
    return one[measure][part] if measure in one else None


def _cell(good: list[float], pairs: list[tuple[float, float]]) -> str:
    """Area under the curve, and share of exemplars, of good results and pairs of good and faulty ones."""
    if not pairs:
        return "-"
    paired = np.mean([(bad > own) + 0.5 * (bad == own) for own, bad in pairs])
    return f"{area_under_curve(good, [bad for _, bad in pairs]):.2f} | {paired:.2f}"


def main() -> None:
    """Read the options, score, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", type=int, choices=(0, 1), help="only every other picture")
    parser.add_argument("--exclude", nargs="+", default=[], metavar="TEXT", help="pictures with this in their path")
    parser.add_argument("--weak", nargs="+", default=[], metavar="FLOW", help="methods whose results are faulty")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="where results are kept, for the next run")
    options = parser.parse_args()
    folder = os.environ.get("TEXLOOM_TEXTURES")
    if not folder:
        parser.error("TEXLOOM_TEXTURES: name a folder of pictures")
    scores: Scores = {}
    for name, picture in exemplars(Path(folder), options.half, options.exclude):
        for fault, line in scores_of(name, picture, options.weak, options.results).items():
            scores.setdefault(fault, {})[name] = line
        print(name, flush=True)
    report(scores)


if __name__ == "__main__":
    main()
