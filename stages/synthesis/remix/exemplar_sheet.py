"""Several exemplars side by side in one picture, from which one texture is made."""

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeAlias

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.grids.packing import arranged
from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.synthesis.remix.common_statistics import with_common_statistics
from texloom.stages.vocabulary.arrays import Channels, Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, valid_pixels, with_usable

Lattice: TypeAlias = Annotated[Float32[np.ndarray, "_ 2"], Channels(("row", "column"))]
"""`Vectors`, of which each item has as many as it has"""

_LOG = logging.getLogger(__name__)

_GAP = 32  # px between two exemplars, which no patch may cross, also where pictures are reduced
_MIN_SIDE = 32  # px
_SCALES_ALIKE = 4.0  # ratio of sides from which exemplars are said to be of different size
_CLIPPED = 0.01  # share of pixels from which clipped ones are said
_MIN_SPREAD = 1.0  # CIELAB units; less contrast is not stretched


class ExemplarSheetParams(Params):
    """How much of each exemplar the texture is to have, and whether their tones are matched."""

    weights: dict[str, Annotated[float, Field(gt=0, le=1000)]] = Field({}, max_length=64)
    """how much of the texture is to come from an exemplar, by its name, about, relative to 1 of those that are not
    named; none: as much as the exemplars are large, so that all pixels are used evenly"""
    match_tone: float = Field(0.0, ge=0, le=1)
    """how far mean and contrast of lightness and colour of each exemplar are moved to those of all, 0..1"""
    gradual: bool = False
    """give exemplars their common statistics where all are stochastic, for a texture that `graded_statistics` leads
    from one to the next"""


@dataclasses.dataclass(frozen=True)
class ExemplarSheet:
    """The exemplars in one picture."""

    image: Image
    """all exemplars; the gaps between them are excluded"""
    original: Image | None
    """the same with their own statistics; none where ``image`` has these"""
    share: ScalarMap | None
    """use of each pixel that the weights ask for, relative to even use; none without weights"""
    rectangles: Rectangles
    """position and size of each exemplar, in the order of `names`"""
    names: list[str]
    """of the exemplars, without those that failed"""
    wanted: list[float]
    """how much of the texture is to come from each, 0..1, together 1"""


@stage(version=1)
def exemplar_sheet(
    exemplars: list[Image | None],
    items: list[dict[str, Any]],
    params: ExemplarSheetParams,
    generators: list[Lattice | None] | None = None,
) -> ExemplarSheet:
    """Arrange exemplars of any size in one picture, with excluded gaps between them.

    Grey exemplars among coloured ones become coloured. Further maps are those that all have.

    Parameters
    ----------
    exemplars : None where an item failed.
    generators : of the lattices of exemplars, of which it is said that they are not kept.
    items : name of each exemplar's item; provided by the runner.

    Raises
    ------
    InputError
        there is no exemplar; one is smaller than 32 px; a weight is of none of them.

    References
    ----------
    Ours; the optimisation of [Kaspar2015]_ does not ask where a patch comes from. See `with_statistics` for common
    ones.
    """
    known = [(str(item["name"]), one) for item, one in zip(items, exemplars, strict=True) if one is not None]
    if not known:
        raise InputError("exemplars: there is none")
    names = [name for name, _ in known]
    if generators is not None:
        _tell_lattices([str(item["name"]) for item in items], generators)
    usable = [_usable(image) for _, image in known]
    images = _of_one_kind(names, [_without_exclusion(image) for _, image in known])
    for image in images:
        check_side(image, _MIN_SIDE)
    _tell_sizes(names, images)
    shares = _shares(params.weights, names)
    if params.match_tone and len(images) > 1:
        images = _alike(names, images, usable, params.match_tone)
    rectangles, shape = arranged([(image.height, image.width) for image in images], _GAP)
    areas = np.array(list(map(np.count_nonzero, usable)))
    valid, share = np.zeros(shape, bool), np.ones(shape, np.float32)
    for number, (row, column, height, width) in enumerate(rectangles.tolist()):
        place = np.s_[row : row + height, column : column + width]
        valid[place] = usable[number]
        if shares is not None:
            share[place] = shares[number] * areas.sum() / areas[number]
    common = with_common_statistics(names, images, usable) if params.gradual and len(images) > 1 else None
    return ExemplarSheet(
        image=_laid(common or images, rectangles, valid),
        original=None if common is None else _laid(images, rectangles, valid),
        share=None if shares is None else share,
        rectangles=rectangles,
        names=names,
        wanted=(areas / areas.sum() if shares is None else shares).tolist(),
    )


def _laid(images: Sequence[Image], rectangles: Rectangles, valid: Mask) -> Image:
    canvas = np.zeros((*valid.shape, len(images[0].channels)), np.float32)
    for image, (row, column, height, width) in zip(images, rectangles.tolist(), strict=True):
        canvas[row : row + height, column : column + width] = image.pixels
    return with_usable(images[0].elsewhere(canvas), valid)


def _of_one_kind(names: Sequence[str], images: Sequence[Image]) -> list[Image]:
    """The images with the channels that all have; grey ones in colour if another is."""
    colours = [image.channels[0] != "Y" for image in images]
    made = list(map(_in_colour, images)) if any(colours) else list(images)
    if any(colours) and not all(colours):
        grey = [name for name, is_colour in zip(names, colours, strict=True) if not is_colour]
        _LOG.warning("%s: grey, taken as three equal channels, as others are in colour", ", ".join(grey))
    common = [name for name in made[0].channels if all(name in image.channels for image in made)]
    for name, image in zip(names, made, strict=True):
        if left_out := [channel for channel in image.channels if channel not in common]:
            _LOG.warning("%s: %s left out, which not all exemplars have", name, ", ".join(left_out))
    return [_planes(image, common) for image in made]


def _planes(image: Image, names: Sequence[str]) -> Image:
    kept = [image.channels.index(name) for name in names]
    return image.with_pixels(np.ascontiguousarray(image.pixels[..., kept]), tuple(names))


def _without_exclusion(image: Image) -> Image:
    return _planes(image, [name for name in image.channels if name not in EXCLUSION_CHANNELS])


def _in_colour(image: Image) -> Image:
    if image.channels[0] != "Y":
        return image
    pixels = np.concatenate([np.repeat(image.pixels[..., :1], 3, axis=2), image.pixels[..., 1:]], axis=2)
    return image.with_pixels(np.ascontiguousarray(pixels), ("R", "G", "B", *image.channels[1:]))


def _shares(weights: Mapping[str, float], names: Sequence[str]) -> np.ndarray | None:
    """Of the texture, in the order of the names; none where nothing is asked for."""
    if unknown := [name for name in weights if name not in names]:
        raise InputError(f"weights: {unknown[0]} is no exemplar; they are {', '.join(names)}")
    asked = np.array([weights.get(name, 1.0) for name in names])
    return asked / asked.sum() if weights else None


def _tell_lattices(names: Sequence[str], generators: Sequence[Lattice | None]) -> None:
    periodic = [name for name, own in zip(names, generators, strict=True) if own is not None and len(own)]
    if periodic:
        _LOG.warning(
            "%s: lattice or courses dropped, which several exemplars do not have in common; self_tuning keeps them",
            ", ".join(periodic),
        )


def _tell_sizes(names: Sequence[str], images: Sequence[Image]) -> None:
    sides = [min(image.height, image.width) for image in images]
    if max(sides) >= _SCALES_ALIKE * min(sides):
        largest, smallest = names[int(np.argmax(sides))], names[int(np.argmin(sides))]
        _LOG.warning(
            "%s has %d times the side of %s: are features of both as large as they should be? --reduce makes "
            "exemplars smaller",
            largest, round(max(sides) / min(sides)), smallest,
        )  # fmt: skip


def _alike(
    names: Sequence[str], images: Sequence[Image], usable: Sequence[np.ndarray], strength: float
) -> list[Image]:
    """The images with means and deviations of CIELAB moved towards those of all."""
    labs = [lab_from_linear(image.color) for image in images]
    measured = [_mean_and_spread(lab[own]) for lab, own in zip(labs, usable, strict=True)]
    means, spreads = np.array(measured).swapaxes(0, 1)
    wanted_mean, wanted_spread = means.mean(axis=0), spreads.mean(axis=0)
    made = []
    for name, image, own, lab, mean, spread in zip(names, images, usable, labs, means, spreads, strict=True):
        ratio = wanted_spread / np.maximum(spread, _MIN_SPREAD)
        moved = (lab - mean) * (1 + strength * (ratio - 1)) + mean + strength * (wanted_mean - mean)
        color = linear_from_lab(moved.astype(np.float32))
        if (clipped := float((color[own] < 0).any(axis=1).mean())) > _CLIPPED:
            _LOG.warning(
                "%s: match_tone clips %.0f %% of the pixels, which get darker than black", name, 100 * clipped
            )
        color = np.maximum(color, 0)
        planes = color if image.channels[0] != "Y" else color.mean(axis=2, keepdims=True)
        made.append(image.with_pixels(np.concatenate([planes, image.pixels[..., planes.shape[2] :]], axis=2)))
    return made


def _mean_and_spread(lab: Float32[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    return lab.mean(axis=0, dtype=np.float64), lab.std(axis=0, dtype=np.float64)


def _usable(image: Image) -> Mask:
    valid = valid_pixels(image)
    return np.ones((image.height, image.width), bool) if valid is None else valid
