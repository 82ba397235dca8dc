"""Slow readable twins of the kernels of k-coherence."""

import numpy as np

from tests.kernels.core.naive import bilinear
from texloom.stages.kernels.kcoherence import coherent_pixels
from texloom.stages.kernels.kcoherence.discrete_pixels import DIMENSIONS, ExemplarNeighbourhoods, Repeats
from texloom.stages.kernels.kcoherence.oriented_discrete import Orientation
from texloom.stages.vocabulary.facts import Wraps


def resynthesise_pixel(
    at: tuple[int, int],
    radius: int,
    wrap: Wraps,
    exemplar: coherent_pixels.CopySource,
    result: coherent_pixels.PartialResult,
) -> tuple[int, int]:
    """The exemplar pixel, nearest valid to a proposal, that continues the valid pixels around ``at`` best."""
    features, shape = exemplar.features, result.valid.shape
    around = []
    for step in [(down - radius, across - radius) for down, across in np.ndindex(2 * radius + 1, 2 * radius + 1)]:
        row, column = at[0] + step[0], at[1] + step[1]
        row = row % shape[0] if wrap.down else row
        column = column % shape[1] if wrap.across else column
        if 0 <= row < shape[0] and 0 <= column < shape[1] and result.valid[row, column]:
            around.append((step, (row, column)))
    proposed = []
    for step, neighbour in around:
        source = tuple(result.match[neighbour])
        for place in [source, *(tuple(other) for other in exemplar.candidates[source] if other[0] >= 0)]:
            inside = [min(max(int(place[axis]) - step[axis], 0), features.shape[axis] - 1) for axis in (0, 1)]
            proposed.append(tuple(exemplar.nearest_valid[tuple(inside)].tolist()))

    def difference(place: tuple[int, int]) -> float:
        total = 0.0
        for step, neighbour in around:
            other = features[place[0] + step[0], place[1] + step[1]].astype(np.float64)
            total += float(((other - result.features[neighbour]) ** 2).sum())
        return total

    return min(proposed, key=difference)  # the first of equal ones


def proposal_costs(
    source: np.ndarray,
    control: np.ndarray,
    exemplar: ExemplarNeighbourhoods,
    repeats: Repeats,
    seam: int,
    wrap: Wraps,
    y: int,
    x: int,
) -> dict[tuple[int, int], int]:
    """Costs of the proposals for a pixel: squared distance, penalty, ``seam`` for each neighbour not continued, and
    the penalty of ``repeats`` for each pixel near it that has the same source.
    """
    shape, radius = np.array(source.shape[:2]), exemplar.radius
    vectors = exemplar.vectors.reshape(*exemplar.penalty.shape, DIMENSIONS).astype(int)

    def inside(row: int, column: int) -> bool:
        return (wrap.down or bool(0 <= row < shape[0])) and (wrap.across or bool(0 <= column < shape[1]))

    def at(row: int, column: int) -> tuple[int, int]:
        place = np.where(wrap, np.array([row, column]) % shape, np.clip([row, column], 0, shape - 1))
        return int(place[0]), int(place[1])

    near = [at(y + i, x + j) for i in range(-radius, radius + 1) for j in range(-radius, radius + 1)]
    around = [np.concatenate([exemplar.texture[tuple(source[place])], control[place]]) for place in near]
    wanted = np.rint(np.concatenate(around) @ exemplar.basis).astype(int)
    steps = [np.array([i - 1, j - 1]) for i, j in np.ndindex(3, 3)]
    known = [tuple(source[at(y + i, x + j)] - (i, j)) for i, j in steps if (i or j) and inside(y + i, x + j)]
    own = {
        (row, column)
        for row, column in [tuple(source[y, x]), *known]
        if 0 <= row < vectors.shape[0] and 0 <= column < vectors.shape[1]
    }
    reach = [np.array([i, j]) - repeats.reach for i, j in np.ndindex(2 * repeats.reach + 1, 2 * repeats.reach + 1)]
    beside = [
        repeats.places[tuple(source[at(y + i, x + j)])] for i, j in reach if (i or j) and inside(y + i, x + j)
    ]
    proposed = own | {tuple(other) for place in own for other in exemplar.candidates[place]}
    return {
        place: int(((wanted - vectors[place]) ** 2).sum())
        + int(exemplar.penalty[place])
        + seam * sum(place != other for other in known)
        + int(repeats.penalty) * sum(repeats.places[place] == other for other in beside)
        for place in proposed
    }


def best_around(vectors: np.ndarray, own: tuple[int, int], place: tuple[int, int], reach: int) -> tuple[int, int]:
    """The vector within ``reach`` of ``place`` that differs least from the one at ``own``, but not that one."""
    near = [
        (y, x)
        for y in range(max(0, place[0] - reach), min(vectors.shape[0], place[0] + reach + 1))
        for x in range(max(0, place[1] - reach), min(vectors.shape[1], place[1] + reach + 1))
        if (y, x) != own
    ]
    return min(near, key=lambda at: float(((vectors[at] - vectors[own]) ** 2).sum()))


def oriented_proposals(
    source: np.ndarray, candidates: np.ndarray, orientation: Orientation, wrap: Wraps, y: int, x: int
) -> list[tuple[np.ndarray, int]]:
    """Places that an oriented pixel may come from, each with the number of neighbours that it does not continue."""
    size, limit = np.array(source.shape[:2]), np.array(candidates.shape[:2]) - 1
    groups: list[list[np.ndarray]] = []
    around = 0
    # the pixel itself is the middle one and comes first
    for i, j in sorted(np.ndindex(3, 3), key=lambda at: (3 * at[0] + at[1] - 4) % 9):
        step = np.array([i - 1, j - 1])
        there = np.array([y, x]) + step
        if (~np.array(wrap) & ((there < 0) | (there >= size))).any():
            continue
        around += bool(step.any())
        place = source[tuple(there % size)] - orientation.inverse[y, x].reshape(2, 2) @ step
        if (place < 0).any() or (place > limit).any():
            continue
        for group in groups:
            if (np.abs(group[0] - place) < orientation.merge_distance).all():
                group.append(place)
                break
        else:
            groups.append([place])
    found = []
    own = (source[y, x] >= 0).all() and (source[y, x] <= limit).all()
    for number, group in enumerate(groups):
        neighbours = group[1:] if number == 0 and own else group
        mean = np.mean(neighbours or group, axis=0)
        found.append((mean, around - len(neighbours)))
        pixel = np.rint(mean).astype(int)
        found += [(np.clip(other + mean - pixel, 0, limit), around) for other in candidates[tuple(pixel)]]
    return found


def oriented_vector(
    source: np.ndarray,
    control: np.ndarray,
    exemplar: ExemplarNeighbourhoods,
    orientation: Orientation,
    wrap: Wraps,
    y: int,
    x: int,
) -> np.ndarray:
    """The neighbourhood of an oriented pixel, each value from the continuation of the nearest pixel's source."""
    radius, texture = exemplar.radius, exemplar.texture.reshape(*exemplar.penalty.shape, -1)
    size = np.array(source.shape[:2])
    values = []
    for i, j in np.ndindex(2 * radius + 1, 2 * radius + 1):
        place = np.array([y, x]) + orientation.jacobian[y, x].reshape(2, 2) @ (i - radius, j - radius)
        near = np.floor(place + 0.5).astype(int)
        beside = place - near
        near = np.where(wrap, near % size, near)
        if ((near < 0) | (near >= size)).any():
            near, beside = np.clip(near, 0, size - 1), np.zeros(2)
        at = source[tuple(near)] + orientation.inverse[tuple(near)].reshape(2, 2) @ beside
        values += [*np.floor(bilinear(texture, *at) + 0.5), *control[tuple(near)]]
    return np.rint(np.array(values) @ exemplar.basis)
