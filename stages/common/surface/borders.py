"""The borders of charts, and what of the surface lies beyond them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from texloom.stages.common.surface.faces import Faces, Points
from texloom.stages.common.surface.weld import weld
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import thread_count

_SPACING = 0.5  # px of the result between samples of borders
_SAME = 0.05  # texels within which two are at the same place
_LOCAL = 4  # texels: those of the same chart within so many of a place in the result are on its side of the border
_CANDIDATES = 24  # texels near a border that may lie beyond it
_MAX_GAP = 1.5  # texels from a place to the one that stands for it across a border
_MAX_FARTHER = 1.2  # by which that one may be farther away, in texels, than the nearest of the chart
_MAX_REACH = 3.0  # texels by which a chart is continued
_SNAP = 0.15  # texels that a curved surface may be off where it is unfolded; so near to a texel is at it
_MIN_COSINE = -0.5  # of the angle by which a surface may be folded
_BATCH = 2**15  # places at a time, for memory


@dataclass(frozen=True)
class Sites:
    """Texels, and what there is on the surface."""

    flat: Int64[np.ndarray, "*n"]
    """indices in the array of all tiles"""
    chart: Int32[np.ndarray, "*n"]
    pixels: Float64[np.ndarray, "n 2"]
    """row and column in the result, px"""
    points: Points

    def __getitem__(self, which: np.ndarray | slice) -> "Sites":
        return Sites(self.flat[which], self.chart[which], self.pixels[which], self.points[which])


@dataclass(frozen=True)
class Links:
    """Texels that others stand for; indices in the array of all tiles."""

    targets: Int64[np.ndarray, "*n"]
    sources: Int64[np.ndarray, "*n"]
    """texels on the surface"""
    offsets: Float32[np.ndarray, "n 2"]
    """from source to target in texture, px"""

    @classmethod
    def between(
        cls, targets: Int64[np.ndarray, "*n"], sources: Sites, reached: Float64[np.ndarray, "n 3"]
    ) -> "Links":
        """``reached``: where the targets are on the surface around their sources."""
        points = sources.points
        offsets = np.einsum("nij,nj->ni", points.texture, reached - points.position).astype(np.float32)
        return cls(targets, sources.flat, offsets)

    def joined(self, other: "Links") -> "Links":
        """Both."""
        pairs = ((self.targets, other.targets), (self.sources, other.sources), (self.offsets, other.offsets))
        return Links(*(np.concatenate(pair) for pair in pairs))


class Borders:
    """Samples of the borders of all charts."""

    def __init__(self, faces: Faces, chart: Int32[np.ndarray, "*faces"]):
        spatial = loaded("scipy.spatial")
        corners = weld(np.concatenate([faces.points, faces.pixels], axis=2).reshape(-1, 5)).reshape(-1, 3)
        edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        keys = edges[:, 0] * (corners.max() + 1) + edges[:, 1]
        _, where, count = np.unique(keys, return_index=True, return_counts=True)
        where = np.sort(where[count == 1])
        where = where[faces.usable[where // 3]]
        face, corner = where // 3, where % 3
        begin, end = faces.pixels[face, corner], faces.pixels[face, (corner + 1) % 3]
        parts = np.maximum(1, np.ceil(np.linalg.norm(end - begin, axis=1) / _SPACING)).astype(np.int64)
        edge = np.repeat(np.arange(parts.size), parts)
        number = np.arange(edge.size) - np.repeat(np.cumsum(parts) - parts, parts)
        share = ((number + 0.5) / parts[edge])[:, None]
        self.faces, self.face = faces, face[edge]
        self.pixels = (1 - share) * begin[edge] + share * end[edge]
        self._far = 4.0 * max(faces.size)
        self._tree = spatial.KDTree(self._apart(chart[self.face], self.pixels))

    def _apart(self, chart: np.ndarray, pixels: np.ndarray) -> Float64[np.ndarray, "n 3"]:
        """Coordinates in which charts are far from each other."""
        return np.column_stack([pixels, chart * self._far])

    def nearest(self, chart: np.ndarray, pixels: np.ndarray) -> Int64[np.ndarray, "*n"]:
        """The sample of the same chart that is nearest in the result."""
        return np.asarray(self._tree.query(self._apart(chart, pixels), workers=thread_count())[1], np.int64)

    def faces_near(self, chart: np.ndarray, pixels: np.ndarray) -> Int64[np.ndarray, "*n"]:
        """The face at the nearest place of the border of the same chart."""
        return np.asarray(self.face[self.nearest(chart, pixels)])

    def twins(self, beside: Sites, step: int) -> Links:
        """Texels at the same place as another across a border, for which the first of them stands.

        Parameters
        ----------
        beside : the texels near borders, in the order of their indices.
        step : px of the result in a texel's side.
        """
        spatial = loaded("scipy.spatial")
        points, own = beside.points, np.arange(beside.flat.size)
        first = own
        if own.size:
            count = min(8, own.size)
            distance, other = spatial.KDTree(points.position).query(points.position, count, workers=thread_count())
            distance, other = distance.reshape(-1, count), other.reshape(-1, count)
            same = distance <= _SAME * points.lengths(step)[:, None]
            same &= np.einsum("ni,nki->nk", points.normal, points.normal[other]) > 0
            same &= ~_local(beside.chart, beside.pixels, beside, other, step)
            first = np.minimum(np.where(same, other, own[:, None]).min(axis=1), own)
            while (first[first] != first).any():
                first = first[first]
        held = np.flatnonzero(first != own)
        return Links.between(beside.flat[held], beside[first[held]], points.position[held])

    def link(
        self,
        flat: Int64[np.ndarray, "*n"],
        chart: Int32[np.ndarray, "*n"],
        pixels: Float64[np.ndarray, "n 2"],
        beside: Sites,
        step: int,
    ) -> tuple[Links, Bool[np.ndarray, "*n"]]:
        """What stands for texels outside their chart, and which of them has something.

        The surface beyond the nearest place of the border is unfolded into the plane of the texels. If nothing is
        there, the chart is continued.

        Parameters
        ----------
        flat, chart, pixels : of the texels, see `Sites`.
        beside : the texels on the surface near borders.
        step : px of the result in a texel's side.
        """
        spatial = loaded("scipy.spatial")
        links = Links(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.float32))
        linked = np.zeros(flat.size, bool)
        if not beside.flat.size:
            return links, linked
        around, within = (
            spatial.KDTree(beside.points.position),
            spatial.KDTree(self._apart(beside.chart, beside.pixels)),
        )
        for begin in range(0, flat.size, _BATCH):
            part = slice(begin, begin + _BATCH)
            which, reached, gap = self._beyond(chart[part], pixels[part], beside, around, step)
            distance, own = within.query(self._apart(chart[part], pixels[part]), workers=thread_count())
            plane = beside.points[own]
            offset = np.einsum("nij,nj->ni", plane.per_pixel, pixels[part] - beside.pixels[own])
            is_beyond = gap <= np.minimum(_MAX_GAP, _MAX_FARTHER * distance / step)
            which = np.where(is_beyond, which, own)
            reached = np.where(is_beyond[:, None], reached, plane.position + offset)
            has = is_beyond | (distance <= _MAX_REACH * step)
            links = links.joined(Links.between(flat[part][has], beside[which[has]], reached[has]))
            linked[part] = has
        return links, linked

    def _beyond(
        self, chart: np.ndarray, pixels: np.ndarray, beside: Sites, around: Any, step: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The texel nearest to each place across the border, where the place is there, and its distance, texels."""
        foot = self.nearest(chart, pixels)
        border = self.faces.at(self.face[foot], self.pixels[foot])
        offset = np.einsum("nij,nj->ni", border.per_pixel, pixels - self.pixels[foot])
        count = min(_CANDIDATES, beside.flat.size)
        other = around.query(border.position, count, workers=thread_count())[1].reshape(-1, count)
        points = beside.points
        # rotated about the edge between the two planes
        one, two = border.normal[:, None], points.normal[other]
        cosine = np.einsum("nki,nki->nk", np.broadcast_to(one, two.shape), two)[..., None]
        axis = np.cross(one, two)
        turned = offset[:, None] * cosine + np.cross(axis, offset[:, None])
        along = np.einsum("nki,ni->nk", axis, offset)[..., None]
        turned += axis * along / np.maximum(1 + cosine, 1e-6)
        reached = border.position[:, None] + turned
        distance = np.linalg.norm(
            np.einsum("nkij,nkj->nki", points.to_pixels[other], reached - points.position[other]), axis=2
        )
        distance /= step
        reached = np.where((distance <= _SNAP)[..., None], points.position[other], reached)
        distance[(cosine[..., 0] < _MIN_COSINE) | _local(chart, pixels, beside, other, step)] = np.inf
        best = distance.argmin(axis=1)
        row = np.arange(best.size)
        which = other[row, best]
        return which, reached[row, best], distance[row, best]


def _local(
    chart: np.ndarray, pixels: np.ndarray, sites: Sites, which: Int64[np.ndarray, "n k"], step: int
) -> Bool[np.ndarray, "n k"]:
    """Whether texels are of a place's chart, and near it in the result."""
    near = np.abs(sites.pixels[which] - pixels[:, None]).max(axis=2) <= _LOCAL * step
    return np.asarray(near & (sites.chart[which] == chart[:, None]))
