"""The texture of the way that was taken: as it lies in the exemplar, or turned with its control map."""

import dataclasses
from typing import Any

from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import InputError, stage


@dataclasses.dataclass(frozen=True)
class EitherWay:
    """The texture."""

    image: Image
    """that of the way that was taken"""
    match: Correspondence | None
    """source of each of its pixels in the exemplar; none where it is turned, since neighbours then lie elsewhere"""
    notes: list[str]
    """warnings about the inputs, and last which way was taken and why, a sentence each"""


@stage(version=1)
def either_way(
    turning: dict[str, Any],
    plain: Image | None = None,
    plain_match: Correspondence | None = None,
    plain_notes: list[str] | None = None,
    turned: Image | None = None,
    turned_notes: list[str] | None = None,
) -> EitherWay:
    """Take the texture that was made, of two ways of which one runs, with its notes.

    Parameters
    ----------
    turning : what was chosen; see `turning`.
    plain, plain_match, plain_notes : of `reconstruct`.
    turned, turned_notes : of `per_pixel` along the directions of the control maps.

    Raises
    ------
    InputError : the way that was chosen made no texture.

    References
    ----------
    Ours.
    """
    way = turning["chosen"][0]
    image, match, notes = {
        "plain": (plain, plain_match, plain_notes),
        "turned": (turned, None, turned_notes),
    }[way]
    if image is None:
        raise InputError(f"{way}: was chosen, but is not there")
    sentence = "The texture turns with its control map" if way == "turned" else "The texture keeps its directions"
    return EitherWay(image, match, [*(notes or []), f"{sentence}: {turning['because']}."])
