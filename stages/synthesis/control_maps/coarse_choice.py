"""Whether a coarse level makes a texture more like the original, and what it asks for under a target."""

import dataclasses
import logging
from typing import Any

import numpy as np

from texloom.stages.common.features.control import matched_target, painted_values
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage

_LOG = logging.getLogger(__name__)

_BLUR = 2.0  # px, before colours are compared: detail lies elsewhere in any reconstruction
_SAME = 0.02  # of control's range, the mean difference of a target that shows the same


@dataclasses.dataclass(frozen=True)
class CoarseChoice:
    """The guides of a reconstruction, and why."""

    exemplar_guide: Guide | None
    """of the compaction; none where the coarse level does not help"""
    target_guide: TargetGuide | None
    """of the target, at the texture's size"""
    table: dict[str, Any]
    """mean difference to the texture after a slight blur, CIELAB units: ``plain`` and ``guided``; whether the
    target ``is_original``, the texture's own control map; and whether the coarse level is ``used``"""


@stage(version=1)
def coarse_choice(
    texture: Image,
    params: Params,  # noqa: ARG001
    plain: Image,
    guided: Image,
    guide: TargetGuide,
    exemplar_guide: Guide,
    control: Image,
    target: Image,
) -> CoarseChoice:
    """Use a coarse level where it brings a reconstruction of the original nearer to it, under its own control map.

    Under another map it is not used: where its colours belong there nobody has said.

    Parameters
    ----------
    texture : the original.
    plain, guided : it, reconstructed without and with the coarse level.
    guide, exemplar_guide : colours of the coarse level, in the texture and at the compaction's pixels.
    control, target : control map of the texture and of the result.

    Raises
    ------
    InputError
        the channels of the target do not match.

    References
    ----------
    Not in [Wei2008]_, whose compactions have one level.
    """
    errors = [_difference(texture, image) for image in (plain, guided)]
    is_original = _is_same(control, target)
    used = errors[1] < errors[0] and is_original
    table = {"plain": errors[0], "guided": errors[1], "is_original": is_original, "used": used}
    if is_original:
        verb = "is used" if used else "is not used"
        _LOG.info(
            "the coarse level %s: the texture differs by %.2f CIELAB units with it, by %.2f without",
            verb,
            *errors[::-1],
        )
    return CoarseChoice(exemplar_guide if used else None, guide if used else None, table)


def _difference(one: Image, other: Image) -> float:
    """Mean difference of the blurred colours, CIELAB units."""
    first, second = (gaussian_blur(lab_from_linear(image.color), _BLUR) for image in (one, other))
    return float(np.sqrt(np.square(first - second).sum(axis=2)).mean(dtype=np.float64))


def _is_same(control: Image, target: Image) -> bool:
    """Whether a target is a control map, at whatever size."""
    matched = matched_target(control, target)
    assert matched is not None
    if abs(matched.height * control.width - matched.width * control.height) > max(control.height, control.width):
        return False
    own, wanted = painted_values(control), painted_values(matched)
    size = min(own.shape[0], wanted.shape[0]), min(own.shape[1], wanted.shape[1])
    differences = resize(own, *size, bilinear=True) - resize(wanted, *size, bilinear=True)
    scale = max(float(np.ptp(own, axis=(0, 1)).max()), 1e-6)
    return bool(np.abs(differences).mean() <= _SAME * scale)
