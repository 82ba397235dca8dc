"""The better of two textures, and why."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from pydantic import Field

from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage


class ChoiceParams(Params):
    """What counts."""

    weights: dict[str, float] = Field({"fidelity": 1.0, "structure": 1.0, "detail": 0.5, "variety": 0.5})
    """weight of each score; those that a texture lacks do not count"""
    labels: tuple[str, str] = ("first", "second")
    """names of the textures in the table"""
    margin: float = Field(0.0, ge=0, le=1)
    """advantage that the second must have to be chosen"""


@dataclasses.dataclass(frozen=True)
class Choice:
    """The better one."""

    image: Image
    """that with the higher weighted mean of scores"""
    table: dict[str, Any]
    """``chosen``, a label; ``because``, a sentence; ``totals`` and ``scores`` by label"""


def weighted_mean(scores: Mapping[str, float | None], weights: Mapping[str, float]) -> float | None:
    """Mean of the known scores that have a weight, which is what `choice` compares; None if there are none."""
    known = [(weights[name], score) for name, score in scores.items() if score is not None and name in weights]
    total = sum(weight for weight, _ in known)
    return sum(weight * score for weight, score in known) / total if total else None


@stage(version=2, role="choice")
def choice(
    first: Image,
    second: Image,
    first_scores: dict[str, Any],
    second_scores: dict[str, Any],
    params: ChoiceParams,
) -> Choice:
    """Choose the better of two textures of one exemplar by their scores, and report why.

    Parameters
    ----------
    first, second : the textures.
    first_scores, second_scores : tables of `metrics`.

    References
    ----------
    Ours.
    """
    scores = {
        label: {name: table["summary"].get(name) for name in params.weights}
        for label, table in zip(params.labels, (first_scores, second_scores), strict=True)
    }
    shared = [name for name in params.weights if all(one[name] is not None for one in scores.values())]
    totals = {
        label: rounded(weighted_mean({name: one[name] for name in shared}, params.weights))
        for label, one in scores.items()
    }
    one, other = (value or 0.0 for value in totals.values())
    better = int(other > one + params.margin)
    chosen, left = params.labels[better], params.labels[1 - better]
    gains = {name: scores[chosen][name] - scores[left][name] for name in shared}
    decisive = max(gains, key=lambda name: params.weights[name] * gains[name], default=None)
    because = (
        f"{chosen} scores {totals[chosen]:.3f}, {left} {totals[left]:.3f}; the largest difference is in "
        f"{decisive}, {scores[chosen][decisive]:.3f} against {scores[left][decisive]:.3f}"
        if decisive
        else "no score was measured for both"
    )
    table = {"chosen": chosen, "because": because, "totals": totals, "scores": scores}
    return Choice(second if better else first, table)
