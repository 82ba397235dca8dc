"""Adaptive texture synthesis: patches as large as fit, quilted where they fit well and repaired elsewhere."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.declare import stage
from texloom.stages.synthesis._seams.patchwork import PatchworkParams, check_exemplar, patchwork


class AdaptiveParams(PatchworkParams):
    """How large the result is, from what patches it is made, and when they are split, quilted and repaired."""

    k: float = Field(0.5, ge=0, le=1)
    """patches whose error is below this share of ``patch_tolerance`` are quilted, the others repaired: 0 repairs
    all, as `hybrid` does; 1 quilts all but those that still fit badly when they are too small to split"""


@dataclasses.dataclass(frozen=True)
class Adaptive:
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
    quilted: int
    """of these, how many were cut along their overlaps; the others were repaired"""
    resynthesised: int
    """pixels made anew, counted each time"""


@stage(version=1, check=check_exemplar)
def adaptive(image: Image, params: AdaptiveParams, rng: np.random.Generator) -> Adaptive:
    """Fill the result as `hybrid` does, but only cut the overlaps of patches that fit well, as `quilting` does.

    Cuts blend nothing and are fast; overlaps are made anew where a cut would show. With ``k`` at 0 the result is
    that of `hybrid`, bit for bit; at 1 it is quilting with patches of adaptive size. Maps and masks are as there.

    Raises
    ------
    InputError
        the exemplar is smaller than 16x16 px or than a patch with its overlaps, or holds values that are not
        finite; its mask leaves no whole patch with its overlaps; there is no map that is weighed.

    References
    ----------
    [Ding2014]_ section 2, made of [Efros2001]_ and [Nealen2003]_. One cut runs through the overlaps on all sides of
    a patch where something stands, and is the cheapest by the cubes of differences, as in `quilting`. Cells of even
    size, and results that are not tileable, are as in `hybrid`.
    """
    work = patchwork(image, params, params.k, rng)
    tally = work.tally
    counts = (tally.patches, tally.quilted, tally.resynthesised)
    return Adaptive(work.image, work.correspondence(), params.tileable, *counts)
