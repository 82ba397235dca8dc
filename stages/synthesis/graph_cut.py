"""Graph-cut textures: the whole exemplar laid at many offsets, each time cut along the cheapest seam."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.common.maps import check_weights
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._seams.exemplar import Exemplar, Weights, lab_of
from texloom.stages.synthesis._seams.overlap import OverlapSearch
from texloom.stages.synthesis._seams.seams import ABSENT, FILLED, FREE, KEPT, UNIT, SeamCosts, cheapest_cut, pairs

_SMALLEST = 16  # px of the exemplar's shorter side
_WINDOW = 64  # px of a window's side at most: larger ones take longer to cut than they gain
_BAND = 64  # px around what is filled in which a seam may run
_LEAST_WINDOW = 4  # px
_SCALES = 3  # sides of windows in refinement, each half the last
_OVERLAP = 0.25  # of its area that the whole exemplar lies over: cuts that have no room tear what they meet
_OVERLAP_SHARE = 0.6  # of the largest overlap there can be, if that is less
_SHOWS = 10  # a difference of colours in CIELAB that shows along a seam
_TOO_NEAR = 3  # px: an offset closer to one that is there already brings nothing new


class GraphCutParams(Params):
    """The result's size, and how the exemplar is laid."""

    size: Size = (512, 512)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders"""
    placement: Literal["random", "entire", "subpatch"] = "entire"
    """where the exemplar is laid. `random`: anywhere over the place in question; `entire`: where all that it
    overlaps agrees; `subpatch`: where a window around the place agrees, which repeats less and has more seams.
    Refinement looks at windows, too, unless places are random"""
    looseness: float = Field(0.003, ge=0.0001, le=10)
    """how freely offsets are drawn among those that agree, as a share of the exemplar's variance; 0.001 is strict,
    1 is loose"""
    passes: int = Field(60, ge=0, le=10000)
    """refinements: each lays a piece over the window with the dearest seams and keeps it where that is cheaper"""
    gradients: bool = False
    """seams cost less where the pieces vary, as in the paper; outlines are then doubled here and there"""
    weights: Weights = Field({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


@dataclasses.dataclass(frozen=True)
class GraphCut:
    """The texture."""

    image: Image
    """the exemplar's pixels at ``match``, all maps; nothing is blended"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it comes from"""
    energy: float
    """cost of all seams"""
    tileable: bool
    """the result continues across its borders"""


def check_exemplar(params: GraphCutParams, known: Mapping[str, Any]) -> None:
    """The exemplar must be large enough to be cut."""
    image = known.get("image")
    if image is not None:
        check_weights(params.weights, image.channels)
    if image is not None and min(image.height, image.width) < _SMALLEST:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small to be cut, which takes {_SMALLEST}x{_SMALLEST} px"
        )


def _steps(image: Image) -> np.ndarray:
    """Colours in CIELAB, where a difference that shows is 1."""
    return np.asarray(lab_of(image) / np.float32(_SHOWS))


def _grid(sides: Any) -> np.ndarray:
    """Row and column of every pixel."""
    return np.asarray(np.moveaxis(np.indices(tuple(int(side) for side in sides)), 0, -1))


class _Cutter:
    """The result as it grows."""

    def __init__(self, image: Image, params: GraphCutParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, _steps, 100 / _SHOWS, params.weights)
        self.features = self.exemplar.features
        self.shape = np.array(self.features.shape[:2])
        self.size = np.array(params.size)
        self.variance = float(self.features.var(axis=(0, 1)).sum())
        self.costs = SeamCosts(self.features, params.gradients, squared=True)
        self.search = OverlapSearch(self.features)
        self.price = np.zeros(params.size, np.int64)  # of the seams at every pixel
        self.match = np.full((*params.size, 2), -1, np.int32)
        self.window = self._largest_window()
        # On a torus a piece must not meet itself.
        self.piece = np.minimum(self.shape, self.size * 3 // 4) if params.tileable else self.shape

    def _largest_window(self) -> int:
        """Side of a window; less than the usual where masks leave no larger one."""
        most = int(min(_WINDOW, self.shape.min() // 3, self.size.min() // 2))
        sides = [most >> halvings for halvings in range(8) if most >> halvings >= _LEAST_WINDOW]
        return sides[self.exemplar.first_that_fits(sides, "window")]

    # -- filling

    def fill(self) -> None:
        """Lay the exemplar until nothing is empty, always over the first empty pixel in scan order."""
        sides = np.minimum(self.piece, self.size)
        self._lay(np.zeros(2, np.int64), self.rng.integers(0, self.shape - sides + 1), sides)
        while (empty := self.match[..., 0] < 0).any():
            first = np.array(np.unravel_index(int(empty.argmax()), empty.shape))
            self.cover(first)
            report(Progress(0.5 * (1 - float(empty.mean()))))

    def cover(self, place: np.ndarray) -> None:
        """Lay the exemplar over what is empty around ``place``."""
        window = self.window
        top = self._top(place - window // 2, window)
        entire = self.params.placement == "entire"
        error = self._entire_error(top, window) if entire else self._window_error(top, window)
        source = self._draw(top, window, error)
        corner = np.clip(source + window // 2 - self.piece // 2, 0, self.shape - self.piece)
        self._lay(top - source + corner, corner, self.piece)

    def _top(self, top: np.ndarray, window: int) -> np.ndarray:
        """A window's top-left pixel inside the result."""
        return top if self.params.tileable else np.clip(top, 0, self.size - window)

    def _lines(self, top: np.ndarray, sides: np.ndarray) -> tuple[Any, np.ndarray]:
        """Index of a part of the result and which of its pixels there are."""
        lines = [first + np.arange(side) for first, side in zip(top, sides, strict=True)]
        if self.params.tileable:
            return np.ix_(*(line % side for line, side in zip(lines, self.size, strict=True))), np.ones(sides, bool)
        inside = [(line >= 0) & (line < side) for line, side in zip(lines, self.size, strict=True)]
        clipped = np.ix_(*(np.clip(line, 0, side - 1) for line, side in zip(lines, self.size, strict=True)))
        return clipped, inside[0][:, None] & inside[1]

    def _part(self, top: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sources of a part of the result, and which of its pixels are filled."""
        into, there = self._lines(top, sides)
        match = self.match[into]
        return match, there & (match[..., 0] >= 0)

    def _lay(self, top: np.ndarray, corner: np.ndarray, sides: np.ndarray, anywhere: bool = False) -> int:
        """Put the exemplar's pixels from ``corner`` on over the result's from ``top`` on; the energy won.

        Where ``anywhere`` is false seams run near what is empty only.
        """
        halo = top - 1
        into, there = self._lines(halo, sides + 2)
        old = self.match[into]
        new = (corner - 1 + _grid(sides + 2)).astype(np.int32)
        filled = old[..., 0] >= 0
        state = np.where(there & filled, KEPT, ABSENT).astype(np.int8)
        inner = state[1:-1, 1:-1]
        open_pixels = self.exemplar.open_places(1, 1)[corner[0] :, corner[1] :][: sides[0], : sides[1]]
        inner[(there & ~filled)[1:-1, 1:-1] & open_pixels] = FILLED
        near = True if anywhere else self._near(inner == FILLED)
        inner[(inner == KEPT) & near & open_pixels] = FREE
        taken, gain = cheapest_cut(self.costs, old, new, state)
        rows, columns = np.nonzero(taken)
        self.match[into[0][rows, 0], into[1][0, columns]] = new[rows, columns]
        return gain

    def _near(self, mask: np.ndarray) -> np.ndarray:
        """True up to `_BAND` px from where ``mask`` is."""
        from scipy.ndimage import maximum_filter

        return np.asarray(maximum_filter(mask, 2 * _BAND + 1, mode="constant"))

    # -- placement

    def _window_error(self, top: np.ndarray, window: int) -> np.ndarray:
        """How badly the exemplar fits a window, for each of its pixels that may go to the top-left one."""
        sides = np.array([window, window])
        match, filled = self._part(top, sides)
        if self.params.placement == "random" or not filled.any():
            return np.zeros(self.shape - sides + 1, np.float32)
        return np.asarray(self.search.errors(self.features[match[..., 0], match[..., 1]], filled))

    def _entire_error(self, top: np.ndarray, window: int) -> np.ndarray:
        """The same, over all that the whole exemplar would lie on."""
        from scipy import fft

        places = self.shape - window + 1
        match, filled = self._part(top - places + 1, self.shape + places - 1)
        middle = self.search.middle
        planes = np.where(filled[..., None], self.features[match[..., 0], match[..., 1]] - middle, 0)
        own = self.features - middle
        padded = tuple(fft.next_fast_len(int(side), real=True) for side in filled.shape)

        def correlated(area: np.ndarray, template: np.ndarray) -> np.ndarray:
            product = fft.rfft2(area, padded, workers=1) * np.conj(fft.rfft2(template, padded, workers=1))
            return np.asarray(fft.irfft2(product, padded, workers=1)[: places[0], : places[1]])

        mask = filled.astype(np.float32)
        whole = np.ones(self.shape, np.float32)
        error = correlated((planes**2).sum(axis=2), whole) + correlated(mask, (own**2).sum(axis=2))
        for channel in range(own.shape[2]):
            error -= 2 * correlated(planes[..., channel], own[..., channel])
        overlap = correlated(mask, whole)
        enough = overlap >= min(_OVERLAP * self.shape.prod(), _OVERLAP_SHARE * float(overlap.max()))
        error = np.where(enough, np.maximum(error, 0) / np.maximum(overlap, 1), np.inf)
        return np.asarray(error[::-1, ::-1], np.float32)

    def _draw(self, top: np.ndarray, window: int, error: np.ndarray) -> np.ndarray:
        """An exemplar pixel for the window's top-left one, likelier where it fits better; not one that is there."""
        error = np.where(self.exemplar.open_places(window, window), error, np.inf)
        match, filled = self._part(top, np.array([window, window]))
        known = np.zeros(error.shape, bool)
        offsets = np.unique((match - _grid(filled.shape))[filled], axis=0)
        for row, column in offsets:
            rows = slice(max(0, row - _TOO_NEAR), max(0, row + _TOO_NEAR + 1))
            known[rows, max(0, column - _TOO_NEAR) : max(0, column + _TOO_NEAR + 1)] = True
        fresh = np.where(known, np.inf, error)
        error = fresh if np.isfinite(fresh).any() else error
        worse = (error - error.min()).astype(np.float64)
        chances = np.cumsum(np.exp(-worse / (self.params.looseness * self.variance + 1e-12)))
        index = int(np.searchsorted(chances, self.rng.random() * chances[-1], side="right"))
        return np.array(divmod(min(index, error.size - 1), error.shape[1]))

    # -- refinement

    def _weigh(self, top: np.ndarray, sides: np.ndarray) -> None:
        """Note the cost of the seams of a part of the result: at each pixel those below it and to its right."""
        match, there = self._part(top, sides + 1)
        found = np.zeros(sides + 1, np.int64)
        for axis, ahead in enumerate((found[:-1], found[:, :-1])):
            both = np.logical_and(*pairs(there, axis))
            ahead[both] += self.costs.between(axis, *(one[both] for one in pairs(match, axis)))
        into, inside = self._lines(top, sides)
        rows, columns = np.nonzero(inside)
        self.price[into[0][rows, 0], into[1][0, columns]] = found[:-1, :-1][inside]

    def refine(self) -> int:
        """Lay pieces over the dearest windows; the energy left, in steps of 1 / `UNIT`."""
        self._weigh(np.zeros(2, np.int64), self.size)
        energy = int(self.price.sum())
        tried = np.zeros(self.match.shape[:2], np.float64)
        for number in range(self.params.passes):
            if energy == 0:
                break
            window = max(4, self.window >> number % _SCALES)
            sides = np.array([window, window])
            top = self._top(self._dearest(tried, window) - window // 2, window)
            source = self._draw(top, window, self._window_error(top, window))
            margin = np.minimum(self.window // 2, source)
            corner = source - margin
            reach = np.minimum(
                np.minimum(sides + margin + self.window // 2, self.shape - corner), self.size * 3 // 4
            )
            start, stop = top - margin, top - margin + reach
            if not self.params.tileable:
                clipped = np.clip(start, 0, None)
                corner, start, stop = corner + clipped - start, clipped, np.minimum(stop, self.size)
            energy -= self._lay(start, corner, stop - start, anywhere=True)
            into, _ = self._lines(top, sides)
            tried[into] += 1
            self._weigh(start - 1, stop - start + 1)
            done = 0.5 + 0.5 * (number + 1) / self.params.passes
            report(Progress(done, iteration=number + 1, iterations=self.params.passes, energy=energy / UNIT))
        return energy

    def _dearest(self, tried: np.ndarray, window: int) -> np.ndarray:
        """Middle of the window whose seams cost most, those counting less that were tried before."""
        from scipy.ndimage import uniform_filter

        mode = "wrap" if self.params.tileable else "constant"
        sums = uniform_filter(self.price / (1 + tried), window, mode=mode)
        return np.array(np.unravel_index(int(sums.argmax()), sums.shape))


@stage(version=1, check=check_exemplar)
def graph_cut(image: Image, params: GraphCutParams, rng: np.random.Generator) -> GraphCut:
    """Lay the exemplar over the result again and again, and cut each copy along the seam that shows least.

    Copies go first over what is empty, then over the dearest seams, where a copy is kept only as far as it lowers
    the cost of all seams. These are weighed by all maps, and a copy has holes where the exemplar is masked; see
    `usable`. A result no larger than the exemplar that need not tile is cut out of it.

    Raises
    ------
    InputError
        the exemplar is smaller than 16x16 px, or holds values that are not finite; its mask leaves nothing to lay;
        there is no map that is weighed.

    References
    ----------
    [Kwatra2003]_ sections 3 and 4. Seams are not forced to stay off a copy's border, where their cost is known too;
    and refinement forces no pixel to change, so that the cost never rises. No feathering afterwards. The paper
    divides costs by gradients; we do so only if asked. Its costs are differences, ours the squares of those in
    CIELAB.
    """
    check_exemplar(params, {"image": image})
    cutter = _Cutter(image, params, rng)
    cutter.fill()
    energy = cutter.refine()
    match = cutter.match.astype(np.uint32)
    source = cutter.exemplar.image
    pixels = np.ascontiguousarray(source.pixels[match[..., 0], match[..., 1]])
    return GraphCut(Image(pixels, source.channels), match, energy / UNIT, params.tileable)
