"""Graph-cut textures: copies of the exemplar at many offsets, each joined along a minimum cut."""

import dataclasses
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.kernels.core.elementary_functions import complex_product, exp
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT
from texloom.stages.synthesis.stitching.exemplar import Exemplar, Stitched, StitchingParams, check_exemplar, lab_of
from texloom.stages.synthesis.stitching.overlap import OverlapSearch
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts, cheapest_cut, pairs
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.progress import Progress, report

_MIN_SIDE = 16  # px of the exemplar's shorter side
_MAX_WINDOW = 64  # px of a window's side: larger ones take longer to cut than they gain
_MIN_WINDOW = 4  # px
_BAND = 64  # px around empty pixels in which a seam may run
_SCALES = 3  # sides of windows in refinement, each half the one before
_MIN_OVERLAP = 0.25  # share of the exemplar's area, so that cuts have room
_MIN_RELATIVE_OVERLAP = 0.6  # of the largest possible overlap, if that is less
_VISIBLE = 10  # CIELAB difference that is visible along a seam
_MIN_SEPARATION = 3  # px between an offset and those that are used in the window already


class GraphCutParams(StitchingParams):
    """Size of the result, and the placement of copies."""

    placement: Literal["random", "entire", "subpatch"] = "entire"
    """placement of a copy. `random`: random offset; `entire`: offset at which its whole overlap matches;
    `subpatch`: offset at which a window matches, with less repetition and more seams. Refinement matches
    windows, unless placement is random"""
    looseness: float = Field(0.003, ge=0.0001, le=10)
    """temperature at which offsets are drawn by their error, relative to the exemplar's variance; 0.001 is
    strict, 1 is loose"""
    passes: int = Field(60, ge=0, le=10000)
    """refinement passes: each lays a copy over the window of costliest seams, as far as it lowers their cost"""
    location: Literal["costliest", "random", "minima", "extrema"] = "costliest"
    """where refinement lays a copy: `costliest`: over the highest cost of seams in a window; `random`: anywhere;
    `minima`, `extrema`: at a random local minimum, or minimum or maximum, of that cost"""
    gradients: bool = False
    """divide seam costs by gradients, as in the paper; some outlines are then doubled"""


@dataclasses.dataclass(frozen=True)
class GraphCut(Stitched):
    """The texture; nothing is blended."""

    energy: float
    """cost of all seams"""


def _scaled_lab(image: Image) -> np.ndarray:
    """CIELAB colours, scaled so that a visible difference is 1."""
    return np.asarray(lab_of(image) / np.float32(_VISIBLE))


def _grid(sides: Any) -> np.ndarray:
    """Row and column of every pixel."""
    return np.asarray(np.moveaxis(np.indices(tuple(int(side) for side in sides)), 0, -1))


class Synthesis:
    """The result during synthesis."""

    def __init__(self, image: Image, params: GraphCutParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, _scaled_lab, 100 / _VISIBLE, params.weights)
        self.features = self.exemplar.features
        self.shape = np.array(self.features.shape[:2])
        self.size = np.array(params.size)
        self.variance = float(self.features.var(axis=(0, 1)).sum())
        self.costs = SeamCosts(self.features, params.gradients, squared=True)
        self.search = OverlapSearch(self.features)
        self.seam_cost = np.zeros(params.size, np.int64)  # of every pixel with those below and to the right
        self.match = np.full((*params.size, 2), -1, np.int32)
        self.window = self._largest_window()
        self.wrap = np.array(params.tileable)
        # Where the result wraps a copy must not meet itself.
        self.copy_size = np.where(self.wrap, np.minimum(self.shape, self.size * 3 // 4), self.shape)

    def _largest_window(self) -> int:
        """Side of a window; smaller than the default where the mask leaves no larger one."""
        default = int(min(_MAX_WINDOW, self.shape.min() // 3, self.size.min() // 2))
        sides = [default >> halvings for halvings in range(8) if default >> halvings >= _MIN_WINDOW]
        return sides[self.exemplar.first_that_fits(sides, "window")]

    # -- filling

    def fill(self) -> None:
        """Lay copies over the first empty pixel in scan order until none is left."""
        sides = np.minimum(self.copy_size, self.size)
        self._lay(np.zeros(2, np.int64), self.rng.integers(0, self.shape - sides + 1), sides)
        while (empty := self.match[..., 0] < 0).any():
            first = np.array(np.unravel_index(int(empty.argmax()), empty.shape))
            self._cover(first)
            report(Progress(0.5 * (1 - float(empty.mean()))))

    def _cover(self, place: np.ndarray) -> None:
        """Lay a copy over the empty pixels around ``place``."""
        window = self.window
        top = self._top(place - window // 2, window)
        entire = self.params.placement == "entire"
        error = self.entire_error(top, window) if entire else self._window_error(top, window)
        source = self._draw(top, window, error)
        corner = np.clip(source + window // 2 - self.copy_size // 2, 0, self.shape - self.copy_size)
        self._lay(top - source + corner, corner, self.copy_size)

    def _top(self, top: np.ndarray, window: int) -> np.ndarray:
        """Top-left pixel of a window, moved into the result along axes that are not tileable."""
        return np.where(self.wrap, top, np.clip(top, 0, self.size - window))

    def _lines(self, top: np.ndarray, sides: np.ndarray) -> tuple[Any, np.ndarray]:
        """Index of a rectangle of the result, and which of its pixels are inside."""
        lines, inside = [], []
        for first, side, length, around in zip(top, sides, self.size, self.wrap, strict=True):
            line = first + np.arange(side)
            lines.append(line % length if around else np.clip(line, 0, length - 1))
            inside.append(around | ((line >= 0) & (line < length)))
        return np.ix_(*lines), inside[0][:, None] & inside[1]

    def _part(self, top: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sources of a rectangle of the result, and which of its pixels are filled."""
        into, inside = self._lines(top, sides)
        match = self.match[into]
        return match, inside & (match[..., 0] >= 0)

    def _lay(self, top: np.ndarray, corner: np.ndarray, sides: np.ndarray, anywhere: bool = False) -> int:
        """Lay a rectangle of the exemplar at ``corner`` over the result at ``top``; the energy saved.

        Unless ``anywhere``, only pixels near empty ones may be replaced.
        """
        halo = top - 1
        into, present = self._lines(halo, sides + 2)
        old = self.match[into]
        new = (corner - 1 + _grid(sides + 2)).astype(np.int32)
        filled = old[..., 0] >= 0
        state = np.where(present & filled, KEPT, ABSENT).astype(np.int8)
        inner = state[1:-1, 1:-1]
        open_pixels = self.exemplar.open_places(1, 1)[corner[0] :, corner[1] :][: sides[0], : sides[1]]
        inner[(present & ~filled)[1:-1, 1:-1] & open_pixels] = FILLED
        near = True if anywhere else self._near(inner == FILLED)
        inner[(inner == KEPT) & near & open_pixels] = FREE
        taken, gain = cheapest_cut(self.costs, old, new, state)
        rows, columns = np.nonzero(taken)
        self.match[into[0][rows, 0], into[1][0, columns]] = new[rows, columns]
        return gain

    def _near(self, pixels: np.ndarray) -> np.ndarray:
        """``pixels`` dilated by `_BAND` px."""
        ndimage = loaded("scipy.ndimage")
        return np.asarray(ndimage.maximum_filter(pixels, 2 * _BAND + 1, mode="constant"))

    # -- placement

    def _window_error(self, top: np.ndarray, window: int) -> np.ndarray:
        """Mean squared difference of a window to each place of the exemplar; 0 for random placement."""
        sides = np.array([window, window])
        match, filled = self._part(top, sides)
        if self.params.placement == "random" or not filled.any():
            return np.zeros(self.shape - sides + 1, np.float32)
        return np.asarray(self.search.errors(self.features[match[..., 0], match[..., 1]], filled))

    def entire_error(self, top: np.ndarray, window: int) -> np.ndarray:
        """The same over the whole overlap of a copy that puts each place of the exemplar at the window."""
        fft = loaded("scipy.fft")
        places = self.shape - window + 1
        match, filled = self._part(top - places + 1, self.shape + places - 1)
        middle = self.search.middle
        planes = np.where(filled[..., None], self.features[match[..., 0], match[..., 1]] - middle, 0)
        exemplar = self.features - middle
        padded = tuple(fft.next_fast_len(int(side), real=True) for side in filled.shape)

        def correlated(area: np.ndarray, template: np.ndarray) -> np.ndarray:
            spectrum, own = (fft.rfft2(part, padded, workers=1) for part in (area, template))
            product = complex_product(spectrum, np.conj(own))
            return np.asarray(fft.irfft2(product, padded, workers=1)[: places[0], : places[1]])

        mask = filled.astype(np.float32)
        whole = np.ones(self.shape, np.float32)
        error = correlated((planes**2).sum(axis=2), whole) + correlated(mask, (exemplar**2).sum(axis=2))
        for channel in range(exemplar.shape[2]):
            error -= 2 * correlated(planes[..., channel], exemplar[..., channel])
        overlap = correlated(mask, whole)
        sufficient = overlap >= min(_MIN_OVERLAP * self.shape.prod(), _MIN_RELATIVE_OVERLAP * float(overlap.max()))
        error = np.where(sufficient, np.maximum(error, 0) / np.maximum(overlap, 1), np.inf)
        return np.asarray(error[::-1, ::-1], np.float32)

    def _draw(self, top: np.ndarray, window: int, error: np.ndarray) -> np.ndarray:
        """Draw a source for the window's top-left pixel by its error; offsets used in the window are excluded."""
        error = np.where(self.exemplar.open_places(window, window), error, np.inf)
        match, filled = self._part(top, np.array([window, window]))
        used = np.zeros(error.shape, bool)
        offsets = np.unique((match - _grid(filled.shape))[filled], axis=0)
        for row, column in offsets:
            rows = slice(max(0, row - _MIN_SEPARATION), max(0, row + _MIN_SEPARATION + 1))
            used[rows, max(0, column - _MIN_SEPARATION) : max(0, column + _MIN_SEPARATION + 1)] = True
        unused = np.where(used, np.inf, error)
        error = unused if np.isfinite(unused).any() else error
        excess = (error - error.min()).astype(np.float64)
        cumulative = np.cumsum(exp(-excess / (self.params.looseness * self.variance + 1e-12)))
        index = int(np.searchsorted(cumulative, self.rng.random() * cumulative[-1], side="right"))
        return np.array(divmod(min(index, error.size - 1), error.shape[1]))

    # -- refinement

    def _measure(self, top: np.ndarray, sides: np.ndarray) -> None:
        """Update the seam costs of a rectangle of the result."""
        match, present = self._part(top, sides + 1)
        cost = np.zeros(sides + 1, np.int64)
        for axis, view in enumerate((cost[:-1], cost[:, :-1])):
            both = np.logical_and(*pairs(present, axis))
            view[both] += self.costs.between(axis, *(sources[both] for sources in pairs(match, axis)))
        into, inside = self._lines(top, sides)
        rows, columns = np.nonzero(inside)
        self.seam_cost[into[0][rows, 0], into[1][0, columns]] = cost[:-1, :-1][inside]

    def refine(self) -> int:
        """Lay copies over the costliest windows; the remaining energy, in steps of 1 / `UNIT`."""
        self._measure(np.zeros(2, np.int64), self.size)
        energy = int(self.seam_cost.sum())
        visits = np.zeros(self.match.shape[:2], np.float64)
        for number in range(self.params.passes):
            if energy == 0:
                break
            window = max(_MIN_WINDOW, self.window >> number % _SCALES)
            energy -= self._refine_window(visits, window)
            done = 0.5 + 0.5 * (number + 1) / self.params.passes
            report(Progress(done, iteration=number + 1, iterations=self.params.passes, energy=energy / UNIT))
        if energy == 0 or not self.params.passes:
            report(Progress(1.0, energy=energy / UNIT))
        return energy

    def _refine_window(self, visits: np.ndarray, window: int) -> int:
        """Lay a copy over the costliest window, with a margin around it for its seams; the energy saved."""
        sides = np.array([window, window])
        top = self._top(self._location(visits, window) - window // 2, window)
        source = self._draw(top, window, self._window_error(top, window))
        margin = np.minimum(self.window // 2, source)
        corner = source - margin
        reach = np.minimum(np.minimum(sides + margin + self.window // 2, self.shape - corner), self.size * 3 // 4)
        start, stop = top - margin, top - margin + reach
        clipped = np.where(self.wrap, start, np.clip(start, 0, None))
        corner, start = corner + clipped - start, clipped
        stop = np.where(self.wrap, stop, np.minimum(stop, self.size))
        saved = self._lay(start, corner, stop - start, anywhere=True)
        into, _ = self._lines(top, sides)
        visits[into] += 1
        self._measure(start - 1, stop - start + 1)
        return saved

    def _location(self, visits: np.ndarray, window: int) -> np.ndarray:
        """Middle of the window to refine, by the seam costs in it divided by 1 + ``visits``."""
        ndimage = loaded("scipy.ndimage")
        mode = self.params.tileable.modes("constant")
        sums = ndimage.uniform_filter(self.seam_cost / (1 + visits), window, mode=mode)
        if self.params.location == "costliest":
            return np.array(np.unravel_index(int(sums.argmax()), sums.shape))
        if self.params.location == "random":
            return self.rng.integers(0, self.size)
        filters = (
            [ndimage.minimum_filter]
            if self.params.location == "minima"
            else [ndimage.minimum_filter, ndimage.maximum_filter]
        )
        places = np.argwhere(
            np.logical_or.reduce([sums == extreme(sums, window, mode=mode) for extreme in filters])
        )
        return np.asarray(places[self.rng.integers(len(places))])


@stage(version=1, check=partial(check_exemplar, min_side=_MIN_SIDE), exemplar_bytes=60, result_bytes=70)
def graph_cut(image: Image, params: GraphCutParams, rng: np.random.Generator) -> GraphCut:
    """Lay copies of the exemplar over the result, each joined along the minimum cut.

    Copies first fill empty pixels, then are laid over the costliest seams, where they replace pixels only as far as
    that lowers the cost of all seams. Seam costs compare all maps, and copies have holes where the exemplar is
    masked; see `usable`. A result no larger than the exemplar that is not tileable is a crop of it.

    Parameters
    ----------
    image : the exemplar; all channels are copied together.

    Raises
    ------
    InputError
        the exemplar is smaller than 16 x 16 px, or holds values that are not finite; its mask leaves no window of 4
        px; ``weights`` names a map that it lacks.

    References
    ----------
    [Kwatra2003]_ sections 3 and 4. Seams may run along a copy's border, where their cost is known too, and
    refinement forces no pixel to change, so that the cost never rises. There is no feathering. Costs are
    squared differences in CIELAB, where the paper's are differences, divided by gradients on request only.
    [Lin2004]_ Figure 46 for the other locations of refinement.
    """
    synthesis = Synthesis(image, params, rng)
    synthesis.fill()
    energy = synthesis.refine()
    match = synthesis.match.astype(np.uint32)
    exemplar = synthesis.exemplar.image
    pixels = np.ascontiguousarray(exemplar.pixels[match[..., 0], match[..., 1]])
    return GraphCut(exemplar.elsewhere(pixels).wrapping(params.tileable), match, energy / UNIT)
