"""Several textures of one family laid into one picture, so that they can be summarised together."""

import dataclasses
import math
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.common.control import check_aspect, check_finite, resize_control
from texloom.stages.common.neighbourhoods import Rectangles, inside_of
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.synthesis.inverse.level import nearest_in


class AtlasParams(Params):
    """How they are laid."""

    gap: int = Field(16, ge=1, le=256)
    """px between two textures, which belong to neither; so much that coarser levels do not mix them"""


@dataclasses.dataclass(frozen=True)
class Atlas:
    """The textures."""

    image: Image
    """all of them; in the gaps the nearest pixel is repeated"""
    control: Image | None
    """their control maps, each at its texture's size; none where there are none"""
    rectangles: Rectangles
    """where each texture lies, in the order of `names`"""
    names: list[str]
    """the items that the textures come from; what failed is left out"""


@stage(version=1)
def atlas(
    textures: list[Image | None],
    items: list[dict[str, Any]],
    params: AtlasParams,
    controls: list[Image | None] | None = None,
) -> Atlas:
    """Lay textures, each of any size, row by row into one picture that is about square.

    Parameters
    ----------
    textures : all with the same channels; None where an item failed.
    controls : one a texture, all with the same channels, each of any size of its texture's aspect ratio.

    Raises
    ------
    InputError
        no texture; channels that differ; a control map of another aspect ratio or missing; values not finite.

    References
    ----------
    [Wei2008]_ summarises one texture; that several can lie in one picture is ours.
    """
    names, laid, maps = [], [], []
    for item, texture, control in zip(items, textures, controls or [None] * len(items), strict=True):
        if texture is None:
            continue
        name = str(item["name"])
        check_finite(texture, f"texture {name}")
        if controls is not None:
            if control is None:
                raise InputError(f"atlas: {name} has no control map, though others have")
            size = (texture.height, texture.width)
            check_finite(control, f"control {name}")
            check_aspect(control, f"control {name}", size, "its texture")
            maps.append(resize_control(control, *size))
        names.append(name)
        laid.append(texture)
    if not laid:
        raise InputError("atlas: there is no texture")
    for kind, pictures in (("texture", laid), ("control", maps)):
        for name, picture in zip(names, pictures, strict=False):
            if picture.channels != pictures[0].channels:
                raise InputError(
                    f"atlas: {kind} {name} has the channels {' '.join(picture.channels)}, {names[0]} has "
                    f"{' '.join(pictures[0].channels)}"
                )
    rectangles, shape = _arranged([(picture.height, picture.width) for picture in laid], params.gap)
    return Atlas(
        image=Image(_filled([one.pixels for one in laid], rectangles, shape), laid[0].channels),
        control=Image(_filled([one.pixels for one in maps], rectangles, shape), maps[0].channels) if maps else None,
        rectangles=rectangles,
        names=names,
    )


def _arranged(sizes: list[tuple[int, int]], gap: int) -> tuple[Rectangles, tuple[int, int]]:
    """Rows of rectangles in their order, and the size of what holds them."""
    area = sum(height * width for height, width in sizes)
    across = max(math.isqrt(area), *(width for _, width in sizes))
    found: list[tuple[int, int, int, int]] = []
    row, column, below = 0, 0, 0
    for height, width in sizes:
        if column and column + width > across:
            row, column = below + gap, 0
        found.append((row, column, height, width))
        below, column = max(below, row + height), column + width + gap
    rectangles = np.array(found, np.int32)
    return rectangles, (below, int((rectangles[:, 1] + rectangles[:, 3]).max()))


def _filled(
    parts: list[np.ndarray], rectangles: Rectangles, shape: tuple[int, int]
) -> Float32[np.ndarray, "H W c"]:
    canvas = np.zeros((*shape, parts[0].shape[2]), np.float32)
    for part, (row, column, height, width) in zip(parts, rectangles.tolist(), strict=True):
        canvas[row : row + height, column : column + width] = part
    rows, columns = nearest_in(inside_of(rectangles, *shape), np.indices(shape))
    return np.ascontiguousarray(canvas[rows, columns])
