"""Neighbouring pixels of a textured surface, inside charts and across their borders."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int32, Int64

from texloom.stages.common.jacobians import inverted
from texloom.stages.common.surface.faces import Faces
from texloom.stages.common.surface.texels import Texels, texels_of

_NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True)
class Pairs:
    """Pixels of the result that are neighbours on the surface."""

    one: Int64[np.ndarray, "n 2"]
    """row and column"""
    other: Int64[np.ndarray, "n 2"]
    offset: Float64[np.ndarray, "n 2"]
    """from one to the other in texture, px down and across"""


def neighbours(faces: Faces, chart: Int32[np.ndarray, "*faces"]) -> tuple[Pairs, Pairs]:
    """All pairs inside charts, each once; and for each pixel beside a border those beyond it."""
    texels = texels_of(faces, chart, 1)[0]
    on = np.full(texels.tiles.shape[0] * texels.tiles.shape[1], -1, np.int64)
    on[texels.flat] = np.arange(texels.flat.size)
    linked = np.full(on.size, -1, np.int64)
    linked[texels.links.targets] = np.arange(texels.links.targets.size)
    places = texels.in_result(texels.flat, texels.place)
    to_texture = inverted(texels.jacobian[0][None])[0].reshape(-1, 2, 2).astype(np.float64)
    inside, across = [], []
    for step in _NEIGHBOURS:
        beside = texels.flat + step[0] * texels.tiles.shape[1] + step[1]
        offset = to_texture @ np.array(step, np.float64)
        if step in _NEIGHBOURS[:2]:
            has = on[beside] >= 0
            inside.append(Pairs(places[has], places[on[beside[has]]], offset[has]))
        link = linked[beside]
        has = (link >= 0) & _leaves(texels, link, places)
        source = on[texels.links.sources[link[has]]]
        beyond = offset[has] - texels.links.offsets[link[has]]
        across.append(Pairs(places[has], places[source], beyond))
    return _joined(inside, faces.size), _joined(across, faces.size)


def _leaves(texels: Texels, link: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Whether links go to another chart, or far away in the same one."""
    place = np.full(texels.tiles.shape[0] * texels.tiles.shape[1], -1, np.int64)
    place[texels.flat] = np.arange(texels.flat.size)
    source = place[texels.links.sources[np.maximum(link, 0)]]
    is_far = np.abs(places[source] - places).max(axis=1) > 2
    return np.asarray(is_far | (texels.place[source] != texels.place))


def _joined(parts: list[Pairs], size: tuple[int, int]) -> Pairs:
    """One of all parts, without what is outside the result."""
    one, other = np.concatenate([part.one for part in parts]), np.concatenate([part.other for part in parts])
    kept = ((one >= 0) & (other >= 0) & (one < size) & (other < size)).all(axis=1)
    return Pairs(one[kept], other[kept], np.concatenate([part.offset for part in parts])[kept])
