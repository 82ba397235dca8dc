"""An exemplar at a smaller size, at which methods are tried."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from pydantic import Field

from texloom.stages.common.grids.pyramid import resize, scaled
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Outline, Params, stage


class ReducedParams(Params):
    """The size."""

    side: int = Field(256, ge=32)
    """of the shorter side of the result, px; an exemplar that is no larger remains as it is"""


@dataclasses.dataclass(frozen=True)
class Reduced:
    """The smaller exemplar."""

    image: Image
    """with all maps"""


def _size(params: ReducedParams, image: Any) -> tuple[int, int]:
    """Height and width of the result, px."""
    factor = min(1.0, params.side / min(image.height, image.width))
    return scaled(image.height, factor), scaled(image.width, factor)


def outlines(params: ReducedParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The image has all maps."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(*_size(params, image), image.channels)}


@stage(version=1, outlines=outlines)
def reduced(image: Image, params: ReducedParams) -> Reduced:
    """Reduce an exemplar by a triangle filter, which invents no values.

    Parameters
    ----------
    image : the exemplar.

    References
    ----------
    Ours.
    """
    size = _size(params, image)
    if size == (image.height, image.width):
        return Reduced(image)
    return Reduced(image.with_pixels(resize(image.pixels, *size, bilinear=True)).wrapping(False))
