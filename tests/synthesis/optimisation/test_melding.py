"""The vote of image melding: gradients and values joined."""

import numpy as np
import pytest

from tests.wraps import WRAPS
from texloom.stages.synthesis.optimisation.melding import Bounds, Melding, forward_gradients, meld
from texloom.stages.synthesis.optimisation.vote import vote_pixels, window
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

FREE = Bounds(min_gain=0.5, max_gain=2.0, bias_lightness=50.0, bias_color=50.0)
FIXED = Bounds(min_gain=1.0, max_gain=1.0, bias_lightness=0.0, bias_color=0.0)


@pytest.mark.parametrize("wrap", WRAPS)
def test_melding_minimises_both_differences(wrap: Wraps, rng: np.random.Generator) -> None:
    """Against a dense least-squares solution."""
    shape, weight = (5, 6), 0.7
    values, below, beside = (rng.normal(size=shape).astype(np.float32) for _ in range(3))
    places = np.arange(values.size).reshape(shape)
    rows, right = [np.eye(values.size)], [values.ravel().astype(float)]
    for axis, wanted in enumerate((below, beside)):
        after = np.roll(places, -1, axis)
        inside = np.ones(shape, bool)
        if not wrap[axis]:
            inside[(slice(None),) * axis + (-1,)] = False
        steps = np.zeros((int(inside.sum()), values.size))
        steps[np.arange(len(steps)), after[inside]] += 1
        steps[np.arange(len(steps)), places[inside]] -= 1
        rows.append(np.sqrt(weight) * steps)
        right.append(np.sqrt(weight) * wanted[inside])
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0].reshape(shape)
    np.testing.assert_allclose(meld(values, below, beside, weight, wrap), expected, atol=1e-5)


@pytest.mark.parametrize("wrap", WRAPS)
def test_a_plane_and_its_own_gradients_stay(wrap: Wraps, rng: np.random.Generator) -> None:
    values = rng.random((9, 8), np.float32)
    below, beside = (plane[..., 0] for plane in forward_gradients(values[..., None], wrap))
    np.testing.assert_allclose(meld(values, below, beside, 2.0, wrap), values, atol=1e-6)


@pytest.mark.parametrize("wrap", WRAPS)
def test_without_gain_bias_and_gradients_it_is_the_plain_vote(wrap: Wraps, rng: np.random.Generator) -> None:
    exemplar = (50 * rng.random((14, 15, 4))).astype(np.float32)
    match = np.stack([rng.integers(0, count, (12, 13)) for count in (11, 12)]).astype(np.int32)
    expected = vote_pixels(match, exemplar, window(4), wrap)
    melding = Melding(exemplar, 4, 0.0, FIXED, None, wrap)
    made = melding.vote(match, np.zeros_like(expected), exemplar, window(4))
    np.testing.assert_allclose(made, expected, rtol=1e-5, atol=1e-4)


def test_tone_follows_the_target(rng: np.random.Generator) -> None:
    """A target with other tone and contrast, matched with the same places, keeps its tone and contrast."""
    exemplar = (30 + 40 * rng.random((24, 24, 3))).astype(np.float32)
    target = np.float32(0.7) * exemplar + 12
    match = np.indices((21, 21)).astype(np.int32)
    made = Melding(exemplar, 4, 0.2, FREE, None, NOWHERE).vote(match, target, exemplar, window(4))
    np.testing.assert_allclose(made, target, atol=0.1)
