"""Which patches of an exemplar with masked pixels may be used, at every scale."""

import numpy as np
from jaxtyping import Bool

from texloom.stages.common.grids.pyramid import scaled
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import count_excluded, nearest_valid

_MIN_PATCH_COVERAGE = 0.25  # share of unmasked patches at a scale, relative to full size


def shrunk(mask: Mask, height: int, width: int, share: float) -> Bool[np.ndarray, "H W"]:
    """True where at least ``share`` of a pixel of the coarser grid is covered by ``mask``."""
    from PIL import Image as Pillow

    if mask.shape == (height, width):
        return mask
    cover = Pillow.fromarray(mask.astype(np.float32)).resize((width, height), Pillow.Resampling.BOX)
    return np.asarray(cover) >= share - 1e-4


class Allowed:
    """The usable pixels of an exemplar at one scale, and the patches without any other.

    A coarse pixel is usable if at least half of it is. The other half is harmless, as masked pixels are filled from
    usable ones; at full size no patch contains a masked pixel.

    Parameters
    ----------
    usable : at full size.
    height, width : of the exemplar at the scale.
    """

    def __init__(self, usable: Mask, height: int, width: int, patch_size: int):
        self.pixels: Bool[np.ndarray, "h w"] = shrunk(usable, height, width, 0.5)
        self.places: Bool[np.ndarray, "p q"] = count_excluded(self.pixels, patch_size, patch_size) == 0

    @property
    def share(self) -> float:
        """Share of allowed patches."""
        return float(self.places.mean())

    def moved(self, match: Patches) -> Patches:
        """``match`` with each patch that is not allowed replaced by the nearest allowed one."""
        row, column = nearest_valid(self.places)[:, match[0], match[1]]
        return np.ascontiguousarray(np.stack([row, column]))


def allowed_at_scales(
    usable: Mask | None, exemplar: tuple[int, int], factors: list[float], size: int
) -> list[Allowed | None]:
    """Unmasked patches at each scale, none for all; without the coarsest scales if they have too few.

    Raises
    ------
    InputError : no patch of the exemplar is without masked pixels.
    """
    if usable is None:
        return [None] * len(factors)
    height, width = exemplar
    scales = [Allowed(usable, scaled(height, factor), scaled(width, factor), size) for factor in factors]
    min_share = _MIN_PATCH_COVERAGE * scales[-1].share
    if min_share == 0:
        raise InputError(f"image: its mask leaves no whole patch of {size} px; lower patch_size or mask less")
    poor = [index for index, allowed in enumerate(scales) if allowed.share < min_share]
    return list(scales[max(poor, default=-1) + 1 :])
