"""Strips of another material along a picture's borders, before its tone and its lattice are looked for."""

from __future__ import annotations

import dataclasses

import numpy as np

from texloom.stages.analysis.exemplars.plain_margins import inside_margins
from texloom.stages.analysis.one_off.margin_search import MIN_SIDE, margin_search
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.masks import valid_pixels


@dataclasses.dataclass(frozen=True)
class ForeignMargins:
    """Where a picture shows another material."""

    foreign: Mask
    """true there; nowhere true in most pictures"""


@stage(version=1, seconds=(0.1, 0))
def foreign_margins(image: Image) -> ForeignMargins:
    """Find strips of another material along one or several borders, such as a cornice above bricks or a frame.

    A lattice, or a drift of tone, is not to be looked for across both. Plain margins are no part of the picture,
    see `plain_margins`; one that continues across its borders has none.

    Parameters
    ----------
    image : the exemplar; searched at 256 px, where it is not excluded.

    References
    ----------
    Ours; see `margin_search`.

    Examples
    --------
    >>> import numpy as np, texloom
    >>> random = np.random.default_rng(0)
    >>> wall = random.uniform(0.4, 0.6, (96, 96, 3)).astype(np.float32)
    >>> wall[:20] = random.uniform(0.0, 0.3, (20, 96, 3))
    >>> texloom.stages.foreign_margins(wall).foreign.mean(axis=1)[[10, 40]]
    array([1., 0.])
    """
    foreign = np.zeros((image.height, image.width), np.bool_)
    inside = inside_margins(image.color)
    part = image.elsewhere(np.ascontiguousarray(image.pixels[inside]))
    if not image.wraps and min(part.height, part.width) >= MIN_SIDE:
        known = valid_pixels(part)
        foreign[inside] = margin_search(part, np.ones_like(foreign[inside]) if known is None else known)
    return ForeignMargins(foreign)
