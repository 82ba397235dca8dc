"""Checks of sizes that need only the header of an image."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from texloom.stages.common.grids.pyramid import MAX_ROW_VALUES
from texloom.stages.vocabulary.declare import Check, InputError
from texloom.stages.vocabulary.sizes import format_size


@runtime_checkable
class Sized(Protocol):
    """An image, or the header of one that is not read yet."""

    @property
    def height(self) -> int:
        """Rows."""

    @property
    def width(self) -> int:
        """Columns."""

    @property
    def channels(self) -> tuple[str, ...]:
        """One name a plane."""


def check_side(image: Sized, min_side: int) -> None:
    """`InputError` where an exemplar is less than ``min_side`` px high or wide."""
    if min(image.height, image.width) < min_side:
        raise InputError(
            f"image: {format_size(image)} is too small; the minimum is {format_size((min_side, min_side))}"
        )


def check_same_size(part: Sized | None, name: str, whole: Sized | None, of: str) -> None:
    """`InputError` where two images that are both given differ in size.

    Parameters
    ----------
    name, of : names of ``part`` and ``whole`` in the message.
    """
    if part is not None and whole is not None and (part.height, part.width) != (whole.height, whole.width):
        raise InputError(f"{name}: {format_size(part)}; must have the size of the {of}, {format_size(whole)}")


def same_size(part: str, whole: str, of: str) -> Check:
    """The check of a stage that two of its inputs have the same size.

    Parameters
    ----------
    of : name of ``whole`` in the message.
    """

    def check(params: Any, known: Mapping[str, Any]) -> None:  # noqa: ARG001
        check_same_size(known.get(part), part, known.get(whole), of)

    return check


def check_patch(image: Sized, patch_size: int) -> None:
    """`InputError` where an exemplar does not contain more than one patch in each direction."""
    if min(image.height, image.width) <= patch_size:
        raise InputError(
            f"image: {format_size(image)} is too small for patches of {patch_size} px; "
            "lower patch_size or give a larger exemplar"
        )


def check_row_length(stage: str, channels: int, side: int) -> None:
    """`InputError` where distances of neighbourhoods of ``side`` px with ``channels`` would not be exact."""
    if channels * side > MAX_ROW_VALUES:
        raise InputError(
            f"{stage}: {channels} channels in neighbourhoods of {side} px are too many; at most "
            f"{MAX_ROW_VALUES // side} channels can be compared"
        )
