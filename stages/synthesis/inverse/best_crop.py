"""The crop that best represents a texture: the baseline for a compaction."""

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.synthesis.inverse.crops import best_corner
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.summary import (
    Copied,
    SummaryParams,
    require_features,
    size_check,
    wanted_size,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import OddSize, stage


class BestCropParams(SummaryParams):
    """Size of the crop, and how crops are judged."""

    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    samples: int = Field(512, ge=16, le=16384)
    """neighbourhoods of the texture by which all crops are judged"""
    finalists: int = Field(6, ge=1, le=64)
    """number of best crops that are judged again by eight times as many neighbourhoods"""


@stage(version=1, check=size_check("best_crop", "neighbourhood"))
def best_crop(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: BestCropParams,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Find the crop of lowest inverse energy.

    Crops on a grid over the whole texture are compared, a thirtieth of a side apart: for each sampled neighbourhood
    of the texture, the distance to the nearest one on the grid inside the crop. The forward term of a crop is 0.

    Parameters
    ----------
    texture : the large texture.
    features : planes in which neighbourhoods are compared, CIELAB units; see `control_features`.
    control : control map cropped with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, used where ``params.size`` is null.

    Raises
    ------
    InputError
        no size is given, or it exceeds the texture's, or does not hold a neighbourhood.

    References
    ----------
    [Wei2008]_ Figure 2 compares with crops by hand; the inverse term is that of equation (1).
    """
    require_features("best_crop", features, texture)
    height, width = wanted_size("best_crop", params.size, texture, sides, params.neighbourhood)
    corner = best_corner(
        ExactEnergy(features, params.neighbourhood, params.samples), (height, width), params.finalists
    )
    assert corner is not None  # a crop lies inside a single texture
    down, across = corner[0] + np.arange(height), corner[1] + np.arange(width)
    return Copied.of(texture, control, np.stack(np.meshgrid(down, across, indexing="ij"), axis=2))
