"""The methods that are worth a trial with an exemplar."""

import dataclasses
from typing import Any

from pydantic import Field

from texloom.stages.vocabulary.arrays import Vectors
from texloom.stages.vocabulary.declare import InputError, Params, stage


class CandidateMethodsParams(Params):
    """The methods."""

    labels: tuple[str, ...] = Field(("self_tuning", "near_regular"), min_length=1)
    """all that there are"""
    methods: tuple[str, ...] = ()
    """those that may be tried; none: all"""
    of_lattices: tuple[str, ...] = ("near_regular",)
    """those that need a lattice of two directions"""


@dataclasses.dataclass(frozen=True)
class CandidateMethods:
    """The methods."""

    table: dict[str, Any]
    """``chosen``: the labels, in their order; ``because``: why these"""


@stage(version=1, role="choice")
def candidate_methods(generators: Vectors, params: CandidateMethodsParams) -> CandidateMethods:
    """Choose the methods that are tried: those that are asked for and that the exemplar's structure allows.

    Parameters
    ----------
    generators : of the exemplar's lattice, see `lattice_selection`: two rows where one is confirmed.

    Raises
    ------
    InputError : ``methods`` names one that there is not, or only those that need a lattice where there is none.

    References
    ----------
    Ours.
    """
    for name in params.methods:
        if name not in params.labels:
            raise InputError(f"methods: no method '{name}'; there are {', '.join(params.labels)}")
    asked = [label for label in params.labels if not params.methods or label in params.methods]
    left = [label for label in asked if label in params.of_lattices and len(generators) < 2]
    chosen = [label for label in asked if label not in left]
    if not chosen:
        raise InputError(f"methods: {', '.join(left)} needs a lattice, and the exemplar shows none")
    because = f"without {', '.join(left)}, as the exemplar shows no lattice" if left else "the exemplar allows all"
    return CandidateMethods({"chosen": chosen, "because": because})
