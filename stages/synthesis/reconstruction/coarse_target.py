"""The coarse level of a result under its control map."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from texloom.stages.common.features.control import (
    CONTROL_WEIGHT,
    check_maps,
    fit_scale,
    matched_target,
    painted_values,
    resize_control,
)
from texloom.stages.common.grids.pyramid import resize, scaled
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide
from texloom.stages.synthesis.control_maps.joint_upsampling import along_control
from texloom.stages.synthesis.reconstruction.reconstruct import ReconstructParams, solved
from texloom.stages.synthesis.reconstruction.solvers import SolverInputs
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable

_FINER = 2  # times the sides of the coarse level, so that few pixels show two materials
_PATCH = 3  # px of that
_SAME = 0.02  # of control's range, the mean difference of a target that shows the same


class CoarseTargetParams(Params):
    """Size of the result."""

    size: Size | None = None
    """size of the result, px, as of `reconstruct`; null: that of the target"""
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off"""


@dataclasses.dataclass(frozen=True)
class CoarseTarget:
    """Colours of a result, without its detail."""

    image: Image | None
    """the coarse level of the result; none where it or the texture's is too small for patches"""
    guide: TargetGuide | None
    """the same at the size of the result, CIELAB; sharp where control is"""


def check_target(params: CoarseTargetParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """Target and control must have the same channels."""
    check_maps(known)


@stage(version=1, check=check_target)
def coarse_target(
    texture: Image,
    params: CoarseTargetParams,
    rng: np.random.Generator,
    level: Image,
    guide: Guide,
    control: Image,
    target: Image,
) -> CoarseTarget:
    """Synthesise the coarse level of a result from that of its texture, under another control map.

    Each of its pixels stands for many of the result, so that a few see whole lands; by texture optimisation they
    fit each other as those of the texture do. Under the texture's own control map it is the texture's coarse level.

    Parameters
    ----------
    texture : whose size, relative to ``level``, the result shares.
    level, guide : its coarse level, and that at its size; see `coarse_level`.
    control, target : control map of the texture and of the result.

    Raises
    ------
    InputError
        the channels of the target do not match; a value is not finite.

    References
    ----------
    Not in [Wei2008]_. [Kwatra2005]_ for the optimisation, [Kopf2007a]_ for the borders.
    """
    matched = matched_target(control, target)
    assert matched is not None
    size = params.size or (matched.height, matched.width)
    if _is_same(control, matched, size):
        return CoarseTarget(level.wrapping(params.tileable), guide)
    height, width = (min(_FINER * side, full) for side, full in zip(_sides(level), _sides(texture), strict=True))
    small = scaled(size[0], height / texture.height), scaled(size[1], height / texture.height)
    if min(*small, height, width) <= _PATCH:
        return CoarseTarget(None, None)
    colours = Image(linear_from_lab(resize(guide, height, width)), ("R", "G", "B"))
    own, wanted = resize_control(control, height, width), resize_control(matched, *small)
    inputs = SolverInputs.of(colours, own, wanted, fit_scale(colours, own, CONTROL_WEIGHT), small)
    options = ReconstructParams(patch_size=_PATCH, coarsest=8, tileable=params.tileable)
    made, source, _ = solved(inputs, options, rng)
    scale = fit_scale(texture, control, CONTROL_WEIGHT)
    means = resize(scale.of_control(control, *_sides(texture)), height, width)[source[..., 0], source[..., 1]]
    return CoarseTarget(made, along_control(lab_from_linear(made.color), scale.of_control(matched, *size), means))


def _sides(image: Image) -> tuple[int, int]:
    return image.height, image.width


def _is_same(control: Image, target: Image, size: tuple[int, int]) -> bool:
    """Whether a target of a result of height and width ``size`` is a control map, at whatever size."""
    if abs(size[0] * control.width - size[1] * control.height) > max(control.height, control.width):
        return False
    own, wanted = painted_values(control), painted_values(target)
    common = min(own.shape[0], wanted.shape[0]), min(own.shape[1], wanted.shape[1])
    differences = resize(own, *common, bilinear=True) - resize(wanted, *common, bilinear=True)
    scale = max(float(np.ptp(own, axis=(0, 1)).max()), 1e-6)
    return bool(np.abs(differences).mean() <= _SAME * scale)
