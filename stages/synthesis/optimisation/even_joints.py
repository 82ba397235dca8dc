"""Colours without steps of tone at joints: those that are seen are spread over the pieces beside them."""

import math

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.growing import grown
from texloom.stages.common.grids.parts import LARGEST_WHOLE, parts_with_margins
from texloom.stages.common.grids.screened_poisson import neighbours, screened_poisson
from texloom.stages.common.grids.working_size import reduction
from texloom.stages.common.source_maps.source_gradients import source_gradients
from texloom.stages.common.source_maps.tone_steps import SEEN, ToneSteps
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import FilledExemplar
from texloom.stages.vocabulary.scratch import empty, release

_NEAR = 5  # px from a joint within which gradients are brought to the exemplar's
_REACH = 48.0  # px from a joint over which its step is spread
_REACHES = 8  # margin of a part, over which a change falls below the rounding of 8 bits
_LIMIT = 0.3  # of the deviation of the exemplar's colours; larger differences are contours that do not meet
_BLACK = np.float32(0.1)  # of mean light; the logarithm is that of light and this, as darkness hides differences


class EvenJoints:
    """Spreads the steps of tone that are seen at joints, see `ToneSteps`.

    The logarithm of colours changes by a smooth field. Within 5 px of such a step its gradients are, as nearly as
    possible, what the result's lack to be those of the exemplar, and 0 elsewhere; with weight 1 / 48 px squared the
    field is 0 itself, so that pieces have their own tone away from joints. Differences beyond .3 of the exemplar's
    deviation, where contours do not meet, stay.

    Parameters
    ----------
    exemplar : of which colour alone counts; masked pixels have no influence.

    References
    ----------
    Ours. [Perez2003]_ for gradients across seams; [Bhat2008]_ for the screened Poisson equation.
    """

    def __init__(self, exemplar: Image):
        filled = FilledExemplar.of(exemplar)
        self.colors = 1 if exemplar.channels[0] == "Y" else 3
        self.exemplar, self.usable = filled.image.pixels[..., : self.colors], filled.valid
        # NumPy is fast along the first axis.
        self.range = self.exemplar.min(axis=0).min(axis=0), self.exemplar.max(axis=0).max(axis=0)
        step = reduction(exemplar.height, exemplar.width)
        color = self.exemplar[::step, ::step]
        self.black = max(_BLACK * color.mean(dtype=np.float64).astype(np.float32), np.float32(1e-6))
        planes = np.moveaxis(self._logarithm(color), 2, 0)
        self.limit = _LIMIT * math.hypot(*(float(plane.std(dtype=np.float64)) for plane in planes))
        self.steps = ToneSteps(
            (exemplar.height, exemplar.width), lambda first, last: self._compared(self.exemplar[first:last])
        )

    def apply(self, made: Image, match: Correspondence, wraps: Wraps) -> None:
        """Change the colours of ``made`` in place.

        Parameters
        ----------
        match : source of each pixel in the exemplar.
        wraps : where the result continues across its border.
        """
        color = made.pixels[..., : self.colors]
        if made.height * made.width <= LARGEST_WHOLE:
            changed = self._changed(color, match, wraps)
            if changed is not None:
                color[:] = changed
            return
        even, margin = empty(color.shape, np.float32), math.ceil(_REACHES * _REACH)
        for rows, columns, inner in parts_with_margins(made.height, made.width, margin, wraps):
            place, own = np.ix_(rows, columns), (rows[inner[0]][:, None], columns[inner[1]])
            part = self._changed(color[place], match[place], NOWHERE)
            even[own] = color[own] if part is None else part[inner]
            release(even, made.pixels, match)
        color[:] = even

    def _changed(
        self, color: Float32[np.ndarray, "H W c"], match: Correspondence, wraps: Wraps
    ) -> Float32[np.ndarray, "H W c"] | None:
        """Colours without steps; none where no step is seen."""
        near = self._near_steps(color, match, wraps)
        excess = None if near is None else self._excess(color, match, wraps, near)
        if excess is None:
            return None
        changed = np.empty_like(color)
        for place, (plane, low, high) in enumerate(zip(excess, *self.range, strict=True)):
            change = exp(screened_poisson(plane, _REACH, wraps))
            changed[..., place] = np.clip((color[..., place] + self.black) * change - self.black, low, high)
        return changed

    def _near_steps(self, color: Float32[np.ndarray, "H W c"], match: Correspondence, wraps: Wraps) -> Mask | None:
        """True near a step that is seen; none where there is none."""
        seen = self.steps.at_joints(self._compared(color), match, wraps) > SEEN
        return grown(seen, _NEAR, wraps) if seen.any() else None

    def _excess(
        self, color: Float32[np.ndarray, "H W c"], match: Correspondence, wraps: Wraps, near: Mask
    ) -> Float32[np.ndarray, "c H W"] | None:
        """Divergence of the gradients that the result lacks, outflow minus inflow; none where it lacks none."""
        excess = np.zeros((self.colors, *near.shape), np.float32)
        for axis in (0, 1):
            for first, second in neighbours(near.shape[0], axis, wraps):
                both = near[first] & near[second]
                if not both.any():
                    continue
                ends = match[first][both], match[second][both]
                wanted, known = source_gradients(self._own, self.exemplar.shape, *ends, self.usable, axis)
                missing = wanted - (self._logarithm(color[second][both]) - self._logarithm(color[first][both]))
                missing[~known | ((missing * missing).sum(axis=1) > self.limit**2)] = 0
                for plane, lacking in zip(excess, missing.T, strict=True):
                    plane[first][both] += lacking
                    plane[second][both] -= lacking
        return excess if excess.any() else None

    def _own(self, row: np.ndarray, column: np.ndarray) -> Float32[np.ndarray, "n c"]:
        return self._logarithm(self.exemplar[row, column])

    def _logarithm(self, color: Float32[np.ndarray, "*n c"]) -> Float32[np.ndarray, "*n c"]:
        return log(np.maximum(color, 0) + self.black)

    def _compared(self, color: Float32[np.ndarray, "H W c"]) -> Float32[np.ndarray, "H W c"]:
        """CIELAB; L alone of grey pictures."""
        return lab_from_linear(np.repeat(color, 3, axis=2) if self.colors == 1 else color)[..., : self.colors]
