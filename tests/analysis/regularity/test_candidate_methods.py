"""The methods that are worth a trial."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from texloom.stages.analysis.regularity.candidate_methods import CandidateMethodsParams, candidate_methods
from texloom.stages.vocabulary.declare import InputError

LABELS = ("self_tuning", "quilting", "near_regular")


def table(rows: int, **params: Any) -> dict[str, Any]:
    generators = np.array([[16, 0], [0, 24]], np.float32)[:rows]
    return candidate_methods(generators, CandidateMethodsParams(labels=LABELS, **params)).table


def test_a_method_of_lattices_needs_one() -> None:
    assert table(2)["chosen"] == list(LABELS)
    for rows in (0, 1):
        made = table(rows)
        assert made["chosen"] == ["self_tuning", "quilting"]
        assert made["because"] == "without near_regular, as the exemplar shows no lattice"


def test_those_that_are_asked_for_in_their_order() -> None:
    assert table(0, methods=["quilting", "self_tuning"])["chosen"] == ["self_tuning", "quilting"]
    with pytest.raises(
        InputError, match="methods: no method 'tiles'; there are self_tuning, quilting, near_regular"
    ):
        table(2, methods=["tiles"])
    with pytest.raises(InputError, match="methods: near_regular needs a lattice, and the exemplar shows none"):
        table(0, methods=["near_regular"])
