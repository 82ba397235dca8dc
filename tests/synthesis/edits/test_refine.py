from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import blobs, identity, masked, picture
from texloom.stages.common.source_maps.exemplar_use import use_of_exemplar
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.synthesis.edits.refine import Refined, RefineParams, refine
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (96, 96)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


@pytest.fixture
def match() -> np.ndarray:
    """A copy of the exemplar, some squares of which come from elsewhere."""
    match = identity(SHAPE)
    for row, column in ((20, 20), (60, 50)):
        there = ((row + 41) % 80, (column + 33) % 80)
        match[row : row + 12, column : column + 12] = identity(SHAPE)[
            there[0] : there[0] + 12, there[1] : there[1] + 12
        ]
    return match


def of(exemplar: Image, match: np.ndarray) -> Image:
    return Image(exemplar.pixels[match[..., 0], match[..., 1]], exemplar.channels)


def run(exemplar: Image, match: np.ndarray, seed: int = 5, **options: Any) -> Refined:
    image = options.pop("image", None) or of(exemplar, match)
    params = RefineParams(**{"preset": "fast", "margin": 24, "radius": 12, "places": 3, "rounds": 1, **options})
    return refine(image, match, exemplar, params, np.random.default_rng(seed))


def joints(exemplar: Image, image: Image, match: np.ndarray, tileable: bool) -> dict[str, Any]:
    measures = metrics(exemplar, image.wrapping(tileable), MetricsParams(), match).table["measures"]
    use = float(use_of_exemplar(match, exemplar.shape[:2]).std())
    return {**{name: measures[name]["value"] for name in ("joints", "coherence")}, "use": use}


@pytest.mark.parametrize("tileable", [False, True])
def test_joints_get_better_and_nothing_else_changes(exemplar: Image, match: np.ndarray, tileable: bool) -> None:
    image = of(exemplar, match)
    result = run(exemplar, match, tileable=tileable)
    before = joints(exemplar, image, match, tileable)
    after = joints(exemplar, result.image, result.match, tileable)
    assert result.changed.any() or tileable  # the border of a copy is worse than what is laid over it
    np.testing.assert_array_equal(result.image.pixels[~result.changed], image.pixels[~result.changed])
    np.testing.assert_array_equal(result.match[~result.changed], match[~result.changed])
    assert after["joints"] < before["joints"] if result.changed.any() else after == before
    assert after["use"] <= 1.011 * before["use"]
    assert result.table["before"] == pytest.approx(before["joints"], abs=1e-3)
    assert result.table["after"] == pytest.approx(after["joints"], abs=1e-3)
    for place in result.table["places"]:
        assert place["after"] < place["before"] if place["improved"] else place["after"] == place["before"]


def test_more_rounds_are_never_worse(exemplar: Image, match: np.ndarray) -> None:
    """Each goes on from the one before."""
    values = [run(exemplar, match, rounds=rounds, tries=1).table["after"] for rounds in (1, 2, 3)]
    assert values == sorted(values, reverse=True)


def test_one_result_for_any_number_of_threads(
    exemplar: Image, match: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = run_with_threads(lambda: run(exemplar, match, tries=1), monkeypatch, (1, 2))
    np.testing.assert_array_equal(one.image.pixels, two.image.pixels)
    np.testing.assert_array_equal(one.match, two.match)
    assert one.table == two.table


def test_what_is_perfect_stays(exemplar: Image, match: np.ndarray) -> None:
    """A copy has no joints; without rounds nothing is measured."""
    for result in (run(exemplar, identity(SHAPE)), run(exemplar, match, rounds=0)):
        assert not result.changed.any()
        assert result.table["places"] == []
    np.testing.assert_array_equal(run(exemplar, match, rounds=0).match, match)


def test_masked_pixels_are_never_used(exemplar: Image, match: np.ndarray) -> None:
    usable = np.ones(SHAPE, bool)
    usable[80:, :30] = False
    results = [
        run(masked(exemplar, usable, value), match, image=of(exemplar, match), tries=1) for value in (0.0, 5.0)
    ]
    np.testing.assert_array_equal(results[0].image.pixels, results[1].image.pixels)
    assert usable[tuple(results[0].match[results[0].changed].T)].all()


def test_inputs_that_are_refused(exemplar: Image, match: np.ndarray) -> None:
    image = of(exemplar, match)
    with pytest.raises(InputError, match="cannot be measured below"):
        run(picture(np.ones((20, 20, 3))), identity((20, 20)))
    with pytest.raises(ValueError, match="for a texture of"):
        run(exemplar, match[:50], image=image)
    with pytest.raises(ValueError, match="beyond the exemplar"):
        run(exemplar, match + 60, image=image)
    with pytest.raises(InputError, match="lacks the channel"):
        run(picture(np.ones(SHAPE)), match, image=image)
