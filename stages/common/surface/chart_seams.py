"""Neighbouring pixels of a textured surface, inside charts and across their borders."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int32, Int64

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.common.surface.faces import Faces
from texloom.stages.common.surface.texels import Texels, texels_of
from texloom.stages.numerics.matrices import matrix_product

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
    sampled = np.arange(0, texels.flat.size, max(1, texels.flat.size // _MAX_SAMPLED))
    inside, across = (
        [_pairs(texels, *part) for part in parts] for parts in (within(texels, sampled), linked(texels))
    )
    return _joined(inside, faces.size), _joined(across, faces.size)


Numbered: TypeAlias = tuple[Int64[np.ndarray, "*pairs"], Int64[np.ndarray, "*pairs"], Float64[np.ndarray, "..."]]
"""texels and others by number, and the ways from one to the other in texture, px"""


def within(texels: Texels, sampled: Int64[np.ndarray, "*n"]) -> list[Numbered]:
    """Texels of those ``sampled`` and their neighbours in the same chart, to the right and below."""
    on, made = _numbers(texels, texels.flat), []
    for step in _NEIGHBOURS[:2]:
        other = on[texels.flat[sampled] + _move(texels, step)]
        one = sampled[other >= 0]
        made.append((one, other[other >= 0], _way(texels, one, step)))
    return made


def linked(texels: Texels) -> list[Numbered]:
    """Texels and their neighbours across borders, in all directions."""
    on, made = _numbers(texels, texels.flat), []
    links = _numbers(texels, texels.links.targets)
    for step in _NEIGHBOURS:
        link = links[texels.flat + _move(texels, step)]
        one = np.flatnonzero(link >= 0)
        link = link[one]
        other = on[texels.links.sources[link]]
        apart = texels.in_result(texels.flat[one], texels.place[one])
        apart -= texels.in_result(texels.flat[other], texels.place[other])
        has = (np.abs(apart).max(axis=1) > _FAR) | (texels.place[one] != texels.place[other])
        made.append((one[has], other[has], _way(texels, one[has], step) - texels.links.offsets[link[has]]))
    return made


def _numbers(texels: Texels, flat: np.ndarray) -> Int64[np.ndarray, "*texels"]:
    """For each texel of the level its number in a list; -1 where it is not in it."""
    number = np.full(texels.tiles.shape[0] * texels.tiles.shape[1], -1, np.int64)
    number[flat] = np.arange(flat.size)
    return number


def _move(texels: Texels, step: tuple[int, int]) -> int:
    return step[0] * texels.tiles.shape[1] + step[1]


def _way(texels: Texels, one: np.ndarray, step: tuple[int, int]) -> Float64[np.ndarray, "n 2"]:
    """In texture, px, for a step from texels."""
    to_texture = inverted(texels.jacobian[:, one])[0].reshape(-1, 2, 2).astype(np.float64)
    return np.asarray(matrix_product(to_texture, np.array(step, np.float64)) * 2**texels.number)


def _pairs(texels: Texels, one: np.ndarray, other: np.ndarray, offset: np.ndarray) -> Pairs:
    first, second = (texels.in_result(texels.flat[number], texels.place[number]) for number in (one, other))
    return Pairs(first, second, offset)


def _joined(parts: list[Pairs], size: tuple[int, int]) -> Pairs:
    """One of all parts, without what is outside the result."""
    one, other = np.concatenate([part.one for part in parts]), np.concatenate([part.other for part in parts])
    kept = ((one >= 0) & (other >= 0) & (one < size) & (other < size)).all(axis=1)
    return Pairs(one[kept], other[kept], np.concatenate([part.offset for part in parts])[kept])
