"""Where the pixels of a picture come from, if it was synthesised from an exemplar."""

import numpy as np

from texloom.stages.common.grids.pyramid import resize, scale_sizes, scaled
from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.features import PatchFeatures
from texloom.stages.synthesis.optimisation.match_search import Effort, Search
from texloom.stages.synthesis.optimisation.scale import Scale
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import (
    FilledExemplar,
    nearest_valid,
)

_COARSEST = 48  # px of the shorter side of exemplar and picture
_RATIO = 1.6
_STEPS = 3
_EFFORT = Effort(sweeps=4, tries=8, fill_tries=0, tolerance=0.002)


def trace(
    texture: Image, keep: Mask, exemplar: Image, patch_size: int, random: np.random.Generator
) -> Correspondence:
    """The likely source of every pixel of a texture, by the patches of the exemplar that are most similar.

    Pixels that are not kept, and those within half a patch of them, continue the displacement of the nearest other
    one.

    Parameters
    ----------
    texture : at least a patch high and wide, with the exemplar's channels except for `usable`.

    Raises
    ------
    InputError
        the exemplar's mask leaves no whole patch.
    """
    filled = FilledExemplar.of(exemplar)
    own, usable = filled.image, filled.valid
    features = PatchFeatures(filled, None, 1.0, {}, None, None, 0.0, patch_size, texture)
    given, _ = features.of_given(texture, features.planes.shape[2])
    sides, whole = (own.height, own.width), (texture.height, texture.width)
    shorter = min(*sides, *whole)
    factors = scale_sizes(shorter, shorter, max(_COARSEST, 2 * patch_size), _RATIO)
    match, before = None, 1.0
    for level, factor in enumerate(factors, 1):
        small, target = ([scaled(side, factor) for side in both] for both in (sides, whole))
        scale = Scale(
            level=level,
            factor=factor,
            exemplar=(small[0], small[1]),
            places=(small[0] - patch_size + 1, small[1] - patch_size + 1),
            target=(target[0], target[1]),
            patches=(target[0] - patch_size + 1, target[1] - patch_size + 1),
            iterations=_STEPS,
        )
        planes, _, _ = features.at(scale, phased=False, margin=(0, 0))
        channels = planes.shape[1] // small[1]
        allowed = None if usable is None else Allowed(usable, small[0], small[1], patch_size)
        if allowed is not None and not allowed.places.any():
            continue
        if match is None:
            match = random.integers(0, scale.places, (*scale.patches, 2), dtype=np.int32)
            match = np.ascontiguousarray(np.moveaxis(match, 2, 0))
        else:
            match = correspondence.rescale(match, scale.patches, scale.places, factor / before)
        if allowed is not None:
            match = allowed.moved(match)
        search = Search(planes, channels, patch_size, scale.places, scale.patches, NOWHERE, 0.0, 1.0, allowed)
        shown = fixed_point(resize(given, *scale.target))
        for _ in range(_STEPS):
            search.step(shown, match, _EFFORT, random)
        before = factor
    if match is None:
        raise InputError(
            f"exemplar: its mask leaves no whole patch of {patch_size} px; lower patch_size or mask less"
        )
    return continued(correspondence.to_pixels(match, patch_size, NOWHERE), keep, sides, patch_size // 2 + 1)


def continued(match: Correspondence, keep: Mask, sides: tuple[int, int], margin: int) -> Correspondence:
    """``match`` with pixels within ``margin`` px of those that are not kept displaced as the nearest other one."""
    ndimage = loaded("scipy.ndimage")
    if keep.all():
        return match
    far = ndimage.distance_transform_edt(keep) > margin
    if not far.any():
        far = keep
    row, column = nearest_valid(far)
    rows, columns = np.indices(keep.shape)
    shift = np.stack([rows - row, columns - column], axis=2)
    moved = match[row, column].astype(np.int64) + shift
    return np.clip(moved, 0, np.array(sides) - 1).astype(np.uint32)
