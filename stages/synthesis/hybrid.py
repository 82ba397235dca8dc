"""Hybrid texture synthesis: patches as large as fit, their overlaps repaired pixel by pixel."""

import dataclasses

import numpy as np

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.declare import stage
from texloom.stages.synthesis._seams.patchwork import PatchworkParams, check_exemplar, patchwork


class HybridParams(PatchworkParams):
    """How large the result is, from what patches it is made, and when they are split and repaired."""


@dataclasses.dataclass(frozen=True)
class Hybrid:
    """The texture."""

    image: Image
    """all maps of the exemplar"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it comes from, for the larger part where two are
    blended"""
    tileable: bool
    """whether it wraps around"""
    patches: int
    """patches laid, after splits"""
    resynthesised: int
    """pixels made anew, counted each time"""


@stage(version=1, check=check_exemplar)
def hybrid(image: Image, params: HybridParams, rng: np.random.Generator) -> Hybrid:
    """Fill the result patch by patch, splitting those that fit badly and making anew the pixels that still do.

    In scan order, each patch is the place of the exemplar that agrees best with all that stands around it. Where
    the mean difference is too large, the patch is split in four. Then the overlap is blended where its pixels agree
    and made anew where they do not, from the patch outwards, each pixel from the places where its neighbours come
    from and those that look like them. Patches are compared by all maps; neither they nor the neighbourhoods of
    single pixels hold a masked pixel; see `usable`. Normals that are blended keep unit length.

    Raises
    ------
    InputError
        the exemplar is smaller than 16x16 px or than a patch with its overlaps, or holds values that are not
        finite; its mask leaves no whole patch with its overlaps; there is no map that is weighed.

    References
    ----------
    [Nealen2003]_, with the k-coherence search of [Tong2002]_. What the paper leaves open, such as feathering and
    softened neighbours, follows its authors' program. Differences are in sRGB steps, colours are blended in linear
    light. First patches are of even size, so that any size of result is filled, and larger in larger exemplars than
    the paper's 32 px. In the paper all results are tileable.
    """
    work = patchwork(image, params, 0.0, rng)
    tally = work.tally
    return Hybrid(work.image, work.correspondence(), params.tileable, tally.patches, tally.resynthesised)
