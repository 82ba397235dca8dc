"""Stochastic exemplars with the statistics of all of them, so that patches of either fit beside each other."""

import logging
from collections.abc import Sequence

import numpy as np

from texloom.stages.synthesis.endless.endless_suitability import suitability_of, why_not
from texloom.stages.synthesis.remix.colour_statistics import Statistics, with_statistics
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.masks import fill_excluded, with_usable

_LOG = logging.getLogger(__name__)


def with_common_statistics(
    names: Sequence[str], images: Sequence[Image], usable: Sequence[Mask]
) -> list[Image] | None:
    """The exemplars with the statistics halfway between all of them; None where one is not stochastic.

    Elements of a structure, such as bricks, would get colours that they never have. Maps other than colour stay.
    """
    whole = [fill_excluded(with_usable(image, valid)) for image, valid in zip(images, usable, strict=True)]
    tables = map(suitability_of, whole)
    doubts = [f"{name}: {why_not(table)}" for name, table in zip(names, tables, strict=True) if why_not(table)]
    if doubts:
        _LOG.warning("patches of either in between, as not all are stochastic: %s", "; ".join(doubts))
        return None
    _LOG.warning(
        "all are stochastic: colours and contrasts in between change gradually; --set gradual=false keeps them"
    )
    labs = [lab_from_linear(image.color) for image in whole]
    found = [Statistics.of(lab, valid) for lab, valid in zip(labs, usable, strict=True)]
    common = found[0]
    for number, other in enumerate(found[1:], 2):
        common = common.towards(other, 1 / number)
    return [
        with_lab(image, with_statistics(lab, valid, common))
        for image, lab, valid in zip(images, labs, usable, strict=True)
    ]


def with_lab(image: Image, lab: np.ndarray) -> Image:
    """``image`` with colours in CIELAB, not darker than black; grey ones in the mean of R, G and B."""
    color = np.maximum(linear_from_lab(np.asarray(lab, np.float32)), 0)
    planes = color if image.channels[0] != "Y" else color.mean(axis=2, keepdims=True)
    return image.with_pixels(np.concatenate([planes, image.pixels[..., planes.shape[2] :]], axis=2))
