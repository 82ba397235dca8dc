"""Feature masks by differences of Gaussians: joints, spots and other parts that differ from what is around them."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Int32
from pydantic import Field

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.sizes import format_size

_MAX_CLASSES = 8

_SeedPixel = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]


class DogMaskParams(Params):
    """Width and contrast of features, how they are cleaned, and their classes."""

    inner: float = Field(1.0, gt=0, le=64)
    """standard deviation of the narrower Gaussian, px: about half the width of the finest features"""
    outer: float = Field(4.0, gt=0, le=256)
    """standard deviation of the wider Gaussian, px: about the width of the largest features"""
    threshold: float = Field(4.0, ge=0, le=100)
    """difference of the Gaussians above which a pixel belongs to a feature, units of CIELAB lightness"""
    features: Literal["dark", "bright", "both"] = "dark"
    """whether features are darker or brighter than their surroundings"""
    smallest: int = Field(16, ge=1)
    """components of fewer pixels are removed"""
    seeds: tuple[tuple[_SeedPixel, ...], ...] = Field((), max_length=_MAX_CLASSES - 1)
    """for each further class the [row, column] of pixels, px: the components at them, or nearest to them, form the
    class, as if filled from there; all others form the first class"""
    only: int | None = Field(None, ge=0, lt=_MAX_CLASSES)
    """number of the class that `image` shows, from 0; null shows all"""


@dataclasses.dataclass(frozen=True)
class DogMask:
    """The features."""

    structure: Mask
    """true on features of all classes"""
    classes: Bool[np.ndarray, "classes h w"]
    """each class by itself, as `feature_distance` takes them"""
    image: Image
    """white on features, to be named in a geometry file or edited"""
    components: int
    """number of components of all classes"""


def check_seeds(params: DogMaskParams, known: Mapping[str, Any]) -> None:
    """The wider Gaussian must be wider; seeds must lie in the image, and the class that is shown exist."""
    image = known.get("image")
    if params.outer <= params.inner:
        raise InputError(f"outer: {params.outer:g} px; must be more than inner, {params.inner:g} px")
    if params.only is not None and params.only > len(params.seeds):
        raise InputError(f"only: {params.only}; there are {1 + len(params.seeds)} classes, from 0")
    for place in (place for seeds in params.seeds for place in seeds):
        if image is not None and (place[0] >= image.height or place[1] >= image.width):
            raise InputError(f"seeds: {list(place)} is outside the image of {format_size(image)}")


@stage(version=1, check=check_seeds)
def dog_mask(image: Image, params: DogMaskParams) -> DogMask:
    """Threshold the difference of two Gaussians, remove small components, and divide the others into classes.

    Parameters
    ----------
    image : the photograph; features outside the region that texture is taken from count too.

    Raises
    ------
    InputError
        ``outer`` is not more than ``inner``; a seed is outside the image; there is no class ``only``; or there are
        seeds but no component is left.

    References
    ----------
    [Eisenacher2008]_ section 3.1: masks by a difference of Gaussians and a threshold, cleaned and filled by hand.
    """
    import cv2

    lightness = np.ascontiguousarray(lab_from_linear(image.color)[..., 0])
    structure = _difference(lightness, params) > params.threshold
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(structure.astype(np.uint8), connectivity=8)
    kept = boxes[:, cv2.CC_STAT_AREA] >= params.smallest
    kept[0] = False  # the background
    structure = kept[labels]
    class_of = np.zeros(count, np.int64)
    for number, seeds in enumerate(params.seeds, 1):
        class_of[_components_at(labels, structure, seeds)] = number
    classes = np.stack([structure & (class_of[labels] == number) for number in range(1 + len(params.seeds))])
    shown = structure if params.only is None else classes[params.only]
    white = Image(shown[..., None].astype(np.float32), ("Y",))
    return DogMask(structure, classes, white, int(kept.sum()))


def _difference(lightness: ScalarMap, params: DogMaskParams) -> ScalarMap:
    """How much a pixel is a feature, units of lightness."""

    narrow, wide = (gaussian_blur(lightness, sigma) for sigma in (params.inner, params.outer))
    difference = wide - narrow
    if params.features == "both":
        return np.abs(difference)
    return np.asarray(difference if params.features == "dark" else -difference)


def _components_at(labels: Int32[np.ndarray, "h w"], structure: Mask, seeds: tuple[_SeedPixel, ...]) -> list[int]:
    """The components nearest to places."""
    places = np.argwhere(structure)
    if not len(places):
        raise InputError("seeds: no component is left; lower threshold or smallest")
    nearest = [places[np.square(places - seed).sum(axis=1).argmin()] for seed in seeds]
    return [int(labels[row, column]) for row, column in nearest]
