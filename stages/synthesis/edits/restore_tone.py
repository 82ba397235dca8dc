"""Slow tone for an even texture: that of its exemplar, or that of a picture."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.common.features.slow_tone import ToneField, relative_tone, with_tone
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import fill_excluded

_SAMPLES = 64  # of a picture's tone, along the longer side
_PASSES = 3  # box filters, whose sum is nearly a Gaussian


class RestoreToneParams(Params):
    """Strength of the tone, and what counts as tone."""

    strength: float = Field(1.0, ge=0, le=2)
    """share of the tone that is applied; 0 leaves the texture even"""
    chroma: bool = True
    """apply chroma as well as lightness"""
    detail: float = Field(0.1, gt=0, le=0.5)
    """width of the smallest parts of ``control`` that count as tone, as a share of its longer side"""


@dataclasses.dataclass(frozen=True)
class RestoreTone:
    """The texture with slow tone."""

    image: Image
    """all maps of the texture; only colour is changed"""


def check_sources(params: RestoreToneParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar's drift ends differently on opposite sides."""
    image = known.get("image")
    wraps = isinstance(image, Image) and bool(image.wraps)
    if wraps and known.get("control") is None and known.get("tone") is not None:
        raise InputError("image: it wraps, but the exemplar's drift does not; give a picture as `control`")


@stage(version=1, check=check_sources)
def restore_tone(
    image: Image,
    params: RestoreToneParams,
    tone: ToneField | None = None,
    control: Image | None = None,
) -> RestoreTone:
    """Apply slow tone to an even texture.

    Parameters
    ----------
    image : the texture, without drift. Where it wraps, ``control`` is read as wrapping as well.
    tone : the exemplar's drift, see `analysis.tone`, stretched over the texture; ignored with ``control``.
    control : a picture whose slow tone, relative to its mean, is stretched over the texture.

    Raises
    ------
    InputError
        there is neither ``tone`` nor ``control``; a texture that wraps with the exemplar's drift.

    References
    ----------
    Ours.
    """
    if control is not None:
        field = _slow_tone(control, params.detail, image.wraps)
    elif tone is not None:
        field = tone
    else:
        raise InputError("tone: give the exemplar's drift as `tone`, or a picture as `control`")
    share = np.array([1, params.chroma, params.chroma], np.float32) * np.float32(params.strength)
    return RestoreTone(with_tone(image, field * share))


def _slow_tone(control: Image, detail: float, wrap: Wraps) -> ToneField:
    """The picture's tone relative to its mean, blurred."""
    ndimage = loaded("scipy.ndimage")
    factor = _SAMPLES / max(control.height, control.width)
    height, width = (max(1, round(side * factor)) for side in (control.height, control.width))
    color = resize(fill_excluded(control).color, height, width, bilinear=True)
    planes = relative_tone(lab_from_linear(color))
    size = max(1, round(detail * _SAMPLES / _PASSES**0.5))
    modes = [*wrap.modes("nearest"), "nearest"]
    for _ in range(_PASSES):
        planes = ndimage.uniform_filter(planes, (size, size, 1), mode=modes)
    return np.asarray(planes - planes.mean(axis=(0, 1)), np.float32)
