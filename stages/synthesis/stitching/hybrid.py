"""Hybrid texture synthesis: patches of adaptive size, their overlaps resynthesised pixel by pixel."""

import dataclasses

import numpy as np

from texloom.stages.synthesis.stitching.exemplar import Stitched
from texloom.stages.synthesis.stitching.patchwork import PatchworkParams, check_patch, patchwork
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import stage


class HybridParams(PatchworkParams):
    """Size of the result, patches, and the tolerances of splitting and resynthesis."""


@dataclasses.dataclass(frozen=True)
class Hybrid(Stitched):
    """The texture."""

    patches: int
    """number of patches after splits"""
    resynthesised: int
    """number of resynthesised pixels, counted each time"""


@stage(version=1, check=check_patch, exemplar_bytes=75)
def hybrid(image: Image, params: HybridParams, rng: np.random.Generator, layout: Image | None = None) -> Hybrid:
    """Fill the result with patches, split those that fit badly, and resynthesise pixels that still do.

    In scan order, each patch is the place of the exemplar that matches the synthesised region around it best. Where
    the mean error is too large, the patch is split in four. Overlaps are blended where their pixels agree and
    resynthesised where they do not, from the patch outwards, with the sources of their neighbours and similar
    places as candidates. Patches are compared by all maps; neither they nor the neighbourhoods of single pixels
    contain a masked pixel; see `usable`. Blended normals keep unit length.

    Parameters
    ----------
    image : the exemplar; all channels are copied together.
    layout : the first patches, connected areas of a colour of any shape; a picture of the result's size, exactly as
        it was painted. Default: equal rectangles, see ``patch``.

    Raises
    ------
    InputError
        the exemplar is smaller than 16 x 16 px or than a patch with its overlaps, or holds values that are not
        finite; its mask leaves no whole patch with its overlaps; ``weights`` names a map that it lacks; ``layout``
        has another size than the result, or a block that is larger than the exemplar.

    References
    ----------
    [Nealen2003]_, with the k-coherence search of [Tong2002]_. Details that the paper leaves open, such as
    feathering and softened neighbours, follow its authors' program. Errors are in sRGB values, colours are
    blended in linear light. First patches are equal, so that a result of any size is filled, and larger than
    the paper's 32 px for larger exemplars. In the paper all results are tileable.
    """
    work = patchwork(image, params, 0.0, rng, layout)
    return Hybrid(work.image.wrapping(params.tileable), work.correspondence(), work.patches, work.resynthesised)
