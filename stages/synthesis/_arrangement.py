"""The knobs of per-pixel synthesis, and what they and a seed make of an exemplar."""

import numpy as np
from pydantic import Field

from texloom.stages.analysis.appearance_stack import AppearanceStack
from texloom.stages.arrays import Image, Jacobian
from texloom.stages.common.appearance import blurred_levels
from texloom.stages.common.control import ControlScale, fit_scale
from texloom.stages.common.per_pixel.levels import Style
from texloom.stages.common.per_pixel.tables import CONTROLS, Tables, make_tables
from texloom.stages.declare import InputError, Params

_PASSES = (2, 2, 4)
_SUPPORT = 28  # / 256 that each neighbour that agrees takes off the squared distance
_TRIES = 64


class ArrangementParams(Params):
    """How pieces of the exemplar are arranged anew."""

    jitter: float = Field(0.25, ge=0, le=1)
    """how far pixels are displaced at random before a level is corrected, in steps of the level for the coarsest
    and ever less for finer ones; more breaks repetition and large structures, 0 leaves only the start to chance"""
    block: int = Field(6, ge=1, le=64)
    """side of the pieces of the exemplar that the coarsest level starts from, px of that level; larger ones keep
    larger structures whole and repeat more"""
    coherence: float = Field(1.0, ge=0, le=1.1)
    """how strongly a pixel goes with what several neighbours agree on; with 0 seams are softer and smooth spots
    spread"""
    control_weight: float = Field(1.0, gt=0, le=100)
    """how much control counts: its variance by that of the neighbourhoods; 0.3 leads gently, 10 forces. Above 1
    neighbours that agree also outvote it less"""
    tolerance: float = Field(0.04, ge=0, le=1)
    """deviation from the wanted control that counts as none, as a share of the control's range"""


def style(params: ArrangementParams, levels: int, seed: int) -> Style:
    """What the kernels ask for.

    Parameters
    ----------
    seed : any whole number; its lowest 64 bits count.
    """
    return Style(
        key=seed % 2**64,
        jitter=tuple(params.jitter * level / max(1, levels - 1) for level in range(levels)),
        passes=tuple(_PASSES[min(level, len(_PASSES) - 1)] for level in range(levels)),
        block=params.block,
        tries=_TRIES,
        coherence_bonus=round(params.coherence * _SUPPORT),
        # control that forces is not to be outvoted
        control_bonus=round(params.coherence * _SUPPORT / max(1.0, params.control_weight)),
        tolerance=params.tolerance,
    )


def prepared(
    image: Image, stack: AppearanceStack, control: Image | None, jacobian: Jacobian | None, weight: float
) -> tuple[Tables, ControlScale | None]:
    """The exemplar's tables, and how control becomes numbers.

    Raises
    ------
    InputError : control with more planes than can be held.
    ValueError : inputs that do not belong together.
    """
    levels, height, width = stack.appearance.shape[:3]
    if (height, width) != (image.height, image.width):
        raise ValueError(f"analysis of {height}x{width} px for an image of {image.height}x{image.width} px")
    scale, planes = None, None
    if control is not None:
        scale = fit_scale(image, control, 1.0)
        if len(scale.control) > CONTROLS:
            raise InputError(f"control: {len(scale.control)} channels that vary are more than {CONTROLS}")
        own = scale.of_control(control, height, width) / np.float32(scale.strength)
        planes = blurred_levels(own, levels, stack.toroidal)
    tables = make_tables(stack.appearance, stack.basis, stack.candidates, stack.toroidal, planes, weight, jacobian)
    return tables, scale
