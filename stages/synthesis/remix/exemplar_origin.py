"""Which of several exemplars a texture shows where."""

import dataclasses
import logging
from typing import Any

import numpy as np

from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.common.source_maps.origins import Origin, origin_of
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.color import linear_from_lab
from texloom.stages.vocabulary.declare import Params, stage

_LOG = logging.getLogger(__name__)

_LIGHTNESS, _CHROMA = 62.0, 45.0  # CIELAB units, of the colours in the picture
_FAR = 0.25  # of what was wanted, from which a different share is said
_TURN = 2.399963  # radians from one hue to the next, the golden angle


class ExemplarOriginParams(Params):
    """None."""


@dataclasses.dataclass(frozen=True)
class ExemplarOrigin:
    """The exemplar of every pixel."""

    origin: Origin
    """number of the exemplar, and row and column in it"""
    picture: Image
    """a colour for each exemplar"""
    table: dict[str, Any]
    """``exemplars``: in order, each with its ``name``, its ``share`` of the texture and what was ``wanted``"""


@stage(version=1)
def exemplar_origin(
    match: Correspondence,
    rectangles: Rectangles,
    names: list[str],
    wanted: list[float],
    params: ExemplarOriginParams,  # noqa: ARG001
) -> ExemplarOrigin:
    """Tell from which exemplar, and from where in it, each pixel of a texture is.

    Parameters
    ----------
    match : sources in a picture of all exemplars.
    rectangles, names, wanted : of the exemplars in it; see `exemplar_sheet`.

    References
    ----------
    Ours.
    """
    origin = origin_of(np.moveaxis(match, 2, 0).astype(np.int64), rectangles)
    number = origin[..., 0]
    shares = np.bincount(number.ravel(), minlength=len(names)) / number.size
    hue = _TURN * np.arange(len(names))
    lab = np.stack([np.full(len(names), _LIGHTNESS), _CHROMA * cos(hue), _CHROMA * sin(hue)], axis=1)
    colors = np.clip(linear_from_lab(lab[None].astype(np.float32))[0], 0, 1)
    table = []
    for name, share, asked in zip(names, shares.tolist(), wanted, strict=True):
        table.append({"name": name, "share": round(share, 4), "wanted": round(asked, 4)})
        if abs(share - asked) > _FAR * asked:
            _LOG.warning("%s: %.0f %% of the texture, where %.0f %% were wanted", name, 100 * share, 100 * asked)
    return ExemplarOrigin(
        origin, Image(np.ascontiguousarray(colors[number]), ("R", "G", "B")), {"exemplars": table}
    )
