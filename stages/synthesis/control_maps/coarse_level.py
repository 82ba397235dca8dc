"""The coarse level of a texture: its colours at a fraction of its size, which a compaction carries."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import CONTROL_WEIGHT, check_pair, fit_scale
from texloom.stages.common.grids.pyramid import resize, scaled
from texloom.stages.synthesis.control_maps.joint_upsampling import along_control
from texloom.stages.vocabulary.arrays import Channels, Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.frame_stacks import frame_count

Guide = Annotated[Float32[np.ndarray, "h w 3"], Channels(("L", "a", "b"))]
"""colours that a coarse level has in a texture or its compaction, CIELAB"""
TargetGuide = Annotated[Float32[np.ndarray, "p q 3"], Channels(("L", "a", "b"))]
"""colours that it asks for in a result"""


class CoarseLevelParams(Params):
    """Size of the coarse level."""

    coarser: int = Field(12, ge=2, le=64)
    """times that its sides are shorter than the texture's: 12 takes .7 % of the pixels"""


@dataclasses.dataclass(frozen=True)
class CoarseLevel:
    """Colours of a texture, without its detail."""

    image: Image
    """the colours of the texture, means of pixels"""
    guide: Guide
    """the same at the texture's size, CIELAB; sharp where control is"""


def outlines(params: CoarseLevelParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """Both, by the texture's size."""
    texture = known.get("texture")
    if texture is None:
        return {}
    height, width = _size(texture, params)
    return {
        "image": Outline(height, width, _colour(texture)),
        "guide": Outline(texture.height, texture.width, ("L", "a", "b")),
    }


@stage(version=1, check=check_pair, outlines=outlines)
def coarse_level(texture: Image, params: CoarseLevelParams, control: Image | None = None) -> CoarseLevel:
    """Reduce the colours of a texture, and enlarge them again along the borders of its control map.

    A control map seldom tells all that varies over a texture: land of one height is desert or forest. Its colours
    at a twelfth of its size do, at hardly any cost.

    Parameters
    ----------
    texture : any channels; only colour is used. Of a frame stack that of all frames: their first three principal
        planes take the place of CIELAB, so that the guide is one for all frames.
    control : of any size of the same aspect ratio; none for a texture without.

    Raises
    ------
    InputError
        control does not fit the texture; it or the texture is constant; a value is not finite.

    References
    ----------
    Not in [Wei2008]_. [Kopf2007a]_ for the borders.
    """
    names = _colour(texture)
    pixels = np.ascontiguousarray(texture.pixels[..., : len(names)])
    small = Image(resize(pixels, *_size(texture, params), bilinear=True), names)
    is_stack = frame_count(texture.channels) > 1
    wanted = np.zeros((texture.height, texture.width, 0), np.float32)
    scale = fit_scale(texture, control, CONTROL_WEIGHT) if is_stack or control is not None else None
    if scale is not None and control is not None:
        wanted = scale.of_control(control, texture.height, texture.width)
    colours = lab_from_linear(small.color)
    if scale is not None and is_stack:
        colours = _three(scale.of_texture(small))
    return CoarseLevel(small, along_control(colours, wanted))


def guides_of(
    shape: tuple[int, int], exemplar: Guide | None, target: TargetGuide | None
) -> tuple[Guide, TargetGuide] | None:
    """Both colours of an exemplar of ``shape``, or none; `ValueError` where they do not belong together."""
    if exemplar is None or target is None:
        if exemplar is not target:
            raise ValueError("exemplar_guide and target_guide go together")
        return None
    if exemplar.shape[:2] != shape:
        raise ValueError(f"exemplar_guide of shape {exemplar.shape} for an exemplar of {shape}")
    return exemplar, target


def _three(planes: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w 3"]:
    """The first three planes; zeros where there are fewer."""
    three = np.zeros((*planes.shape[:2], 3), np.float32)
    three[..., : min(3, planes.shape[2])] = planes[..., :3]
    return three


def _colour(texture: Any) -> tuple[str, ...]:
    if frame_count(texture.channels) > 1:
        return tuple(texture.channels)
    return ("Y",) if texture.channels[0] == "Y" else ("R", "G", "B")


def _size(texture: Any, params: CoarseLevelParams) -> tuple[int, int]:
    return scaled(texture.height, 1 / params.coarser), scaled(texture.width, 1 / params.coarser)
