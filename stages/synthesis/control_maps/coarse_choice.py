"""Whether a coarse level makes a texture more like the original."""

import dataclasses
from typing import Any

import numpy as np

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.frame_stacks import frames_of

_BLUR = 2.0  # px, before colours are compared: detail lies elsewhere in any reconstruction


@dataclasses.dataclass(frozen=True)
class CoarseChoice:
    """The guides of a reconstruction, and why."""

    exemplar_guide: Guide | None
    """of the compaction; none where the coarse level does not help"""
    target_guide: TargetGuide | None
    """of the result"""
    image: Image
    """the reconstruction that is nearer to the texture"""
    table: dict[str, Any]
    """mean difference to the texture after a slight blur, CIELAB units: ``plain`` and ``guided``; and whether the
    coarse level is ``used``"""


@stage(version=3)
def coarse_choice(
    texture: Image,
    params: Params,  # noqa: ARG001
    plain: Image,
    guided: Image,
    exemplar_guide: Guide,
    target_guide: TargetGuide | None = None,
) -> CoarseChoice:
    """Use a coarse level where it brings a reconstruction of the original nearer to it.

    Parameters
    ----------
    texture : the original, or a frame stack, whose frames count alike.
    plain, guided : it, reconstructed without and with the coarse level.
    exemplar_guide, target_guide : colours of the coarse level at the compaction's pixels, and in the result, see
        `coarse_target`.

    References
    ----------
    Not in [Wei2008]_, whose compactions have one level.
    """
    errors = [difference(texture, image) for image in (plain, guided)]
    used = target_guide is not None and errors[1] < errors[0]
    table = {"plain": errors[0], "guided": errors[1], "used": used}
    return CoarseChoice(
        exemplar_guide if used else None, target_guide if used else None, guided if used else plain, table
    )


def difference(one: Image, other: Image) -> float:
    """Mean difference of the slightly blurred colours of two images or frame stacks, CIELAB units."""
    errors = []
    for pair in zip(frames_of(one), frames_of(other), strict=True):
        first, second = (gaussian_blur(lab_from_linear(image.color), _BLUR) for image in pair)
        errors.append(float(np.sqrt(np.square(first - second).sum(axis=2)).mean(dtype=np.float64)))
    return sum(errors) / len(errors)
