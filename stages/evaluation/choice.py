"""The best of some textures, and why."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from texloom.stages.evaluation._measures.table import rounded
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage

_PLACES = ("first", "second", "third", "fourth", "fifth", "sixth")


class ChoiceParams(Params):
    """What counts."""

    weights: dict[str, float] = Field({"fidelity": 1.0, "structure": 1.0, "detail": 0.5, "variety": 0.5})
    """weight of each score; those that a texture lacks do not count"""
    labels: tuple[str, ...] = Field(("first", "second"), min_length=1, max_length=len(_PLACES))
    """names of the textures in the table, from the first on"""
    margin: float = Field(0.0, ge=0, le=1)
    """advantage over the first of those that are there that another one must have to be chosen"""


@dataclasses.dataclass(frozen=True)
class Choice:
    """The best one."""

    image: Image
    """that with the highest weighted mean of scores"""
    scores: dict[str, Any]
    """its table of `metrics`"""
    table: dict[str, Any]
    """``chosen``, a label; ``because``, a sentence; ``totals`` and ``scores`` by label"""


def weighted_mean(scores: Mapping[str, float | None], weights: Mapping[str, float]) -> float | None:
    """Mean of the known scores that have a weight, which is what `choice` compares; None if there are none."""
    known = [(weights[name], score) for name, score in scores.items() if score is not None and name in weights]
    total = sum(weight for weight, _ in known)
    return sum(weight * score for weight, score in known) / total if total else None


@stage(version=3, role="choice")
def choice(
    params: ChoiceParams,
    first: Image | None = None,
    first_scores: dict[str, Any] | None = None,
    second: Image | None = None,
    second_scores: dict[str, Any] | None = None,
    third: Image | None = None,
    third_scores: dict[str, Any] | None = None,
    fourth: Image | None = None,
    fourth_scores: dict[str, Any] | None = None,
    fifth: Image | None = None,
    fifth_scores: dict[str, Any] | None = None,
    sixth: Image | None = None,
    sixth_scores: dict[str, Any] | None = None,
) -> Choice:
    """Choose the best of up to six textures of one exemplar by their scores, and report why.

    Parameters
    ----------
    first, second, third, fourth, fifth, sixth : the textures; those that are missing are not chosen.
    first_scores, second_scores, third_scores, fourth_scores, fifth_scores, sixth_scores : tables of `metrics`, one
        for each texture.

    Raises
    ------
    InputError : there is no texture; one has no scores, or no label.

    References
    ----------
    Ours.
    """
    images = (first, second, third, fourth, fifth, sixth)
    tables = (first_scores, second_scores, third_scores, fourth_scores, fifth_scores, sixth_scores)
    there: dict[str, tuple[Image, dict[str, Any]]] = {}
    for number, (place, image, measured) in enumerate(zip(_PLACES, images, tables, strict=True)):
        if image is None:
            continue
        if measured is None:
            raise InputError(f"{place}: has no scores; give {place}_scores")
        if number >= len(params.labels):
            raise InputError(f"labels: names {len(params.labels)} textures, but there is a {place}")
        there[params.labels[number]] = image, measured
    if not there:
        raise InputError(f"first: there is no texture to choose: none of {', '.join(params.labels)} was made")
    scores = {
        label: {name: measured["summary"].get(name) for name in params.weights}
        for label, (_, measured) in there.items()
    }
    totals, shared = _totals(scores, params.weights)
    chosen = _best(totals, params.margin)
    table = {"chosen": chosen, "because": _because(chosen, totals, scores, shared, params.weights)}
    return Choice(*there[chosen], {**table, "totals": totals, "scores": scores})


def _totals(
    scores: Mapping[str, Mapping[str, float | None]], weights: Mapping[str, float]
) -> tuple[dict[str, float | None], list[str]]:
    """Weighted mean of each texture's scores, and the names of those that all have, of which it is made."""
    shared = [name for name in weights if all(one[name] is not None for one in scores.values())]
    return {
        label: rounded(weighted_mean({name: one[name] for name in shared}, weights))
        for label, one in scores.items()
    }, shared


def _best(totals: Mapping[str, float | None], margin: float) -> str:
    """The label of the highest total; that of the first unless another one is better by more than ``margin``."""
    first = next(iter(totals))
    best = max(totals, key=lambda label: totals[label] or 0.0)
    return best if (totals[best] or 0.0) > (totals[first] or 0.0) + margin else first


def _because(
    chosen: str,
    totals: Mapping[str, float | None],
    scores: Mapping[str, Mapping[str, float | None]],
    shared: Sequence[str],
    weights: Mapping[str, float],
) -> str:
    """Why, in a sentence: the totals, and the largest difference to the best of the others."""
    others = [label for label in totals if label != chosen]
    if not others:
        return f"{chosen} alone is there"
    left = max(others, key=lambda label: totals[label] or 0.0)
    gains = {name: (scores[chosen][name] or 0.0) - (scores[left][name] or 0.0) for name in shared}
    if not gains:
        return "no score was measured for all" if len(others) > 1 else "no score was measured for both"
    decisive = max(gains, key=lambda name: weights[name] * gains[name])
    all_totals = ", ".join(f"{label} {totals[label]:.3f}" for label in others)
    against = f"to {left} is" if len(others) > 1 else "is"
    return (
        f"{chosen} scores {totals[chosen]:.3f}, {all_totals}; the largest difference {against} in {decisive}, "
        f"{scores[chosen][decisive]:.3f} against {scores[left][decisive]:.3f}"
    )
