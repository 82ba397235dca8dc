"""Image quilting: blocks of the exemplar, each cut along the line where it differs least from its neighbours."""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field as Knob

from stages.arrays import Correspondence, Image
from stages.declare import InputError, Params, stage
from stages.progress import Progress, report
from stages.synthesis._cuts import Strips, laid_over
from stages.synthesis._exemplar import Exemplar, Weights
from stages.synthesis._maps import check_weights
from stages.synthesis._overlap import OverlapSearch, compared, good_enough
from stages.synthesis.initialise import Size

_LEAST = 8  # px of an exemplar's shorter side
_SQUARE = 16  # px of the squares of the exemplar whose use is counted
_REUSE = 3.0  # by how many times its cuts a block that was used as often as others counts as dearer
_APART = 2  # px between blocks that are tried
_SMOOTHING = 3  # px over which differences are averaged, so that cuts keep off what differs


class QuiltingParams(Params):
    """How large the result is, and what it is sewn from."""

    size: Size = (1024, 1024)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders"""
    block: int | None = Knob(None, ge=6)
    """side of a block, px, about twice that of the largest feature; null: three eighths of the exemplar's shorter
    side, 24 at least"""
    overlap: float = Knob(1 / 3, gt=0, le=1 / 3)
    """how much of a block lies over each of its neighbours, as a share of its side; 2 px at least"""
    tolerance: float = Knob(0.1, ge=0, le=10)
    """blocks whose squared difference to their neighbours is at most 1 + this times the least are as likely to be
    tried; 0 tries the best alone, which varies less"""
    tries: int = Knob(16, ge=1, le=256)
    """blocks that are tried, of which that with the cheapest cut and little use is laid; 1 as in the paper"""
    weights: Weights = Knob({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


@dataclasses.dataclass(frozen=True)
class Quilted:
    """The texture."""

    image: Image
    """the exemplar's pixels at ``match``, all maps"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it is"""
    tileable: bool
    """whether it wraps around"""


def _block(exemplar: Exemplar, params: QuiltingParams) -> int:
    """Side of a block; less than the default where masks leave no larger one."""
    whole = min(*exemplar.shape, max(24, 3 * min(exemplar.shape) // 8))
    smaller = [whole >> halvings for halvings in range(8) if whole >> halvings >= _LEAST]
    sides = [params.block] if params.block else smaller
    return sides[exemplar.first_that_fits(sides, "block", "block")]


def check_exemplar(params: QuiltingParams, known: Mapping[str, Any]) -> None:
    """The exemplar must hold a block."""
    image = known.get("image")
    if image is None:
        return
    check_weights(params.weights, image.channels)
    side, shape = min(image.height, image.width), f"{image.height}x{image.width} px"
    if side < _LEAST:
        raise InputError(f"image: {shape} is too small to synthesise from, which takes {_LEAST}x{_LEAST} px")
    if params.block is not None and params.block > side:
        raise InputError(f"block: {params.block} px is more than the image has, {shape}")


def _edges(length: int, block: int, overlap: int, tileable: bool) -> list[int]:
    """Where blocks begin along a side, and where the one after the last would.

    Blocks are as many as it takes and of even size; each ends ``overlap`` px beyond the beginning of the next.
    """
    free = length if tileable else length - overlap
    count = max(2 if tileable else 1, -(-free // (block - overlap)))
    return [free * index // count for index in range(count + 1)]


class _Quilt:
    """A result being laid."""

    def __init__(self, image: Image, params: QuiltingParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, compared, 1.0, params.weights)
        self.features = self.exemplar.features
        self.search = OverlapSearch(self.features)
        self.canvas = np.zeros((*params.size, self.features.shape[2]), np.float32)
        self.match = np.zeros((*params.size, 2), np.uint32)
        self.uses = np.zeros([-(-side // _SQUARE) for side in self.exemplar.shape], np.int64)

    def run(self) -> Correspondence:
        height, width = self.params.size
        block = _block(self.exemplar, self.params)
        # The opposite overlaps of a tileable result's last blocks must not meet.
        most = min(block // 3, min(height, width) // 4)
        overlap = min(max(2, round(block * self.params.overlap)), most)
        tileable = self.params.tileable
        rows = list(itertools.pairwise(_edges(height, block, overlap, tileable)))
        columns = list(itertools.pairwise(_edges(width, block, overlap, tileable)))
        for i, (top, bottom) in enumerate(rows):
            for j, (left, right) in enumerate(columns):
                strips = Strips(
                    top=overlap if i else 0,
                    left=overlap if j else 0,
                    bottom=overlap if tileable and i == len(rows) - 1 else 0,
                    right=overlap if tileable and j == len(columns) - 1 else 0,
                )
                self._lay(np.arange(top, bottom + overlap), np.arange(left, right + overlap), strips)
            report(Progress((i + 1) / len(rows)))
        return self.match

    def _lay(self, rows: np.ndarray, columns: np.ndarray, strips: Strips) -> None:
        """Choose a block for these rows and columns, on the torus of the result, and lay its cut."""
        shape = (rows.size, columns.size)
        own, across = (np.arange(side) for side in shape)
        at = np.ix_(rows % self.canvas.shape[0], columns % self.canvas.shape[1])
        stands = strips.mask(shape)
        if stands.any():
            source, new = self._cheapest(self.canvas[at], stands, strips)
        else:
            source = self.exemplar.anywhere(*shape, self.rng)
            new = np.ones(shape, bool)
        self._uses_of(source, shape)[...] += 1
        block = self.features[source[0] : source[0] + shape[0], source[1] : source[1] + shape[1]]
        places = np.stack(np.meshgrid(source[0] + own, source[1] + across, indexing="ij"), axis=-1)
        self.canvas[at] = np.where(new[..., None], block, self.canvas[at])
        self.match[at] = np.where(new[..., None], places, self.match[at])

    def _cheapest(
        self, before: Float32[np.ndarray, "m n c"], stands: Bool[np.ndarray, "m n"], strips: Strips
    ) -> tuple[Int64[np.ndarray, "2"], Bool[np.ndarray, "m n"]]:
        """Of some good places that whose cut costs least, dearer where it was used, and what is within."""
        errors = np.where(self.exemplar.open_places(*stands.shape), self.search.errors(before, stands), np.inf)
        enough = good_enough(errors, self.params.tolerance, self.search.noise(before, stands))
        common = float(self.uses.mean())
        found = []
        for number in range(self.params.tries):
            left = np.flatnonzero(enough)
            if not left.size:
                break
            row, column = divmod(int(left[self.rng.integers(left.size)]), enough.shape[1])
            enough[max(0, row - _APART) : row + _APART + 1, max(0, column - _APART) : column + _APART + 1] = False
            block = self.features[row : row + stands.shape[0], column : column + stands.shape[1]]
            difference = _smoothed(((block - before) ** 2).sum(axis=2), stands)
            new = laid_over(difference, strips)
            cost = float(difference[_beside_cuts(new)].sum(dtype=np.float64))
            use = float(self._uses_of(np.array([row, column]), stands.shape).mean()) / common
            found.append((cost * (1 + _REUSE * use), number, np.array([row, column]), new))
        return min(found, key=lambda entry: entry[:2])[2:]

    def _uses_of(self, source: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> Int64[np.ndarray, "p q"]:
        """How often each square of the exemplar that a block reaches into was laid; a view."""
        first, last = source // _SQUARE, (source + shape - 1) // _SQUARE + 1
        return self.uses[first[0] : last[0], first[1] : last[1]]


def _smoothed(values: Float32[np.ndarray, "m n"], inside: Bool[np.ndarray, "m n"]) -> Float32[np.ndarray, "m n"]:
    """Means over small squares of what is ``inside``; 0 elsewhere."""
    import cv2

    side = (_SMOOTHING, _SMOOTHING)
    count = cv2.blur(inside.astype(np.float32), side)
    return np.where(inside, cv2.blur(np.where(inside, values, 0), side) / np.maximum(count, 1e-3), np.float32(0))


def _beside_cuts(new: Bool[np.ndarray, "m n"]) -> Bool[np.ndarray, "m n"]:
    """Pixels with a direct neighbour on the other side of a cut."""
    beside = np.zeros_like(new)
    across, down = new[:, 1:] != new[:, :-1], new[1:] != new[:-1]
    beside[:, 1:] |= across
    beside[:, :-1] |= across
    beside[1:] |= down
    beside[:-1] |= down
    return beside


@stage(version=1, check=check_exemplar)
def quilting(image: Image, params: QuiltingParams, rng: np.random.Generator) -> Quilted:
    """Sew a texture from square blocks of the exemplar.

    Blocks are laid in scan order. Some are drawn from those that agree best with what they overlap; the one whose
    cuts through the overlaps are cheapest, and which was used little, is laid along them. Nothing is blended: every
    pixel is one of the exemplar's. Blocks are compared by all maps and hold no masked pixel; see `usable`.

    Raises
    ------
    InputError
        the exemplar is smaller than 8x8 px or than a block, or holds values that are not finite; its mask leaves no
        whole block; there is no map that is weighed.

    References
    ----------
    [Efros2001]_ section 2. Blocks are of even size, as near to ``block`` as the result allows, and not cropped at
    its end, and wider in their overlaps than the paper's. The paper draws one block; that several are cut, and
    compared by what their cuts and their repetition show, is ours.
    A tileable result is not in the paper: its last blocks overlap, and are cut along, the first ones too.
    """
    check_exemplar(params, {"image": image})
    quilt = _Quilt(image, params, rng)
    match = quilt.run()
    source = quilt.exemplar.image
    return Quilted(Image(source.pixels[match[..., 0], match[..., 1]], source.channels), match, params.tileable)
