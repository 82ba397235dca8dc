"""The trend of an exemplar that changes from place to place."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.ageing import ageing
from tests.synthetic import blobs, masked, picture
from texloom.stages.analysis.control.progression import Progression, ProgressionParams, progression
from texloom.stages.common.features.slow_features import progression_in, slow_feature
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (96, 128)
ACROSS = np.broadcast_to((np.arange(SHAPE[1]) + 0.5) / SHAPE[1], SHAPE)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return ageing(SHAPE, rng)


def turned(image: Image) -> Image:
    """Rows for columns."""
    return picture(np.ascontiguousarray(np.swapaxes(image.pixels, 0, 1)))


def found(image: Image, given: Image | None = None, **params: float | bool) -> Progression:
    return progression(image, ProgressionParams(**params), given)


def follows(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def test_ageing_is_found_with_its_direction(exemplar: Image) -> None:
    trend = found(exemplar)
    assert follows(trend.progression, ACROSS) > 0.9
    assert follows(trend.slow, ACROSS) > 0.95
    assert abs(trend.angle) < 0.2
    assert trend.table == {"trend": round(trend.share, 4), "angle": trend.table["angle"], "found": True}
    for values in (trend.progression, trend.slow):  # evenly distributed
        np.testing.assert_allclose(np.quantile(values, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.02)


def test_a_turned_exemplar_has_the_turned_trend(exemplar: Image) -> None:
    trend = found(turned(exemplar))
    assert abs(trend.angle - np.pi / 2) < 0.2
    np.testing.assert_allclose(trend.progression, found(exemplar).progression.T, atol=0.02)


def test_a_mirrored_exemplar_grows_to_the_right_too(exemplar: Image) -> None:
    trend = found(picture(np.ascontiguousarray(exemplar.pixels[:, ::-1])))
    assert follows(trend.progression, ACROSS) > 0.9
    assert follows(found(exemplar, reverse=True).progression, 1 - ACROSS) > 0.9


def test_change_of_grain_alone_is_a_trend(rng: np.random.Generator) -> None:
    """Of the same mean colour everywhere."""
    fine, coarse = rng.random(SHAPE), blobs(SHAPE, rng, 3.0)
    grey = np.where(rng.random(SHAPE) < ACROSS, fine, coarse)[..., None].repeat(3, axis=2)
    assert abs(follows(found(picture(grey.astype(np.float32))).progression, ACROSS)) > 0.9


def test_an_exemplar_without_a_trend_is_refused(rng: np.random.Generator) -> None:
    even = picture(blobs((*SHAPE, 3), rng, 1.0).astype(np.float32))
    with pytest.raises(InputError, match=r"exemplar: has no trend: .* % of its variation is slow.*self_tuning"):
        found(even)
    assert found(even, min_trend=0).share < 0.02


def test_what_is_excluded_does_not_count(exemplar: Image, rng: np.random.Generator) -> None:
    usable = np.ones(SHAPE, bool)
    usable[30:60, 40:80] = False
    first = masked(exemplar, usable, 0.0)
    other = dataclasses.replace(first, pixels=first.pixels.copy())
    other.pixels[30:60, 40:80, :3] = rng.random((30, 40, 3))
    np.testing.assert_array_equal(found(first).progression, found(other).progression)
    assert follows(found(first).progression, ACROSS) > 0.9


def test_a_given_progression_replaces_the_found_one(exemplar: Image) -> None:
    down = np.linspace(0.2, 0.4, SHAPE[0] // 2)[:, None, None] * np.ones((1, SHAPE[1] // 2, 3))
    trend = found(exemplar, picture(down.astype(np.float32)))
    rows = np.broadcast_to(np.linspace(0, 1, SHAPE[0])[:, None], SHAPE)
    assert follows(trend.progression, rows) > 0.99
    assert (trend.share, trend.table["found"]) == (1.0, False)


@pytest.mark.parametrize(
    ("shape", "range_", "message"),
    [
        ((64, 64), 0.5, "progression: 64 x 64 px has another aspect"),
        (SHAPE, 0.0, "every channel is constant"),
    ],
)
def test_a_progression_that_does_not_fit_is_refused(
    exemplar: Image, shape: tuple[int, int], range_: float, message: str
) -> None:
    check = find_stage("analysis.progression").check
    assert check is not None
    given = picture(np.full(shape, 0.5) + range_ * np.linspace(0, 1, shape[1]))
    with pytest.raises(InputError, match=message):
        check(ProgressionParams(), {"image": exemplar, "given": given})


def test_the_progression_of_a_part_is_that_of_its_place(exemplar: Image) -> None:
    """Measured by the feature of the whole."""
    part = picture(np.ascontiguousarray(exemplar.pixels[:, 64:]))
    whole = progression_in(exemplar, exemplar)
    assert progression_in(part, exemplar).mean() > 0.65
    assert follows(whole, found(exemplar).progression) > 0.999
    assert slow_feature(exemplar).weights.shape == (6,)
