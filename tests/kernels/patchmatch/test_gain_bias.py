"""The kernels of image melding against plain formulas, one patch at a time."""

import math

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from tests.wraps import WRAPS, sides
from texloom.stages.common.similarity.neighbourhoods import UNIT
from texloom.stages.kernels.patchmatch.gain_bias import fit_matches, fitted_distance, fitted_votes
from texloom.stages.synthesis.optimisation.match_search import Effort
from texloom.stages.synthesis.optimisation.melding import Bounds, Melding, forward_gradients
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIZE, WEIGHT, MAPS = 4, 0.5, 2
BOUNDS = Bounds(min_gain=0.8, max_gain=1.4, bias_lightness=6.0, bias_color=9.0)


def planes(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """CIELAB and maps, whole numbers of fixed-point steps."""
    noise = smooth_noise((height, width, 3 + MAPS), 1.2, rng) * 60
    return (np.rint(noise * UNIT) / UNIT).astype(np.float32)


def melding(exemplar: np.ndarray, wrap: Wraps = NOWHERE) -> Melding:
    return Melding(exemplar, SIZE, WEIGHT, BOUNDS, None, wrap)


def fit(target: np.ndarray, exemplar: np.ndarray, channel: int) -> tuple[float, float]:
    """Gain of standard deviations about the mean, then a shift of means, each within its bounds."""
    bias = BOUNDS.bias_lightness if channel == 0 else BOUNDS.bias_color
    gain = float(np.clip(target.std() / exemplar.std(), BOUNDS.min_gain, BOUNDS.max_gain))
    shift = float(np.clip(target.mean() - exemplar.mean(), -bias, bias))
    return gain, shift + (1 - gain) * float(exemplar.mean())


def patch(image: np.ndarray, at: tuple[int, int]) -> np.ndarray:
    return image[at[0] : at[0] + SIZE, at[1] : at[1] + SIZE].astype(np.float64)


def direct(target: np.ndarray, exemplar: np.ndarray, at: tuple[int, int], place: tuple[int, int]) -> float:
    """Squared difference of two patches, pixel by pixel."""
    one, other = patch(target, at), patch(exemplar, place)
    total, gain_of_lightness = 0.0, 1.0
    for channel in range(3):
        gain, bias = fit(one[..., channel], other[..., channel], channel)
        if channel == 0:
            gain_of_lightness = gain
        total += float(((one[..., channel] - gain * other[..., channel] - bias) ** 2).sum())
    for own, its in zip(forward_gradients(target, NOWHERE), forward_gradients(exemplar, NOWHERE), strict=True):
        difference = patch(own, at)[..., 0] - gain_of_lightness * patch(its, place)[..., 0]
        total += WEIGHT * float((difference**2).sum())
    return total + float(((one[..., 3:] - other[..., 3:]) ** 2).sum())


def test_a_distance_is_that_of_the_fitted_patch(rng: np.random.Generator) -> None:
    target, exemplar = planes(14, 13, rng), planes(12, 15, rng)
    state = melding(exemplar)
    own = state._side(target, NOWHERE)
    for _ in range(30):
        at = (int(rng.integers(11)), int(rng.integers(10)))
        place = (int(rng.integers(9)), int(rng.integers(12)))
        made = fitted_distance(state.run, own, state.exemplar, state.limits, *at, *place, math.inf)
        assert made / UNIT**2 == pytest.approx(direct(target, exemplar, at, place), rel=0.02)
        # What is above a limit may be anything above it.
        assert fitted_distance(state.run, own, state.exemplar, state.limits, *at, *place, made / 2) >= made / 2


def test_gain_and_bias_have_closed_form(rng: np.random.Generator) -> None:
    target, exemplar = planes(14, 13, rng), planes(12, 15, rng)
    state = melding(exemplar)
    match = np.stack([rng.integers(0, count, (11, 10)) for count in (9, 12)]).astype(np.int32)
    gain, bias = np.empty((3, 11, 10), np.float32), np.empty((3, 11, 10), np.float32)
    fit_matches(state._side(target, NOWHERE), state.exemplar, state.limits, *match, gain, bias, 0, 11)
    for at in np.ndindex(11, 10):
        for channel in range(3):
            one, other = patch(target, at), patch(exemplar, tuple(match[:, *at]))
            expected = fit(one[..., channel], other[..., channel], channel)
            assert gain[channel, *at] == pytest.approx(expected[0], rel=1e-4)
            assert bias[channel, *at] / UNIT == pytest.approx(expected[1], abs=1e-3)


@pytest.mark.parametrize("wrap", WRAPS)
def test_votes_are_sums_over_patches(rng: np.random.Generator, wrap: Wraps) -> None:
    down, across, plane = 7, 6, rng.random((9, 10), np.float32)
    match = np.stack([rng.integers(0, count, (down, across)) for count in (6, 7)]).astype(np.int32)
    gain, bias = (rng.random((down, across), np.float32) for _ in range(2))
    weights = np.array([1, 3, 2, 1], np.float32)
    height, width = sides((down, across), SIZE - 1, wrap)
    sums = np.empty((height, across + SIZE - 1), np.float32)
    fitted_votes(*match, plane, gain, bias, weights, wrap, sums, 0, height)
    expected = np.zeros((height, width))
    for y, x in np.ndindex(down, across):
        own = gain[y, x] * patch(plane, tuple(match[:, y, x])) + bias[y, x]
        for i, j in np.ndindex(SIZE, SIZE):
            to = ((y + i) % expected.shape[0], (x + j) % expected.shape[1])
            expected[to] += weights[i] * weights[j] * own[i, j]
    np.testing.assert_allclose(sums[:, :width], expected, rtol=1e-5)


def test_the_search_comes_close_to_all_nearest_patches(rng: np.random.Generator) -> None:
    """Against trying every patch."""
    target, exemplar = planes(16, 16, rng), planes(14, 14, rng)
    state = melding(exemplar)
    match = np.stack([rng.integers(0, 11, (13, 13)) for _ in range(2)]).astype(np.int32)
    energy, _, _ = state.step(target, match, Effort(12, 20, 0, 0.0), rng)
    own = state._side(target, NOWHERE)
    nearest = [
        min(
            fitted_distance(state.run, own, state.exemplar, state.limits, *at, *place, math.inf)
            for place in np.ndindex(11, 11)
        )
        for at in np.ndindex(13, 13)
    ]
    best = float(np.mean(nearest)) / (UNIT * SIZE) ** 2
    assert best <= energy + 1e-9
    assert energy < 1.1 * best
