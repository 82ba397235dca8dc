"""Maps scaled as the exemplar of an earlier result was."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from texloom.stages.analysis.regularity.fitted_cells import MOST_SCALED
from texloom.stages.common.grids.resampled import scaled_to
from texloom.stages.synthesis.optimisation.reapply import other_size
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import NoParams, Outline, stage
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.voted_patches import VotedPatches

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ScaledMaps:
    """The maps."""

    image: Image
    """of the exemplar's size; as it was where it has that"""


def check_sides(_: NoParams, known: Mapping[str, Any]) -> None:
    """`fitted_cells` can have scaled maps of this size to that of the exemplar."""
    image, votes = known.get("image"), known.get("votes")
    if image is None or not isinstance(votes, VotedPatches):
        return
    scales = [after / before for after, before in zip(votes.exemplar, (image.height, image.width), strict=True)]
    if not all(1 / MOST_SCALED <= one <= MOST_SCALED for one in scales):
        raise other_size((image.height, image.width), votes.exemplar)


def outlines(_: NoParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The image has the exemplar's size, and its own maps."""
    image, votes = known.get("image"), known.get("votes")
    if image is None or not isinstance(votes, VotedPatches):
        return {}
    return {"image": Outline(*votes.exemplar, image.channels)}


@stage(version=1, check=check_sides, outlines=outlines)
def scaled_maps(image: Image, votes: VotedPatches) -> ScaledMaps:
    """Scale maps to the size of the exemplar of an earlier result, which `fitted_cells` may have scaled.

    Parameters
    ----------
    image : maps of that exemplar, before it was scaled.
    votes : the patches of the result.

    Raises
    ------
    InputError : the exemplar was larger or smaller by more than a fifth.

    References
    ----------
    Ours.
    """
    if (image.height, image.width) == votes.exemplar:
        return ScaledMaps(image)
    before, after = format_size(image), format_size(votes.exemplar)
    _LOG.warning("scaled from %s to %s, as the exemplar of that result", before, after)
    return ScaledMaps(scaled_to(image, votes.exemplar))
