"""The part of a surface between joints: whole periods of it, without rows that are cut or that appear once."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.analysis.photographs.reduced_surface import reduced_surface
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_LOG = logging.getLogger(__name__)

_SIDE = 640  # px of the longer side, at which joints are searched
_UPRIGHT = 0.05  # tangent of the angle between a generator and the side that it runs along
_MULTIPLES = (1, 2, 3)  # of a period: rows between two joints may look alike themselves
_LESS_ALIKE = 0.15  # correlation that a shorter period may lose
_ALIKE = 0.3  # correlation of rows one period apart
_DRIFT = 0.06  # of a period: by how much a joint may lie beside its place, and a spacing differ
_WIDE = 0.03  # of a period, the deviation over which differences are averaged
_NEAR = 0.12  # of a period, in which the joint is searched
_MIN_PX = 8.0  # px of a period at which joints are searched
_LEAST_SHOWN = 0.5  # of what the widest row shows, that a row has to show
_SAME = 0.5  # correlation of the profile around a joint with that around others
_LOST = 1.25  # periods that may be cut away at either end: a row that is cut, and one of another height
_LEAST, _MOST = 2, 8  # periods between joints that are kept at least; of more, cut ones do not matter


class BetweenJointsParams(Params):
    """Whether a surface is cropped."""

    whole: bool = Field(True)
    """crop to whole periods, from joint to joint, where few are shown"""


@dataclasses.dataclass(frozen=True)
class BetweenJoints:
    """A surface with whole periods."""

    image: Image
    """the surface, cropped from joint to joint along each side where these are clear"""
    generators: Vectors
    """px: of a cropped surface whose generators run along both sides, these, by the distances of joints; one row
    where the only one is a multiple of the given period; else no rows"""
    table: dict[str, Any]
    """``why``: a sentence, empty where nothing is cropped; ``periods``: numbers of periods down and across, 0 where
    that is not known; ``box``: top, left, height and width of what is kept, px"""


@dataclasses.dataclass(frozen=True)
class _Joints:
    """Joints along one side, px."""

    first: float
    last: float
    count: int
    multiple: int


@stage(version=1)
def between_joints(image: Image, generators: Vectors, params: BetweenJointsParams) -> BetweenJoints:
    """Crop a surface to whole periods, from joint to joint.

    Along each side that a generator runs along, the mean colour of each row, or column, is a profile. The period is
    the generator, or the multiple of it at which the profile is more like itself: shelves are as far apart as two
    rows of bottles. Joints are where the profile differs most from its surroundings, in the mean of all periods,
    each at the nearest such place; the longest run of them at even distances is kept. Rows that are cut by the
    border, and rows of another height, are left out, so that they do not return everywhere.

    Parameters
    ----------
    image : the surface from the front.
    generators : of its repetition, as from `lattice_selection`.

    References
    ----------
    Ours.
    """
    box, numbers, known = [(0, image.height), (0, image.width)], [0, 0], np.zeros((0, 2), np.float32)
    if params.whole and len(generators):
        valid = valid_pixels(image)
        usable = np.ones((image.height, image.width), np.bool_) if valid is None else valid
        lab, shown = reduced_surface(image, usable, _SIDE)
        factor = max(shown.shape) / max(image.height, image.width)
        lengths = [_along(generators, axis) for axis in (0, 1)]
        for axis in (0, 1):
            period = lengths[axis] * factor
            joints = _joints(*_profile(lab, shown, axis), period) if period >= _MIN_PX else None
            if joints is None:
                continue
            numbers[axis] = joints.count
            box[axis] = round(joints.first / factor), round(joints.last / factor)
            lengths[axis] = (joints.last - joints.first) / joints.count / factor
            if joints.multiple > 1 and len(generators) == 1:
                known = np.array([[lengths[0], 0] if axis == 0 else [0, lengths[1]]], np.float32)
        # Two periods are too few to be found once more.
        if any(numbers) and len(generators) == 2 and min(lengths) > 0:
            known = np.diag(lengths).astype(np.float32)
    (top, bottom), (left, right) = box
    why = ""
    if any(numbers):
        periods = " and ".join(
            f"{number} {name}" for number, name in zip(numbers, ("down", "across"), strict=True) if number
        )
        why = (
            f"cropped to whole periods, {periods}: {right - left} x {bottom - top} px from joint to joint "
            "(--set whole=false keeps all)"
        )
        _LOG.warning("%s", why)
    table = {"why": why, "periods": numbers, "box": [top, left, bottom - top, right - left]}
    cropped = image.cropped(slice(top, bottom), slice(left, right)) if any(numbers) else image
    return BetweenJoints(cropped, known, table)


def _along(generators: Vectors, axis: int) -> float:
    """Length of the generator that runs along a side; 0 without one."""
    lengths = [abs(float(row[axis])) for row in generators if abs(row[1 - axis]) <= _UPRIGHT * abs(row[axis])]
    return min(lengths, default=0.0)


def _profile(lab: np.ndarray, shown: np.ndarray, axis: int) -> tuple[Float64[np.ndarray, "n 3"], np.ndarray]:
    """Mean colour of each row, or column, and whether enough of it is shown."""
    count = shown.sum(axis=1 - axis)
    sums = (lab * shown[..., None]).sum(axis=1 - axis, dtype=np.float64)
    return sums / np.maximum(count, 1)[:, None], count >= _LEAST_SHOWN * count.max()


def _joints(profile: Float64[np.ndarray, "n 3"], known: np.ndarray, period: float) -> _Joints | None:
    """The longest run of joints at even distances; none where they are not clear, or many."""
    first, last = (int(place) for place in np.flatnonzero(known)[[0, -1]])
    rows = profile[first : last + 1]
    lengths = [multiple * period for multiple in _MULTIPLES if _LEAST * multiple * period <= len(rows)]
    alike = [_best_lag(rows, length) for length in lengths]
    if not alike or max(score for score, _ in alike) < _ALIKE:
        return None
    most = max(score for score, _ in alike)
    index = next(number for number, (score, _) in enumerate(alike) if score >= most - _LESS_ALIKE)
    length = float(alike[index][1])
    if len(rows) >= _MOST * length:
        return None
    usual = np.stack([gaussian_blur(plane[None].astype(np.float32), length / 4, "edge")[0] for plane in rows.T])
    differs = np.sqrt(np.square(rows - usual.T).sum(axis=1))[None].astype(np.float32)
    differs = gaussian_blur(differs, _WIDE * length, "edge")[0]  # the middle of a joint, not its edge
    phase = int(np.argmax([float(differs[start :: round(length)].mean()) for start in range(round(length))]))
    reach = max(1, round(_NEAR * length))
    places, at = [], phase
    while at < len(rows):
        low = max(0, at - reach)
        places.append(low + int(np.argmax(differs[low : at + reach + 1])))
        at = places[-1] + round(length)
    found = _longest(np.array(places, float), _are_alike(rows - usual.T, places, reach), length, index + 1)
    lost = _LOST * length
    if found is None or found.first > lost or len(rows) - found.last > lost:
        return None
    return dataclasses.replace(found, first=found.first + first, last=found.last + first)


def _best_lag(rows: Float64[np.ndarray, "n 3"], length: float) -> tuple[float, int]:
    """The highest correlation of rows about this far apart, and their distance."""
    reach = max(1, round(_DRIFT * length))
    best = (-1.0, round(length))
    for lag in range(max(1, round(length) - reach), min(len(rows) - 4, round(length) + reach) + 1):
        one, other = rows[lag:] - rows[lag:].mean(axis=0), rows[:-lag] - rows[:-lag].mean(axis=0)
        norm = np.sqrt(np.square(one).sum() * np.square(other).sum())
        best = max(best, (float((one * other).sum() / max(norm, 1e-9)), lag))
    return best


def _are_alike(differs: Float64[np.ndarray, "n 3"], places: list[int], reach: int) -> np.ndarray:
    """Whether the profile around each joint is like that around the others."""
    wide = np.pad(differs, [(reach, reach), (0, 0)], "edge")
    looks = np.array([wide[place : place + 2 * reach + 1].ravel() for place in places])
    others = np.array([np.median(np.delete(looks, number, axis=0), axis=0) for number in range(len(looks))])
    norms = np.sqrt(np.square(looks).sum(axis=1) * np.square(others).sum(axis=1))
    return np.asarray((looks * others).sum(axis=1) >= _SAME * np.maximum(norms, 1e-9))


def _longest(
    places: Float64[np.ndarray, "k"],  # type: ignore[name-defined]
    alike: np.ndarray,
    length: float,
    multiple: int,
) -> _Joints | None:
    """The longest run of joints that are alike, and whose spacings are nearly one."""
    steps = np.diff(places)
    best: tuple[int, float, int] | None = None
    for start in range(len(steps)):
        for end in range(start + _LEAST, len(steps) + 1):
            part = steps[start:end]
            off = float(np.abs(part - part.mean()).max())
            if not alike[start : end + 1].all():
                continue
            if off <= _DRIFT * length and (best is None or (end - start, -off) > (best[0], -best[1])):
                best = end - start, off, start
    if best is None:
        return None
    return _Joints(float(places[best[2]]), float(places[best[2] + best[0]]), best[0], multiple)
