"""Neighbouring pixels of a textured surface, inside charts and across their borders."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int32, Int64

from texloom.stages.common.jacobians import inverted
from texloom.stages.common.surface.faces import Faces
from texloom.stages.common.surface.texels import Texels, texels_of

_NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))
_FAR = 2  # px between pixels of a chart that are neighbours across its border
_MAX_SAMPLED = 2**20  # pixels from which pairs inside charts are taken


@dataclass(frozen=True)
class Pairs:
    """Pixels of the result that are neighbours on the surface."""

    one: Int64[np.ndarray, "n 2"]
    """row and column"""
    other: Int64[np.ndarray, "n 2"]
    offset: Float64[np.ndarray, "n 2"]
    """from one to the other in texture, px down and across"""


def neighbours(faces: Faces, chart: Int32[np.ndarray, "*faces"]) -> tuple[Pairs, Pairs]:
    """Pairs inside charts, of evenly chosen pixels if there are many; and those across borders."""
    texels = texels_of(faces, chart, 1)[0]
    on = np.full(texels.tiles.shape[0] * texels.tiles.shape[1], -1, np.int64)
    on[texels.flat] = np.arange(texels.flat.size)
    linked = np.full(on.size, -1, np.int64)
    linked[texels.links.targets] = np.arange(texels.links.targets.size)
    inside, across = [], []
    sampled = np.arange(0, texels.flat.size, max(1, texels.flat.size // _MAX_SAMPLED))
    for step in _NEIGHBOURS:
        move = step[0] * texels.tiles.shape[1] + step[1]
        if step in _NEIGHBOURS[:2]:
            other = on[texels.flat[sampled] + move]
            has = other >= 0
            inside.append(_pairs(texels, sampled[has], other[has], step))
        link = linked[texels.flat + move]
        one = np.flatnonzero(link >= 0)
        link = link[one]
        other = on[texels.links.sources[link]]
        apart = texels.in_result(texels.flat[one], texels.place[one])
        apart -= texels.in_result(texels.flat[other], texels.place[other])
        has = (np.abs(apart).max(axis=1) > _FAR) | (texels.place[one] != texels.place[other])
        across.append(_pairs(texels, one[has], other[has], step, texels.links.offsets[link[has]]))
    return _joined(inside, faces.size), _joined(across, faces.size)


def _pairs(
    texels: Texels, one: np.ndarray, other: np.ndarray, step: tuple[int, int], beyond: np.ndarray | None = None
) -> Pairs:
    """Pairs of texels by number, ``step`` apart; ``beyond``: from the others to where that leads."""
    offset = inverted(texels.jacobian[:, one])[0].reshape(-1, 2, 2).astype(np.float64) @ np.array(step, np.float64)
    first, second = (texels.in_result(texels.flat[number], texels.place[number]) for number in (one, other))
    return Pairs(first, second, offset if beyond is None else offset - beyond)


def _joined(parts: list[Pairs], size: tuple[int, int]) -> Pairs:
    """One of all parts, without what is outside the result."""
    one, other = np.concatenate([part.one for part in parts]), np.concatenate([part.other for part in parts])
    kept = ((one >= 0) & (other >= 0) & (one < size) & (other < size)).all(axis=1)
    return Pairs(one[kept], other[kept], np.concatenate([part.offset for part in parts])[kept])
