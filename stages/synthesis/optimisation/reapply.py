"""Other maps of an exemplar, voted from the patches from which an earlier result was."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from texloom.stages.common.grids.border import Border
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.even_joints import EvenJoints
from texloom.stages.synthesis.optimisation.vote import result_image, vote_pixels, window
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import InputError, NoParams, stage
from texloom.stages.vocabulary.masks import FilledExemplar
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.voted_patches import VotedPatches


@dataclass(frozen=True)
class Reapplied:
    """The maps in register with the earlier result."""

    image: Image
    """all channels of the maps"""
    match: Correspondence
    """source of each pixel of the result in the exemplar"""


def check_exemplar(_: NoParams, known: Mapping[str, Any]) -> None:
    """The maps have the size of the exemplar."""
    image, votes = known.get("image"), known.get("votes")
    if image is not None and isinstance(votes, VotedPatches) and (image.height, image.width) != votes.exemplar:
        raise other_size((image.height, image.width), votes.exemplar)


def other_size(sides: tuple[int, int], exemplar: tuple[int, int]) -> InputError:
    """Why maps of this height and width are refused, px."""
    return InputError(
        f"image: has {format_size(sides)}, but the exemplar of that result had {format_size(exemplar)}"
    )


@stage(version=2, check=check_exemplar, in_bands=True)
def reapply(image: Image, votes: VotedPatches) -> Reapplied:
    """Vote maps from the correspondence of an earlier result, as a map of a material that came later.

    It is the last vote of `optimise`, in all channels, linear, and its steps of tone are spread where those of that
    result were: the exemplar's own maps give it, bit for bit. Masked pixels of the maps have the values of the
    nearest others.

    Parameters
    ----------
    image : maps of the exemplar's size.
    votes : the patches of the result.

    Raises
    ------
    InputError : the maps have another size than the exemplar.

    References
    ----------
    [Kaspar2015]_ section 3, whose vote this is.
    """
    border = Border(votes.patch_size if votes.border else 1)
    exemplar = FilledExemplar.of(border.around_image(image)).image
    match = correspondence.from_layers(votes.patches)
    weights = window(votes.patch_size, votes.final_sigma)
    pixels = vote_pixels(match, exemplar.pixels, weights, votes.wraps, votes.margin)
    source = correspondence.to_pixels(match, votes.patch_size, votes.wraps, votes.margin)
    border.move_back(source)
    made = result_image(pixels, exemplar)
    if votes.even_joints:
        EvenJoints(image).apply(made, source, votes.wraps)
    return Reapplied(made.wrapping(votes.wraps), source)
