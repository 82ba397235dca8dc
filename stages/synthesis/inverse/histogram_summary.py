"""A small texture that matches colour histograms alone: a baseline of compactions."""

from typing import Literal

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.synthesis.inverse.summary import Copied, SummaryParams, size_check, wanted_size
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import ColorField, Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.masks import fill_excluded

_STARTS = 16  # arrangements of blocks, of which one is chosen
_BINS = (10, 8, 8)  # of L, a and b


class HistogramSummaryParams(SummaryParams):
    """Size of the result, and the optimisation."""

    preset: Literal["kaspar2015", "default", "fast"] = "fast"
    """see `optimise`"""
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""


@stage(version=1, check=size_check("histogram_summary", "patch_size"))
def histogram_summary(
    texture: Image,
    params: HistogramSummaryParams,
    rng: np.random.Generator,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Synthesise a small texture that is similar to parts of a large one and keeps its colour histograms.

    Texture optimisation whose votes match histograms at every scale, without uniformity, from that of several
    arrangements of blocks whose histogram is most like the texture's. It lacks structures of similar colour.

    Parameters
    ----------
    texture : the large texture; its control map does not matter.
    control : copied with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, used where ``params.size`` is null.

    Raises
    ------
    InputError
        no size is given, or it exceeds the texture's, or does not hold a patch.

    References
    ----------
    [Kopf2007]_ for the histograms; [Wei2008]_ Figure 4 compares with it. Pixels are copied, not averaged, as the
    compaction's are.
    """
    size = wanted_size("histogram_summary", params.size, texture, sides, params.patch_size)
    starting, optimising = rng.spawn(2)
    colors = lab_from_linear(fill_excluded(texture).color)
    wanted = _histogram(colors)
    starts = [
        initialise(texture, InitialiseParams(size=size, method="blocks", block=8), random).match
        for random in starting.spawn(_STARTS)
    ]
    start = min(starts, key=lambda match: np.abs(_histogram(colors[match[..., 0], match[..., 1]]) - wanted).sum())
    options = OptimiseParams(
        preset=params.preset, patch_size=params.patch_size, occurrence=0.0, histogram_share=1.0
    )
    made = optimise(texture, start, options, optimising)
    return Copied.of(texture, control, made.match)


def _histogram(colors: ColorField) -> Float64[np.ndarray, "10 8 8"]:
    """Shares of colours; all of CIELAB that sRGB has."""
    counts, _ = np.histogramdd(colors.reshape(-1, 3), _BINS, [(0, 100), (-90, 100), (-110, 95)])
    return counts / counts.sum()
