"""Common phase: a repeating texture continues the repetition of the scene that it is placed in."""

import dataclasses
import itertools
from typing import Annotated

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.photographs.repetition_phase import mean_repetition, phase_offset
from texloom.stages.analysis.photographs.unroll import UnrollParams, unroll
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.repetition import RepetitionParams, repetition
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Channels, Image, Jacobian, Mask, Vectors
from texloom.stages.vocabulary.declare import Params, stage

_MIN_REGION = 1024  # px of the scene; fewer show no repetition


class CommonPhaseParams(Params):
    """When repetitions count as the same."""

    tolerance: float = Field(0.1, ge=0, le=0.5)
    """maximum difference between the generators of texture and scene, as a share of the shortest; 0 ignores the
    scene's repetition"""


@dataclasses.dataclass(frozen=True)
class CommonPhase:
    """Where the texture lies."""

    chart: Annotated[Float32[np.ndarray, "H W 2"], Channels(("row", "column"))]
    """position of each pixel of the result in the flat texture; the given one where the scene does not repeat, or
    otherwise"""


@stage(version=1)
def common_phase(
    image: Image,
    generators: Vectors,
    scene: Image,
    jacobian: Jacobian,
    region: Mask,
    chart: Float32[np.ndarray, "H W 2"],
    corner: Int64[np.ndarray, "2"],
    params: CommonPhaseParams,
) -> CommonPhase:
    """Lay a texture in phase with the repetition around the place that it goes to.

    The scene's surface is laid flat and its repetition is found as that of the texture. Where both have nearly the
    same generators, the phase between them is the one at which their mean repetitions correlate most.

    Parameters
    ----------
    image : the flat texture.
    generators : of its repetition, px; no rows where it does not repeat.
    scene : the photograph that the texture is placed in.
    jacobian, region : of the scene, in the texture's unit; see `jacobian_field`.
    chart, corner : of the result, see `hole_window`.

    References
    ----------
    Ours.
    """
    kept = CommonPhase(chart)
    if not len(generators) or not params.tolerance or np.count_nonzero(region) < _MIN_REGION:
        return kept
    flat = unroll(scene, jacobian, region[None], UnrollParams())
    offsets = offset_statistics(flat.image, OffsetStatisticsParams())
    lattice = lattice_selection(flat.image, offsets.density, LatticeSelectionParams(stripes=True))
    around = repetition(flat.image, lattice.generators, RepetitionParams()).generators.astype(np.float64)
    if not len(around):
        return kept
    own = _nearest_generators(generators.astype(np.float64), around)
    if np.hypot(*(own - around).T).max() > params.tolerance * np.hypot(*around.T).min():
        return kept
    offset = phase_offset(mean_repetition(flat.image, around), mean_repetition(image, own))
    top, left = corner
    there = flat.chart[top : top + chart.shape[0], left : left + chart.shape[1]].astype(np.float64)
    cycles = matrix_product(there, inverse_of(around)) + offset
    return CommonPhase(matrix_product(cycles, own).astype(np.float32))


def _nearest_generators(
    generators: Float64[np.ndarray, "2 2"], wanted: Float64[np.ndarray, "2 2"]
) -> Float64[np.ndarray, "2 2"]:
    """The generators of the same lattice that are most like others."""
    steps = [np.array(entries).reshape(2, 2) for entries in itertools.product((-1, 0, 1), repeat=4)]
    bases = [matrix_product(step, generators) for step in steps if abs(round(determinant(step))) == 1]
    return min(bases, key=lambda basis: float(np.square(basis - wanted).sum()))
