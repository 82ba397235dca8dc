"""The tiles that a straightened exemplar shows whole."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.analysis.regularity.straighten import Positions
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline, cell_outline, course_outline
from texloom.stages.synthesis.near_regular.lattice_tiles import Window, whole
from texloom.stages.synthesis.stitching.exemplar import Exemplar
from texloom.stages.vocabulary.arrays import Correspondence
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size

COURSE_SHIFT = 2
"""px that a tile may move along its course"""

_MIN_OVERLAP = 4  # px
_MAX_TILES = 256
_MAX_VALUES = 1 << 25  # of all tiles together
_PHASES = 48  # tiles cut from a cell's length along courses
_MAX_COURSE_TILES = 1024


class TileSource:
    """The image that tiles are cut from: the exemplar, as it is or straightened."""

    pixels: Float32[np.ndarray, "h w k"]
    """all channels of the image, then the features"""
    features: Float32[np.ndarray, "h w c"]
    places: Correspondence
    """source of each pixel in the exemplar, rounded"""
    valid: Bool[np.ndarray, "h w"]
    """false where a pixel is masked, or its source is outside the exemplar"""
    masked: bool
    """whether the exemplar has masked pixels"""

    def __init__(self, exemplar: Exemplar, source: Positions | None):
        self.pixels = np.concatenate([exemplar.image.pixels, exemplar.features], axis=2)
        self.places = np.ascontiguousarray(np.moveaxis(np.indices(exemplar.shape), 0, -1), np.uint32)
        self.masked = exemplar.usable is not None
        self.valid = np.ones(exemplar.shape, bool) if exemplar.usable is None else exemplar.usable
        if source is not None:
            import cv2

            from texloom.stages.kernels.core.resample import sampled

            last = np.array(exemplar.shape) - 1
            inside = ((source >= -0.5) & (source <= last + 0.5)).all(axis=2)
            self.places = np.rint(np.clip(source, 0, last)).astype(np.uint32)
            # All pixels that the interpolation uses must be valid.
            interpolable = cv2.erode(self.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            self.valid = inside & interpolable[self.places[..., 0], self.places[..., 1]]
            self.pixels = sampled(self.pixels, source.astype(np.float64))
        self.features = np.ascontiguousarray(self.pixels[..., len(exemplar.image.channels) :])


@dataclasses.dataclass(frozen=True)
class TileSet:
    """The candidate tiles."""

    window: Window
    sources: Int64[np.ndarray, "k p 2"]
    """pixel of the tile source for every pixel of every tile"""
    features: Float32[np.ndarray, "k p c"]
    cells: Int64[np.ndarray, " k"]
    """number of the cell that a tile is cut from; along courses several overlap it"""

    @property
    def count(self) -> int:
        """Number of different cells."""
        return int(self.cells.max()) + 1


def _course_corners(vertices: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of tiles that begin anywhere along courses, (n, 2), and the vertex before each."""
    steps = min(_PHASES, max(1, int(np.hypot(*along))))
    shares = np.arange(steps)[:, None] / steps
    corners = (vertices[:, None] + shares * along).reshape(-1, 2)
    return corners, np.repeat(np.arange(len(vertices)), steps)


def tile_set(
    tile_source: TileSource,
    generators: np.ndarray,
    vertices: np.ndarray,
    result_generators: np.ndarray,
    courses: bool,
    known: CellOutline | None,
    overlap_share: float,
    shift: int,
    rng: np.random.Generator,
) -> tuple[TileSet, CellOutline]:
    """All whole tiles, or as many as memory allows, for a result with ``result_generators``.

    Parameters
    ----------
    courses : they may begin anywhere along the second generator.
    known : their outline; None where it is to be found.
    overlap_share, shift : see `NearRegularParams`.
    """
    begins, cells = (vertices, np.arange(len(vertices)))
    if courses:
        begins, cells = _course_corners(vertices, generators[1])
    spare = max(shift, COURSE_SHIFT if courses else 0)
    to_exemplar = matrix_product(inverse_of(result_generators), generators)
    features = tile_source.features
    overlap = max(_MIN_OVERLAP, round(overlap_share * float(np.hypot(*generators.T).min())))
    # Exemplars of very few cells may have no whole tile with this overlap, but some with a narrower one.
    while True:
        if known is not None:
            outline = known
        elif courses:
            outline = course_outline(features, tile_source.valid, vertices, generators)
        else:
            outline = cell_outline(features, tile_source.valid, vertices, generators, overlap / 2)
        own = outline.moved(matrix_product(outline.generators, inverse_of(to_exemplar)))
        window = Window.of_course(own, overlap / 2) if courses else Window.of(own, overlap / 2)
        kept = np.flatnonzero(whole(window, begins, to_exemplar, tile_source.valid, spare))
        if len(kept) or overlap <= _MIN_OVERLAP:
            break
        overlap = max(_MIN_OVERLAP, overlap // 2)
    if not len(kept):
        height, width = tile_source.valid.shape
        masked = " that its mask leaves" if tile_source.masked else ""
        raise InputError(
            f"image: {format_size((height, width))} show no whole cell of the lattice{masked}, whose generators "
            f"are {' and '.join(f'({row:.0f}, {column:.0f})' for row, column in generators)} px"
        )
    most = _MAX_COURSE_TILES if courses else _MAX_TILES
    limit = int(np.clip(_MAX_VALUES // (features.shape[2] * len(window.offsets)), 1, most))
    if len(kept) > limit:
        kept = np.sort(rng.choice(kept, limit, replace=False))
    offsets = matrix_product(window.offsets, to_exemplar)
    sources = np.rint(begins[kept][:, None] + offsets[None]).astype(np.int64)
    numbers = np.unique(cells[kept], return_inverse=True)[1]
    return TileSet(window, sources, features[sources[..., 0], sources[..., 1]], numbers), outline
