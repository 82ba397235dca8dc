"""Maps that stages add to an image, and what these share."""

from __future__ import annotations

import dataclasses
import logging
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.grids.screened_poisson import divided_by_frequency
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import MapFacts, Wraps
from texloom.stages.vocabulary.masks import fill_excluded

_LOG = logging.getLogger(__name__)

HEIGHT = "height"
Relief = Annotated[
    float,
    Field(
        gt=0,
        le=1,
        description="how far a height of 1 lies above one of 0, as a share of the picture's width; 0.05 is what "
        "exported documents assume, and what `height_from_colour` gives",
    ),
]


def has_map(image: Image, role: str) -> bool:
    """Whether the image has the map already, which is then kept, and said."""
    found = any(name.partition(".")[0] == role for name in image.channels)
    if found:
        _LOG.warning("the exemplar has a map %s, which was kept", role)
    return found


def with_map(
    image: Image, role: str, planes: Float32[np.ndarray, "h w k"], names: tuple[str, ...], facts: MapFacts
) -> Image:
    """The image with one more map, of which ``facts`` hold."""
    made = image.with_pixels(np.concatenate([image.pixels, planes], axis=2), (*image.channels, *names))
    return dataclasses.replace(made, facts=dataclasses.replace(made.facts, maps={**made.facts.maps, role: facts}))


def heights(image: Image, relief: float) -> ScalarMap:
    """The heights of an image in px, where ``relief`` is as of `Relief`; excluded pixels are as the nearest others.

    Raises
    ------
    InputError
        the image has no map ``height``, or all its pixels are excluded.
    """
    if HEIGHT not in image.channels:
        raise InputError(f"image: has no map height; it has {', '.join(image.channels)}")
    plane = fill_excluded(image).pixels[..., image.channels.index(HEIGHT)]
    return np.ascontiguousarray(plane * np.float32(relief * image.width))


def smoothed(plane: ScalarMap, wraps: Wraps, deviation: float) -> ScalarMap:
    """Local means, across borders that wrap; ``deviation`` of their weights along an axis, px."""
    # (1 + s d^2 / 4)^-2 has, as a density along an axis, the variance d^2.
    return divided_by_frequency(plane, wraps, lambda squared: (1 + squared * (deviation * deviation / 4)) ** 2)


def within(plane: ScalarMap, valid: Mask | None) -> np.ndarray:
    """The values that count."""
    return np.asarray(plane.ravel() if valid is None else plane[valid])


def from_zero_to_one(plane: ScalarMap, valid: Mask | None) -> ScalarMap:
    """``plane`` scaled so that values that count are 0..1; 0.5 where it is constant."""
    counted = within(plane, valid)
    low, span = counted.min(), float(np.ptp(counted))
    if span <= 1e-6:
        return np.full_like(plane, 0.5)
    return np.clip((plane - low) / np.float32(span), 0, 1)
