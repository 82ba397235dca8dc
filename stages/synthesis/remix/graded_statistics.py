"""A mixture whose statistics change gradually from one exemplar to the next."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.synthesis.remix.colour_statistics import Statistics, with_statistics
from texloom.stages.synthesis.remix.common_statistics import with_lab
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels

_STOPS = 4  # between two exemplars, at which statistics are made; linear in between


@dataclasses.dataclass(frozen=True)
class GradedStatistics:
    """The mixture."""

    image: Image
    """as `image`, where there is an original with other colours"""


def outlines(params: Params, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """As the texture."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(image.height, image.width, image.channels)}


@stage(version=1, outlines=outlines)
def graded_statistics(
    image: Image,
    match: Correspondence,
    way: ScalarMap,
    exemplars: Image,
    rectangles: Rectangles,
    original: Image | None = None,
) -> GradedStatistics:
    """Give a texture of exemplars with common statistics those that lie between its exemplars at each place.

    Of each pixel's source the colour that it has with the statistics there replaces the one with common statistics,
    so that no step is left between patches, and ends have the colours of their exemplars.

    Parameters
    ----------
    image, match : the texture, and the source of each pixel in the exemplars.
    way : which exemplar's statistics are wanted where, 0 for the first, with fractions.
    exemplars, rectangles : with common statistics, in one picture, see `exemplar_sheet`.
    original : the same with their own; None: nothing changes.

    References
    ----------
    [Rabin2012]_ for textures between two; per place, and of copied patches, is ours, where [Darabi2012]_ votes with
    gain and bias.
    """
    if original is None:
        return GradedStatistics(image)
    own, common = (lab_from_linear(fill_excluded(one).color) for one in (original, exemplars))
    valid = valid_pixels(original)
    usable = np.ones(own.shape[:2], bool) if valid is None else valid
    places = [np.s_[row : row + height, column : column + width] for row, column, height, width in rectangles]
    found = [Statistics.of(own[at], usable[at]) for at in places]
    change = np.zeros((*match.shape[:2], 3), np.float32)
    for number, (at, corner) in enumerate(zip(places, rectangles[:, :2], strict=True)):
        inside = match.astype(np.int64) - corner
        here = ((inside >= 0) & (inside < rectangles[number, 2:])).all(axis=2)
        for stop in range(max(0, number - 1) * _STOPS, min(len(found) - 1, number + 1) * _STOPS + 1):
            share = np.maximum(1 - np.abs(np.clip(way, number - 1, number + 1) * _STOPS - stop), 0)
            shown = here & (share > 0)
            if shown.any():
                change[shown] += (
                    share[shown][:, None]
                    * _moved(own[at], common[at], usable[at], found, stop, number)[
                        inside[shown][:, 0], inside[shown][:, 1]
                    ]
                )
    return GradedStatistics(with_lab(image, lab_from_linear(image.color) + change))


def _moved(
    own: np.ndarray, common: np.ndarray, usable: Mask, found: list[Statistics], stop: int, number: int
) -> np.ndarray:
    """How an exemplar with the statistics at a stop differs from that with the common ones, CIELAB units."""
    if stop == number * _STOPS:
        return np.asarray(own - common)
    first = min(stop // _STOPS, len(found) - 2)
    wanted = found[first].towards(found[first + 1], stop / _STOPS - first)
    return np.asarray(with_statistics(own, usable, wanted) - common)
