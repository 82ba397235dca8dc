"""Joints of a source map: where they are, and how unlike the exemplar's own patches are those across them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.common.similarity.patch_distance import SIDE, NearestPatches, Patches, Places, patch_contrast
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.vocabulary.arrays import Correspondence, Mask, ScalarMap
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import count_excluded

_STEPS = (1, 2, 4)  # px between the samples of a patch, for each scale
_MAX_CELLS = 2048
_MIN_CELL = 4  # px
_CONTRASTS = 8  # groups of the exemplar's patches
_USUAL = 0.8  # quantile of a group's distances
_OF_MEAN = 1.5  # that quantile over the mean where distances are those of noise


class NoPatchError(ValueError):
    """Masks leave no patch of the exemplar."""


def steps_for(shorter: int) -> list[int]:
    """Px between the samples of a patch, for each scale for which a picture's shorter side suffices."""
    return [step for step in _STEPS if shorter >= 4 * SIDE * step]


def cell_side(pixels: int) -> int:
    """Side of the cells of a result of ``pixels``, in each of which one joint is measured, px."""
    return max(_MIN_CELL, int(np.ceil(np.sqrt(pixels / _MAX_CELLS))))


def joint_contrast(
    exemplar: Float32[np.ndarray, "h w c"],
    result: Float32[np.ndarray, "H W c"],
    match: Correspondence,
    wraps: Wraps = NOWHERE,
) -> Float32[np.ndarray, "H W"]:
    """How much a pixel's right or lower neighbour differs from the neighbour of its source; -1 where both are kept.

    The larger of both directions and both sides, squared CIELAB units. Where the source has no such neighbour, 0.
    """
    from texloom.stages.kernels.seams import joint_contrast as kernels

    contrast = np.empty(match.shape[:2], np.float32)
    run_spans(kernels.joint_contrast, (exemplar, result, match, wraps, contrast), len(match), thread_count())
    return contrast


def worst_of_cells(contrast: ScalarMap, cell: int) -> Places:
    """The pixel of largest contrast in every cell of ``cell`` px that has a joint; of equals the first."""
    height, width = contrast.shape
    rows, columns = -(-height // cell), -(-width // cell)
    padded = np.full((rows * cell, columns * cell), -1, np.float32)
    padded[:height, :width] = contrast
    cells = padded.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(rows * columns, cell * cell)
    best = cells.argmax(axis=1)
    number = np.flatnonzero(cells[np.arange(len(cells)), best] >= 0)
    inner = np.stack(np.divmod(best[number], cell), axis=1)
    return np.asarray(np.stack(np.divmod(number, columns), axis=1) * cell + inner, np.int64)


class _UsualDistance:
    """The squared distance that an exemplar's patches have from each other, by their contrast.

    Patches across the edges of tiles or bricks have few like them, even in the exemplar, where most of it is flat.

    Parameters
    ----------
    contrast, distance : of the exemplar's patches, see `NearestPatches.own_distances`.
    """

    def __init__(self, contrast: Float32[np.ndarray, "n"], distance: Float32[np.ndarray, "n"]):  # type: ignore[name-defined]
        self.mean = max(float(distance.mean(dtype=np.float64)), 1e-12)
        groups = np.array_split(np.argsort(contrast, kind="stable"), min(_CONTRASTS, len(contrast)))
        self.contrast = np.array([contrast[group].mean(dtype=np.float64) for group in groups])
        usual = [float(np.quantile(distance[group], _USUAL)) / _OF_MEAN for group in groups]
        self.distance = np.maximum.accumulate(usual)

    def at(self, contrast: Float32[np.ndarray, "n"]) -> Float64[np.ndarray, "*n"]:  # type: ignore[name-defined]
        """That of patches of these contrasts, at least the mean of all."""
        return np.maximum(np.interp(contrast, self.contrast, self.distance), self.mean)


class PatchRatios:
    """Distances of patches of a result to the nearest of the exemplar's, over those of the exemplar's own patches.

    Parameters
    ----------
    lab : CIELAB of the exemplar, or L alone.
    valid : its pixels that count; None for all.
    steps : px between samples, for each scale; see `steps_for`.

    Raises
    ------
    NoPatchError
        the mask leaves no patch.
    """

    def __init__(self, lab: Float32[np.ndarray, "h w c"], valid: Mask | None, steps: Sequence[int]):
        self.mean = (lab.reshape(-1, lab.shape[2]) if valid is None else lab[valid]).mean(axis=0)
        self.scales = []
        for step in steps:
            reach = (SIDE - 1) * step + 1
            whole = None if valid is None else count_excluded(valid, reach, reach) == 0
            if whole is not None and not whole.any():
                raise NoPatchError(f"masks leave no patch of {reach} px")
            nearest = NearestPatches(lab, step, whole, self.mean)
            self.scales.append((nearest, _UsualDistance(*nearest.own_distances())))

    def at(
        self, result: Float32[np.ndarray, "H W c"], places: Places, valid: Mask | None, wrap: Wraps
    ) -> Float64[np.ndarray, "n s"]:
        """Ratio of the patch about each place of a result, by scale; NaN where masked pixels are in it.

        Parameters
        ----------
        result : as the exemplar.
        valid : its pixels that are not masked; None for all.
        wrap : where the result wraps.
        """
        ratios = np.stack([self._of(scale, usual, result, places, wrap) for scale, usual in self.scales], axis=1)
        if valid is not None:
            for ratio, (scale, _) in zip(ratios.T, self.scales, strict=True):
                reach = (SIDE - 1) * scale.step + 1
                whole = count_excluded(valid, reach, reach) == 0
                inside = np.clip(places - reach // 2, 0, np.array(whole.shape) - 1)
                ratio[~whole[inside[:, 0], inside[:, 1]]] = np.nan
        return ratios

    def _of(
        self, scale: NearestPatches, usual: _UsualDistance, result: np.ndarray, places: Places, wrap: Wraps
    ) -> Float64[np.ndarray, "*n"]:
        half = (SIDE - 1) * scale.step // 2
        corners = places - half
        if wrap:
            beyond = 2 * half * np.array(wrap, np.int64)
            result = np.pad(result, [(int(one), int(one)) for one in (*beyond, 0)], mode="wrap")
            corners = corners + beyond
        patches = Patches(result, scale.step, self.mean)
        corners = np.clip(corners, 0, np.array(patches.shape) - 1)
        wanted = patches.at(*corners.T)
        return np.asarray(scale.distances(wanted) / usual.at(patch_contrast(wanted)))
