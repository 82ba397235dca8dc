"""Guides: planes that are given for exemplar and target, and the use of the exemplar that they ask for."""

import dataclasses

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.border import Border
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.synthesis.control_maps.correlation import median_cells
from texloom.stages.synthesis.optimisation.scale import Scale
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap
from texloom.stages.vocabulary.sizes import format_size

_COARSE_STRENGTH = 0.5  # exponent by which the strength grows as scales become coarser
_MAX_SAMPLES = 2**16  # target pixels from which the wanted use is estimated
_MIN_USE = 0.05  # of a pixel, relative to even use


@dataclasses.dataclass(frozen=True)
class Guides:
    """Planes that say where in a target patches of the exemplar belong."""

    exemplar: Float32[np.ndarray, "h w k"]
    """of the exemplar's size, CIELAB units"""
    target: Float32[np.ndarray, "H W k"]
    """of the result's size, in the same units; NaN where nothing is asked for"""

    def at(
        self, scale: Scale, sides: tuple[int, int], margin: tuple[int, int]
    ) -> tuple[Float32[np.ndarray, "p q k"], Float32[np.ndarray, "P Q k"]]:
        """Both at a scale; the coarser it is, the stronger.

        Regions are decided at coarse scales. At fine ones their borders may follow the texture.

        Parameters
        ----------
        sides : height and width of the target's features; beyond those of the target it wraps.
        margin : px of the target at full size above and left of the result, where the border of the guide goes on.
        """
        edges = [(before, before) for before in (*margin, 0)]
        target = resize_target(np.pad(self.target, edges, mode="edge"), *scale.target)
        beyond = [(0, side - own) for side, own in zip(sides, scale.target, strict=True)]
        target = np.pad(target, [*beyond, (0, 0)], mode="wrap")
        factor = np.float32(scale.factor**-_COARSE_STRENGTH)
        return resize(self.exemplar, *scale.exemplar, bilinear=True) * factor, target * factor


def guides_of(
    image: Image,
    start: Correspondence,
    exemplar_guide: Float32[np.ndarray, "h w k"] | None,
    target_guide: Float32[np.ndarray, "_ _ k"] | None,
    border: Border,
) -> Guides | None:
    """The guides of an exemplar with its border and of the result of the size of ``start``; none without any.

    Raises
    ------
    ValueError
        only one is given, or they do not fit the exemplar or each other.
    """
    if exemplar_guide is None or target_guide is None:
        if exemplar_guide is not target_guide:
            raise ValueError("exemplar_guide and target_guide go together")
        return None
    if exemplar_guide.shape[:2] != (image.height, image.width) or exemplar_guide.shape[2] != target_guide.shape[2]:
        raise ValueError(
            f"guides of shapes {exemplar_guide.shape} and {target_guide.shape} for an exemplar of "
            f"{format_size(image)}"
        )
    return Guides(border.around(exemplar_guide), resize_target(target_guide, start.shape[0], start.shape[1]))


def resize_target(target: Float32[np.ndarray, "h w k"], height: int, width: int) -> Float32[np.ndarray, "H W k"]:
    """Resample the guide of a target; a pixel asks for something if at least half of it does."""
    asked = ~np.isnan(target[..., :1])
    if asked.all() or target.shape[:2] == (height, width):
        return resize(target, height, width, bilinear=True)
    share = resize(asked.astype(np.float32), height, width, bilinear=True)
    sums = resize(np.where(asked, target, np.float32(0)), height, width, bilinear=True)
    return np.asarray(np.where(share >= 0.5, sums / np.maximum(share, 0.5), np.nan), np.float32)


def expected_use(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], window: int, usable: Mask | None
) -> ScalarMap:
    """Use of each exemplar pixel that a target asks for, relative to even use; mean over ``window`` px around it.

    Exemplar pixels of similar guides share the target pixels of such guides evenly. So a label that covers more of
    the target than of the exemplar may be used more often, and a rare one is not avoided.

    Parameters
    ----------
    own, wanted : guides of exemplar and target. Where the target asks for nothing it uses all evenly.
    usable : the exemplar pixels that can be used; none if all can.
    """
    ndimage = loaded("scipy.ndimage")
    supplied = own.reshape(-1, own.shape[2]) if usable is None else own[usable]
    step = max(1, int(np.sqrt(wanted.shape[0] * wanted.shape[1] / _MAX_SAMPLES)))
    some = wanted[::step, ::step].reshape(-1, wanted.shape[2])
    asked = ~np.isnan(some[:, 0])
    share, some = float(asked.mean()), some[asked]
    if share == 0:
        return np.ones(own.shape[:2], np.float32)
    cells = median_cells(np.concatenate([supplied, some]))
    count = int(cells.max()) + 1
    supply = np.bincount(cells[: len(supplied)], minlength=count) / len(supplied)
    demand = np.bincount(cells[len(supplied) :], minlength=count) / len(some)
    ratio = share * demand / np.maximum(supply, 1 / len(supplied)) + (1 - share)
    ratio = np.maximum(ratio, _MIN_USE)[cells[: len(supplied)]]
    shares = np.full(own.shape[:2], _MIN_USE)
    shares[np.ones(own.shape[:2], bool) if usable is None else usable] = ratio
    return np.asarray(ndimage.uniform_filter(shares, window, mode="nearest"), np.float32)
