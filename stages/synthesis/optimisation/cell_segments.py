"""What a cell of a lattice consists of: parts, such as bricks, between joints that surround them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Vectors

_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))  # generators to the cells that are compared
_MAX_BINS = 48  # of a cell along a generator
_DEPTH = 0.2  # of the range of unlikeness, of the joint between two parts
_MIN_CONTRAST = 0.35  # between the inside of a part and the joints around it, as a share of the range
_MIN_PART = 0.05  # of a cell's area
_MAX_PARTS = 6  # of a cell; more are noise


@dataclass(frozen=True)
class Segments:
    """The parts of a lattice's cell, which may reach into the cells around it."""

    part: Int64[np.ndarray, "b c"]
    """by position along the generators"""
    moved: Int64[np.ndarray, "2 b c"]
    """steps along the generators to the cell to which the part at that position belongs"""
    count: int

    def __call__(
        self, position: Float64[np.ndarray, "2 p q"]
    ) -> tuple[Int64[np.ndarray, "2 p q"], Int64[np.ndarray, "p q"]]:
        """Cell and part of positions in generators."""
        cell = np.floor(position).astype(np.int64)
        bins = [
            np.minimum(((place - whole) * side).astype(np.int64), side - 1)
            for place, whole, side in zip(position, cell, self.part.shape, strict=True)
        ]
        return cell + self.moved[:, *bins], self.part[*bins]


def unlikeness(
    lab: Float32[np.ndarray, "h w 3"], generators: Vectors
) -> tuple[Float64[np.ndarray, "h w"], Float64[np.ndarray, "h w"]]:
    """Mean squared difference of each pixel from those in the same place of the cells around, and their number."""
    import cv2

    smooth = cv2.blur(lab, (3, 3))
    height, width = lab.shape[:2]
    total, pairs_of = np.zeros((height, width)), np.zeros((height, width))
    for step in _STEPS:
        down, across = (int(one) for one in np.rint(matrix_product(step, generators.astype(np.float64))))
        if abs(down) >= height or abs(across) >= width:
            continue
        one = np.s_[max(0, -down) : height - max(0, down), max(0, -across) : width - max(0, across)]
        other = np.s_[max(0, down) : height + min(0, down), max(0, across) : width + min(0, across)]
        difference = ((smooth[one] - smooth[other]) ** 2).sum(axis=2)
        for end in (one, other):
            total[end] += difference
            pairs_of[end] += 1
    return total / np.maximum(pairs_of, 1), pairs_of


def segments_of(
    lab: Float32[np.ndarray, "h w 3"],
    different: Float64[np.ndarray, "h w"],
    pairs_of: Float64[np.ndarray, "h w"],
    generators: Vectors,
) -> Segments | None:
    """The parts of a cell; none where no closed joints surround them.

    Joints differ from what they surround in the mean cell: they are darker or lighter, more or less alike from cell
    to cell, or where it has contours. What tells them apart best is used.

    Parameters
    ----------
    different, pairs_of : see `unlikeness`.
    """
    roots = _profile(different, pairs_of, generators) ** 0.5
    lightness = _profile(lab[..., 0].astype(np.float64), np.ones(lab.shape[:2]), generators)
    steps = [(np.roll(lightness, -1, axis) - np.roll(lightness, 1, axis)) ** 2 for axis in (0, 1)]
    best, found = _MIN_CONTRAST, None
    for profile in (lightness, -lightness, roots, -roots, -np.sqrt(steps[0] + steps[1])):
        segments = _of_profile(profile)
        if segments is not None and segments[0] > best:
            best, found = segments
    return found


def _of_profile(profile: Float64[np.ndarray, "b c"]) -> tuple[float, Segments] | None:
    """Parts that are higher than the joints around them, and by how much, as a share of the range."""
    extent = float(profile.max() - profile.min())
    grown = _grown(profile) if extent > 0 else None
    if grown is None:
        return None
    part, moved = grown
    values, part = np.unique(part, return_inverse=True)
    part = part.reshape(profile.shape)
    sizes = np.bincount(part.ravel()) / part.size
    if len(values) > _MAX_PARTS or sizes.min() < _MIN_PART:
        return None
    border = np.zeros(part.shape, bool)
    for axis in (0, 1):
        crossed = np.roll(part, 1, axis) != part
        for plane, own in zip(moved, (axis == 0, axis == 1), strict=True):
            before = np.roll(plane, 1, axis)
            first = np.s_[:1] if axis == 0 else np.s_[:, :1]
            before[first] -= own  # the cell before
            crossed |= before != plane
        border |= crossed | np.roll(crossed, -1, axis)
    contrasts = []
    for index in range(len(values)):
        own = part == index
        if not (own & border).any() or not (own & ~border).any():
            return None
        contrasts.append(float(profile[own & ~border].mean() - profile[own & border].mean()) / extent)
    return min(contrasts), Segments(part, moved, len(values))


def _profile(
    different: Float64[np.ndarray, "h w"], pairs_of: Float64[np.ndarray, "h w"], generators: Vectors
) -> Float64[np.ndarray, "b c"]:
    """Mean by position along the generators, smoothed."""
    basis = generators.astype(np.float64)
    bins = [int(np.clip(round(float(length)), 8, _MAX_BINS)) for length in np.hypot(*basis.T)]
    position = matrix_product(np.moveaxis(np.indices(different.shape), 0, 2), inverse_of(basis))
    places = [
        np.minimum((position[..., axis] % 1 * bins[axis]).astype(np.int64), bins[axis] - 1) for axis in (0, 1)
    ]
    index = (places[0] * bins[1] + places[1]).ravel()
    known = np.bincount(index, pairs_of.ravel() > 0, bins[0] * bins[1])
    mean = np.bincount(index, different.ravel(), bins[0] * bins[1]) / np.maximum(known, 1)
    profile = mean.reshape(bins)
    for axis in (0, 1):
        profile = (np.roll(profile, 1, axis) + 2 * profile + np.roll(profile, -1, axis)) / 4
    return profile


def _grown(
    profile: Float64[np.ndarray, "b c"],
) -> tuple[Int64[np.ndarray, "b c"], Int64[np.ndarray, "2 b c"]] | None:
    """Part of each position, and the steps to its cell; none where a part goes on without end.

    Positions join from the most unlike on. Where two parts meet, they become one unless both stand out.
    """
    height, width = profile.shape
    depth = _DEPTH * float(profile.max() - profile.min())
    parent: dict[int, int] = {}
    step: dict[int, tuple[int, int]] = {}  # of a position's cell from its parent's
    peak: dict[int, float] = {}

    def root(place: int) -> tuple[int, int, int]:
        down = across = 0
        while parent[place] != place:
            down, across = down + step[place][0], across + step[place][1]
            place = parent[place]
        return place, down, across

    values = profile.ravel()
    for place in np.argsort(-values, kind="stable").tolist():
        row, column = divmod(place, width)
        parent[place], step[place], peak[place] = place, (0, 0), float(values[place])
        for y, x in ((row - 1, column), (row, column - 1), (row, column + 1), (row + 1, column)):
            over = y // height, x // width  # the cell in which the neighbour lies
            other = y % height * width + x % width
            if other not in parent:
                continue
            (one, *first), (two, *second) = root(place), root(other)
            # cell of the own root and of the other one, from here
            between = (second[0] + over[0] - first[0], second[1] + over[1] - first[1])
            if one == two:
                if between != (0, 0) and peak[one] - values[place] <= depth:
                    return None
                continue
            if min(peak[one], peak[two]) - values[place] > depth:
                continue
            if peak[one] <= peak[two]:
                parent[one], step[one] = two, between
            else:
                parent[two], step[two] = one, (-between[0], -between[1])
    part, moved = np.empty(profile.shape, np.int64), np.empty((2, *profile.shape), np.int64)
    for place in range(values.size):
        top, down, across = root(place)
        part.ravel()[place] = top
        moved[:, *divmod(place, width)] = down, across
    return part, moved
