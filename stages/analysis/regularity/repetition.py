"""Lattice generators refined to a fraction of a pixel."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.analysis.regularity.lattice import valid_lightness
from texloom.stages.analysis.regularity.pattern_search import autocorrelation_splines, refined_generators
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_FIRST_STEP = 0.25  # of the search, as a share of the shorter generator


class RepetitionParams(Params):
    """When generators are accepted."""

    correlation: float = Field(0.1, ge=-1, le=2)
    """minimum mean correlation of the exemplar with itself at all repetitions; 2 accepts none"""


@dataclasses.dataclass(frozen=True)
class Repetition:
    """The refined generators, if they were accepted."""

    generators: Vectors
    """px, accurate to about 0.01; no rows where the exemplar does not repeat by them"""
    correlation: float
    """mean correlation at all repetitions with enough overlap, -1..1; 0 without generators"""


@stage(version=1)
def repetition(image: Image, generators: Vectors, params: RepetitionParams) -> Repetition:
    """Refine the generators of a lattice, so that they hold across the whole exemplar.

    A pattern search maximises the mean autocorrelation at the lattice points up to 1, 2, 4, ... repetitions of the
    generators. Excluded pixels have no influence.

    Parameters
    ----------
    image : the exemplar.
    generators : initial values, as from `lattice_selection`; with less than two rows there is nothing to refine.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    Ours.
    """
    none = Repetition(np.zeros((0, 2), np.float32), 0.0)
    if len(generators) < 2:
        return none
    splines, known = autocorrelation_splines(valid_lightness(image), valid_pixels(image))
    best, value = refined_generators(splines, known, reduced(generators), _FIRST_STEP)
    if value < params.correlation:
        return dataclasses.replace(none, correlation=value)
    return Repetition(reduced(best).astype(np.float32), value)
