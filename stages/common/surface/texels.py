"""The texels of a surface at every level: which are on it, how it is distorted there, what lies beside its charts.

Every chart has an array of its own at each level, with a border; these tiles stand in one array. Level l has a
texel for 2**l x 2**l px of the result, numbered from the result's first pixel as in
`texloom.stages.common.per_pixel`. A texel is *on* the surface if its centre is in the chart. Texels that others
need, as neighbours or parents, are *linked* to a texel on the surface that lies there, mostly in another chart.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from texloom.stages.common.surface.borders import Borders, Links, Sites
from texloom.stages.common.surface.faces import Faces
from texloom.stages.kernels.core.threads import run_all, spans, thread_count
from texloom.stages.vocabulary.arrays import Jacobian

_BORDER = 3  # texels around a chart
_ROUNDS = 3  # of adding texels where nothing is near


@dataclass(frozen=True)
class PackedCharts:
    """The arrays of all charts at a level, in one array."""

    shape: tuple[int, int]
    """of that array"""
    charts: Int64[np.ndarray, "*n"]
    """numbers of the charts, in growing order"""
    rectangles: Int64[np.ndarray, "n 4"]
    """top, bottom, left and right in the array"""
    origins: Int64[np.ndarray, "n 2"]
    """row and column of the result, texels, at the array's row 0 and column 0"""

    @classmethod
    def of(cls, pixels: Float64[np.ndarray, "faces 3 2"], chart: Int32[np.ndarray, "*faces"]) -> "PackedCharts":
        """Arrange the charts' bounding boxes on shelves; ``pixels`` in texels of the level."""
        charts, number = np.unique(chart, return_inverse=True)
        least, most = np.full((charts.size, 2), np.inf), np.full((charts.size, 2), -np.inf)
        np.minimum.at(least, number, pixels.min(axis=1))
        np.maximum.at(most, number, pixels.max(axis=1))
        first = np.floor(least).astype(np.int64) - _BORDER
        sizes = np.ceil(most).astype(np.int64) + _BORDER + 1 - first
        across = max(int(np.sqrt(sizes.prod(axis=1).sum()) * 1.1), int(sizes[:, 1].max()))
        corners = np.zeros((charts.size, 2), np.int64)
        top = left = shelf = wide = 0
        for place in np.argsort(-sizes[:, 0], kind="stable"):
            height, width = (int(side) for side in sizes[place])
            if left + width > across:
                top, left, shelf = top + shelf, 0, 0
            corners[place] = top, left
            left, shelf = left + width, max(shelf, height)
            wide = max(wide, left)
        ends = corners + sizes
        rectangles = np.stack([corners[:, 0], ends[:, 0], corners[:, 1], ends[:, 1]], axis=1)
        return cls((top + shelf, wide), charts.astype(np.int64), rectangles, first - corners)

    def flat(self, place: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Int64[np.ndarray, "..."]:
        """Indices of texels of the result in tiles number ``place``; -1 where the tile ends before."""
        top, bottom, left, right = np.moveaxis(self.rectangles[place], -1, 0)
        row, column = rows - self.origins[place, 0], columns - self.origins[place, 1]
        inside = (row >= top) & (row < bottom) & (column >= left) & (column < right)
        return np.where(inside, row * self.shape[1] + column, -1)

    def places(self) -> Int32[np.ndarray, "rows columns"]:
        """The tile of each texel; -1 where there is none."""
        number = np.full(self.shape, -1, np.int32)
        for place, (top, bottom, left, right) in enumerate(self.rectangles.tolist()):
            number[top:bottom, left:right] = place
        return number


@dataclass(frozen=True)
class Texels:
    """A level."""

    number: int
    tiles: PackedCharts
    flat: Int64[np.ndarray, "*n"]
    """indices of the texels on the surface"""
    place: Int32[np.ndarray, "*n"]
    """their tiles"""
    jacobian: Jacobian
    """(1, n, 4), of these: from px of texture to px of the result"""
    links: Links
    link_place: Int32[np.ndarray, "*m"]
    """tiles of the links' targets"""

    def in_result(self, flat: Int64[np.ndarray, "*n"], place: Int32[np.ndarray, "*n"]) -> Int64[np.ndarray, "n 2"]:
        """Rows and columns in the result, texels of the level."""
        return np.stack(np.divmod(flat, self.tiles.shape[1]), axis=1) + self.tiles.origins[place]


def texels_of(faces: Faces, chart: Int32[np.ndarray, "*faces"], levels: int) -> list[Texels]:
    """All levels, finest first.

    Parameters
    ----------
    chart : the chart of each face.
    """
    borders = Borders(faces, chart)
    made: list[Texels] = []
    for number in range(levels):
        made.append(_TexelMaker(faces, chart, borders, number).texels(made[-1] if made else None))
    return made


class _TexelMaker:
    """What a level is made from."""

    def __init__(self, faces: Faces, chart: Int32[np.ndarray, "*faces"], borders: Borders, number: int):
        self.faces, self.borders, self.number, self.step = faces, borders, number, 2**number
        pixels = (faces.pixels + 0.5) / self.step - 0.5
        self.tiles = PackedCharts.of(pixels, chart)
        self.places = self.tiles.places().ravel()
        self.owner = _owners(pixels, chart, faces.usable, self.tiles).ravel()

    def pixels(self, flat: Int64[np.ndarray, "*n"]) -> Float64[np.ndarray, "n 2"]:
        """Of the texels in the result, px."""
        texel = np.stack(np.divmod(flat, self.tiles.shape[1]), axis=1) + self.tiles.origins[self.places[flat]]
        return np.asarray((texel + 0.5) * self.step - 0.5)

    def charts(self, flat: Int64[np.ndarray, "*n"]) -> Int32[np.ndarray, "*n"]:
        """Of the texels."""
        return self.tiles.charts[self.places[flat]].astype(np.int32)

    def texels(self, finer: Texels | None) -> Texels:
        """The level over the next finer one."""
        on = self.owner >= 0
        twins = self.borders.twins(self._beside(on), self.step)
        on[twins.targets] = False
        parents = np.zeros(0, np.int64) if finer is None else self._parents(finer)
        for _ in range(_ROUNDS):
            needed = self._around(on)
            needed[parents] = True
            needed[on] = needed[twins.targets] = False
            flat = np.flatnonzero(needed)
            chart, pixels = self.charts(flat), self.pixels(flat)
            links, linked = self.borders.link(flat, chart, pixels, self._beside(on), self.step)
            if linked.all():
                break
            # nothing is near, as in a chart that is smaller than a texel
            alone = flat[~linked]
            on[alone] = True
            self.owner[alone] = self.borders.faces_near(chart[~linked], pixels[~linked])
        links, flat = twins.joined(links), np.flatnonzero(on)
        place = self.places[flat]
        return Texels(
            self.number, self.tiles, flat, place, self._jacobians(flat, place, finer), links,
            self.places[links.targets],
        )  # fmt: skip

    def _beside(self, on: Bool[np.ndarray, "*n"]) -> Sites:
        """The texels on the surface that are near others."""
        import cv2

        inner = cv2.erode(on.reshape(self.tiles.shape).view(np.uint8), np.ones((7, 7), np.uint8)).ravel()
        flat = np.flatnonzero(on & (inner == 0))
        pixels = self.pixels(flat)
        return Sites(flat, self.charts(flat), pixels, self.faces.at(self.owner[flat].astype(np.int64), pixels))

    def _around(self, on: Bool[np.ndarray, "*n"]) -> Bool[np.ndarray, "*n"]:
        """The texels on the surface and their neighbours."""
        import cv2

        wide = cv2.dilate(on.reshape(self.tiles.shape).view(np.uint8), np.ones((3, 3), np.uint8))
        return np.asarray(wide.ravel().view(bool))

    def _parents(self, finer: Texels) -> Int64[np.ndarray, "*n"]:
        rows, columns = finer.in_result(finer.flat, finer.place).T >> 1
        return np.unique(self.tiles.flat(finer.place, rows, columns))

    def _jacobians(self, flat: np.ndarray, place: np.ndarray, finer: Texels | None) -> Jacobian:
        """Of the finest level those at the texels' centres, else means over the children on the surface."""
        if finer is None:
            return self._central_jacobians(flat)
        known = np.full(finer.tiles.shape[0] * finer.tiles.shape[1] + 1, -1, np.int64)  # the last for no texel
        known[finer.flat] = np.arange(finer.flat.size)
        rows, columns = (np.stack(np.divmod(flat, self.tiles.shape[1]), axis=1) + self.tiles.origins[place]).T
        parts, count = [], np.zeros(flat.size, np.float32)
        for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
            child = known[finer.tiles.flat(place, 2 * rows + row, 2 * columns + column)]
            parts.append(np.where((child >= 0)[:, None], finer.jacobian[0, child], np.float32(0)))
            count += child >= 0
        # in the order of `texloom.stages.common.per_pixel.levels.halved`
        total = (parts[0] + parts[1]) + (parts[2] + parts[3])
        mean = total * (1 / np.maximum(count, 1)).astype(np.float32)[:, None]
        mean[count == 0] = self._central_jacobians(flat[count == 0])[0]
        return mean[None]

    def _central_jacobians(self, flat: Int64[np.ndarray, "*n"]) -> Jacobian:
        return self.faces.jacobians(self.owner[flat].astype(np.int64), self.pixels(flat))[None]


def _owners(
    pixels: Float64[np.ndarray, "faces 3 2"],
    chart: Int32[np.ndarray, "*faces"],
    usable: Bool[np.ndarray, "*faces"],
    tiles: PackedCharts,
) -> Int32[np.ndarray, "rows columns"]:
    """The face at each texel's centre; -1 where there is none."""
    from texloom.stages.kernels.surface.raster import draw

    corners = np.concatenate([pixels, np.zeros((*pixels.shape[:2], 1))], axis=2)
    owner, depth = np.full(tiles.shape, -1, np.int32), np.full(tiles.shape, np.inf, np.float32)
    listed = np.flatnonzero(usable)
    listed = listed[np.argsort(chart[listed], kind="stable")]
    ends = np.searchsorted(chart[listed], tiles.charts, side="right")
    begins = np.searchsorted(chart[listed], tiles.charts, side="left")
    calls = []
    for place, (top, bottom, left, right) in enumerate(tiles.rectangles.tolist()):
        row, column = tiles.origins[place].tolist()
        own = listed[begins[place] : ends[place]]
        for first, last in spans(bottom - top, thread_count() if bottom - top > 64 else 1):
            at = np.s_[top + first : top + last, left:right]
            calls.append((corners, own, row + top + first, column + left, owner[at], depth[at]))
    run_all(draw, calls)
    return owner
