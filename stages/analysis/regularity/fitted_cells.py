"""An exemplar scaled so that whole cells of its lattice fit the sides of a tileable result."""

import dataclasses
import itertools
import logging
import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.common.grids.resampled import scaled_to
from texloom.stages.common.regularity.lattice_cells import steps_along
from texloom.stages.vocabulary.arrays import Channels, Image, Vectors
from texloom.stages.vocabulary.declare import Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.messages import OWN_STEP
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

MOST_SCALED = 1.2
"""of a scale: more is another texture"""
_SHAPE = 4.0  # weight of a change of the cells' shape against that of their size
_TOGETHER = 0.1  # cells by which one generator's number may miss a whole one where the other's is
_NONE = 0.05  # cells along a side that count as none: a generator that runs along the other

Others = Annotated[Float32[np.ndarray, "_ 2"], Channels(("row", "column"))]
"""generators, px, of another number of rows"""


class FittedCellsParams(Params):
    """The result that cells are to fit."""

    fit: bool = Field(True)
    """scale the exemplar so that whole cells fit a tileable result, instead of cutting cells to fit"""
    least: float = Field(0.02, ge=0, le=0.2)
    """smallest change of a side, as a share, that is worth a resampling; less hides by itself"""
    result: Size = Field((1024, 1024), validate_default=True)
    """size of the result, px"""
    tileable: Tileable = NOWHERE
    """axes along which the result continues across its borders"""


@dataclasses.dataclass(frozen=True)
class FittedCells:
    """An exemplar whose cells fit a result."""

    image: Image
    """scaled along each side; as it was where nothing is"""
    scaled: Image | None
    """the same, for exports; None where nothing is scaled"""
    generators: Vectors
    """of its lattice, px"""
    known: Others
    """those of ``known``, px"""
    table: dict[str, Any]
    """``why``: a sentence, empty where nothing is scaled; ``scale``: of rows and of columns"""


def outlines(params: FittedCellsParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image keeps its maps, and its size to a fifth."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(image.height, image.width, image.channels)}


@stage(version=2, outlines=outlines)
def fitted_cells(
    image: Image, generators: Vectors, params: FittedCellsParams, known: Others | None = None
) -> FittedCells:
    """Scale an exemplar so that whole cells of its lattice fit the sides along which a result is tileable.

    A result of 7.5 cells has to show seven or eight, and cells that are cut to that show joints twice, or stones
    that are fused. Scaling hides the difference. Of the numbers of cells next to those that the sides hold, those
    are taken that change size and shape of the cells least, by up to a fifth. Normals lean with the cells.

    Parameters
    ----------
    image : the exemplar.
    generators : its lattice, or one across its courses; an exemplar without any is left as it is.
    known : other generators of it, as from `between_joints`, which are scaled too and fitted instead where there
        are any rows.

    References
    ----------
    Ours.
    """
    fixed = generators[:0] if known is None else known
    fitted = fixed if len(fixed) else generators
    scale = np.ones(2)
    if params.fit and len(fitted):
        scale = np.array(_scale(fitted.astype(np.float64), params.result, params.tileable))
    if np.abs(scale - 1).max() < params.least:
        return FittedCells(image, None, generators, fixed, {"why": "", "scale": [1.0, 1.0]})
    before = np.array([image.height, image.width])
    rows, columns = np.rint(before * scale).astype(np.int64).tolist()
    made, scale = scaled_to(image, (rows, columns)), np.array([rows, columns]) / before
    (down, across), (height, width) = scale.tolist(), params.result
    why = f"scaled to {across:.1%} across and {down:.1%} down, so that whole cells fit {width} x {height} px"
    _LOG.warning("%s (--set %s.fit=false cuts cells instead)", why, OWN_STEP)
    own, table = np.float32(scale), {"why": why, "scale": [round(down, 4), round(across, 4)]}
    return FittedCells(made, made, generators * own, fixed * own, table)


def _scale(generators: Float64[np.ndarray, "_ 2"], size: tuple[int, int], wrap: Wraps) -> tuple[float, float]:
    """Of rows and of columns; 1 along sides that do not wrap, or that no whole cells fit."""
    cells = steps_along(generators) * np.array(size, np.float64)[:, None]
    downs, acrosses = (_scales(row) if around else [1.0] for row, around in zip(cells, wrap, strict=True))

    def cost(scales: tuple[float, float]) -> float:
        down, across = (math.log(one) for one in scales)
        return down**2 + across**2 + _SHAPE * (down - across) ** 2

    return min(itertools.product(downs, acrosses), key=cost)


def _scales(cells: np.ndarray) -> list[float]:
    """Scales after which a side holds whole numbers of cells along all generators; 1 where there are none."""
    along = np.abs(cells[np.abs(cells) > _NONE])
    found = []
    for count in along.tolist():
        for whole in range(max(1, math.floor(count) - 1), math.ceil(count) + 2):
            scale = count / whole
            numbers = along / scale
            if 1 / MOST_SCALED <= scale <= MOST_SCALED and np.abs(numbers - np.rint(numbers)).max() <= _TOGETHER:
                found.append(scale)
    return found or [1.0]
