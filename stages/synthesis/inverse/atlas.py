"""A texture atlas: several textures in one image, to be summarised together."""

import dataclasses
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.common.features.control import check_aspect, check_finite, resize_control
from texloom.stages.common.grids.packing import arranged
from texloom.stages.common.similarity.neighbourhoods import Rectangles, inside_of
from texloom.stages.synthesis.inverse.level import nearest_in
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage


class AtlasParams(Params):
    """Layout of the atlas."""

    gap: int = Field(16, ge=1, le=256)
    """px between two textures; wide enough that coarser levels do not mix them"""


@dataclasses.dataclass(frozen=True)
class Atlas:
    """The textures in one image."""

    image: Image
    """all textures; gaps repeat the nearest pixel"""
    control: Image | None
    """their control maps, each at its texture's size; none without control maps"""
    rectangles: Rectangles
    """position and size of each texture, in the order of `names`"""
    names: list[str]
    """items of the textures, without those that failed"""


@stage(version=1)
def atlas(
    textures: list[Image | None],
    items: list[dict[str, Any]],
    params: AtlasParams,
    controls: list[Image | None] | None = None,
) -> Atlas:
    """Arrange textures of any size row by row in one image that is about square.

    Parameters
    ----------
    textures : all with the same channels; None where an item failed.
    items : name of each texture's item; provided by the runner.
    controls : one for each texture, all with the same channels, each of its texture's aspect ratio.

    Raises
    ------
    InputError
        there is no texture; channels differ; a control map is missing or of another aspect ratio; a value is not
        finite.

    References
    ----------
    [Wei2008]_ summarises one texture; atlases are ours.
    """
    names, images, maps = [], [], []
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
        images.append(texture)
    if not images:
        raise InputError("atlas: there is no texture")
    for kind, pictures in (("texture", images), ("control", maps)):
        for name, picture in zip(names, pictures, strict=False):
            if picture.channels != pictures[0].channels:
                raise InputError(
                    f"atlas: {kind} {name} has the channels {' '.join(picture.channels)}, {names[0]} has "
                    f"{' '.join(pictures[0].channels)}"
                )
    rectangles, shape = arranged([(image.height, image.width) for image in images], params.gap)
    return Atlas(
        image=_combined(images, rectangles, shape),
        control=_combined(maps, rectangles, shape) if maps else None,
        rectangles=rectangles,
        names=names,
    )


def _combined(images: list[Image], rectangles: Rectangles, shape: tuple[int, int]) -> Image:
    canvas = np.zeros((*shape, len(images[0].channels)), np.float32)
    for image, (row, column, height, width) in zip(images, rectangles.tolist(), strict=True):
        canvas[row : row + height, column : column + width] = image.pixels
    rows, columns = nearest_in(inside_of(rectangles, *shape), np.indices(shape))
    return images[0].elsewhere(np.ascontiguousarray(canvas[rows, columns]))
