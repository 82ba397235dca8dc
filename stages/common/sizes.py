"""Checks of sizes that need no more than the header of a picture."""

from typing import Protocol, runtime_checkable

from texloom.stages.declare import InputError


@runtime_checkable
class Sized(Protocol):
    """A picture, or the header of one that is not read yet."""

    @property
    def height(self) -> int:
        """Rows."""

    @property
    def width(self) -> int:
        """Columns."""

    @property
    def channels(self) -> tuple[str, ...]:
        """One name a plane."""


def check_side(image: Sized, least: int) -> None:
    """`InputError` where an exemplar is less than ``least`` px high or wide."""
    if min(image.height, image.width) < least:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small to synthesise from, "
            f"which takes {least}x{least} px"
        )


def check_patch(image: Sized, patch_size: int) -> None:
    """`InputError` where an exemplar does not hold more than one patch in each direction."""
    if min(image.height, image.width) <= patch_size:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small for patches of {patch_size} px; "
            "lower patch_size or give a larger exemplar"
        )
