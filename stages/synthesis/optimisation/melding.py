"""Search and vote of image melding: exemplar patches with gain and bias, and votes for gradients."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.common.grids.screened_poisson import screened_poisson
from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.core.threads import run_all, run_spans
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.match_search import Effort, strip_phases
from texloom.stages.synthesis.optimisation.vote import Window, weights_along
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

_COLORS = 3


@dataclass(frozen=True)
class Bounds:
    """Bounds of gain and bias; those of the bias in CIELAB units."""

    min_gain: float
    max_gain: float
    bias_lightness: float
    bias_color: float


def forward_gradients(
    planes: Float32[np.ndarray, "h w c"], wrap: Wraps
) -> tuple[Float32[np.ndarray, "h w c"], Float32[np.ndarray, "h w c"]]:
    """Differences to the pixel below and to the right; 0 at the last ones where the planes do not wrap."""
    below, beside = (np.roll(planes, -1, axis) - planes for axis in (0, 1))
    if not wrap.down:
        below[-1] = 0
    if not wrap.across:
        beside[:, -1] = 0
    return below, beside


class Melding:
    """Search and vote at one scale, where the exemplar is fixed.

    Parameters
    ----------
    planes : of the exemplar, CIELAB colours and then maps.
    gradient_weight : weight of squared differences of lightness gradients, and of gradients in the vote.
    allowed : the permitted exemplar patches, which include all initial matches; none permits all.
    wrap : where the target wraps.
    """

    def __init__(
        self,
        planes: Float32[np.ndarray, "h w c"],
        patch_size: int,
        gradient_weight: float,
        bounds: Bounds,
        allowed: Bool[np.ndarray, "m n"] | None,
        wrap: Wraps,
    ):
        from texloom.stages.kernels.patchmatch.gain_bias import Limits

        self.size = patch_size
        self.gradient_weight = gradient_weight
        self.wrap = wrap
        self.exemplar = self._side(planes, NOWHERE)
        bias = np.array([bounds.bias_lightness, bounds.bias_color, bounds.bias_color]) * UNIT
        self.limits = Limits(np.full(3, float(bounds.min_gain)), np.full(3, float(bounds.max_gain)), bias)
        places = self.exemplar.gradients.shape
        self.allowed = np.ones(places, np.bool_) if allowed is None else allowed
        self.run = (np.int8(0),) * patch_size

    def _side(self, planes: np.ndarray, wrap: Wraps) -> "Side":  # type: ignore[name-defined]
        """Features of a target or an exemplar, with the statistics of its patches."""
        from texloom.stages.kernels.patchmatch.gain_bias import Side

        slopes = np.concatenate(forward_gradients(planes[..., :1], wrap), axis=2)
        slopes *= np.float32(np.sqrt(self.gradient_weight))
        whole = np.concatenate([planes[..., :_COLORS], slopes, planes[..., _COLORS:]], axis=2)
        height, width, channels = whole.shape
        fixed = np.moveaxis(fixed_point(whole).reshape(height, width, channels), 2, 0)
        if wrap:
            beyond = [(0, extra) for extra in wrap.where_closed(self.size - 1)]
            fixed = np.pad(fixed, [(0, 0), *beyond], mode="wrap")
        fixed = np.ascontiguousarray(fixed)
        sums = [box_sums(plane.astype(np.int64), self.size) for plane in fixed[:_COLORS]]
        squares = [box_sums(plane.astype(np.int64) ** 2, self.size) for plane in fixed]
        pixels = self.size**2
        mean = np.stack(sums) / pixels
        variance = np.stack(squares[:_COLORS]) / pixels - mean**2
        none = np.zeros_like(squares[0])
        gradients = np.sqrt(sum(squares[_COLORS : _COLORS + 2], none).astype(np.float64))
        maps = np.sqrt(sum(squares[_COLORS + 2 :], none).astype(np.float64))
        return Side(fixed, mean, np.sqrt(np.maximum(variance, 0)), gradients, maps)

    def step(
        self, target: Float32[np.ndarray, "H W c"], match: Patches, effort: Effort, random: np.random.Generator
    ) -> tuple[float, float, float]:
        """Improve ``match`` in place.

        Returns
        -------
        energy per patch, CIELAB units squared; 0; share of changed matches.
        """
        from texloom.stages.kernels.patchmatch.gain_bias import GainBiasScan, fitted_distances, fitted_sweep

        row, column = match
        own = self._side(target, self.wrap)
        distance = np.empty(row.shape, np.float64)
        shared = (self.run, own, self.exemplar, self.limits, row, column, distance)
        run_spans(fitted_distances, shared, row.shape[0], 16)
        phases = strip_phases(row.shape[0])
        radius, tries, total = max(self.allowed.shape), effort.tries, 0
        forward = bool(random.integers(2))
        for _ in range(effort.sweeps):
            scan = GainBiasScan(forward, self.wrap, radius, tries, random.integers(2**64, dtype=np.uint64))
            changed = 0
            for phase in phases:
                calls = [(*shared, self.allowed, scan, *span) for span in phase]
                changed += sum(run_all(fitted_sweep, calls))
            total += changed
            if changed <= effort.tolerance * row.size:
                break
            forward = not forward
            radius = max(5, radius // 2)
            tries = max(1, tries - 1) if effort.tries else 0
        return float(distance.sum()) / (row.size * UNIT**2 * self.size**2), 0.0, total / row.size

    def vote(
        self,
        match: Patches,
        target: Float32[np.ndarray, "H W c"],
        planes: Float32[np.ndarray, "h w c"],
        window: Window,
    ) -> Float32[np.ndarray, "H W c"]:
        """The next target: fitted patches vote for values, colours also for gradients.

        Parameters
        ----------
        target : the current one, to which the patches are fitted.
        planes : of the exemplar.
        """
        from texloom.stages.kernels.patchmatch.gain_bias import fit_matches

        row, column = match
        gain = np.empty((_COLORS, *row.shape), np.float32)
        bias = np.empty_like(gain)
        own = self._side(target, self.wrap)
        run_spans(fit_matches, (own, self.exemplar, self.limits, row, column, gain, bias), row.shape[0], 16)
        bias /= UNIT
        neutral = np.ones(row.shape, np.float32), np.zeros(row.shape, np.float32)
        voted = [
            self._voted(match, planes[..., place], gain[place], bias[place], window)
            if place < _COLORS
            else self._voted(match, planes[..., place], *neutral, window)
            for place in range(planes.shape[2])
        ]
        slopes = forward_gradients(planes[..., :_COLORS], NOWHERE)
        for place in range(_COLORS if self.gradient_weight > 0 else 0):
            wanted = [self._voted(match, slope[..., place], gain[place], neutral[1], window) for slope in slopes]
            voted[place] = meld(voted[place], wanted[0], wanted[1], self.gradient_weight, self.wrap)
        return np.stack(voted, axis=2)

    def _voted(
        self, match: Patches, plane: np.ndarray, gain: np.ndarray, bias: np.ndarray, window: Window
    ) -> np.ndarray:
        """Mean of the votes for a plane."""
        from texloom.stages.kernels.patchmatch.gain_bias import fitted_votes

        (row, column), size = match, self.size
        weights = window.astype(np.float32)
        along = list(map(weights_along, row.shape, (window, window), self.wrap))
        sums = np.empty((along[0].size, row.shape[1] + size - 1), np.float32)
        own = np.ascontiguousarray(plane)
        run_spans(fitted_votes, (row, column, own, gain, bias, weights, self.wrap, sums), along[0].size, 16)
        return np.asarray(sums[:, : along[1].size] / np.outer(*along).astype(np.float32))


def meld(
    values: Float32[np.ndarray, "H W"],
    below: Float32[np.ndarray, "H W"],
    beside: Float32[np.ndarray, "H W"],
    weight: float,
    wrap: Wraps,
) -> Float32[np.ndarray, "H W"]:
    """The plane closest to ``values``, and with ``weight`` to the gradients, in squared differences.

    Parameters
    ----------
    below, beside : wanted differences to the pixel below and to the right; the last ones count only where it wraps.
    """
    excess = np.zeros_like(values)
    for axis, wanted in enumerate((below, beside)):
        missing = wanted - (np.roll(values, -1, axis) - values)
        if not wrap[axis]:
            missing[(slice(None),) * axis + (-1,)] = 0
        excess += missing - np.roll(missing, 1, axis)
    return values + screened_poisson(excess, float(np.sqrt(weight)), wrap)


def box_sums(plane: np.ndarray, size: int) -> np.ndarray:
    """Sums over all squares of ``size`` px, exact for integers."""
    sums = np.zeros((plane.shape[0] + 1, plane.shape[1] + 1), plane.dtype)
    np.cumsum(np.cumsum(plane, axis=0), axis=1, out=sums[1:, 1:])
    down = sums[size:] - sums[:-size]
    return np.asarray(down[:, size:] - down[:, :-size])
