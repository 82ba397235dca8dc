"""Steps of tone at joints are spread over the pieces beside them."""

from pathlib import Path

import numpy as np
import pytest

from texloom.stages.common.source_maps.tone_steps import SEEN, ToneSteps
from texloom.stages.kernels.core import threads
from texloom.stages.synthesis.optimisation.even_joints import EvenJoints
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import USABLE
from texloom.stages.vocabulary.scratch import Scratch, using

SIDE = 160  # px


def uneven(channels: int = 3, light: tuple[float, float] = (0.25, 0.5)) -> Image:
    """A ground whose light drifts from left to right, with grain and dark squares."""
    values = np.linspace(*light, SIDE)[None, :] * (1 + np.random.default_rng(0).normal(0, 0.01, (SIDE, SIDE)))
    row, column = np.indices(values.shape)
    values = np.where((row % 40 < 12) & (column % 32 < 12), 0.05, values)
    tint = np.array([1.0, 0.9, 0.7])[:channels]
    return Image((values[..., None] * tint).astype(np.float32), ("R", "G", "B") if channels == 3 else ("Y",))


def joined(height: int = 128, width: int = 128) -> np.ndarray:
    """The left of the exemplar beside its right: one joint in the middle, at which it gets brighter."""
    match = np.stack(np.indices((height, width)), axis=2).astype(np.uint32)
    match[:, width // 2 :, 1] += SIDE - width
    return match


def copied(exemplar: Image, match: np.ndarray) -> Image:
    return exemplar.elsewhere(exemplar.pixels[match[..., 0], match[..., 1]].copy())


def evened(exemplar: Image, match: np.ndarray, wraps: Wraps = NOWHERE) -> Image:
    made = copied(exemplar, match)
    EvenJoints(exemplar).apply(made, match, wraps)
    return made


def seen(exemplar: Image, made: Image, match: np.ndarray, wraps: Wraps = NOWHERE) -> int:
    labs = (lab_from_linear(image.color) for image in (exemplar, made))
    known = next(labs)
    steps = ToneSteps(known.shape[:2], lambda first, last: known[first:last])
    return int((steps.at_joints(next(labs), match, wraps) > SEEN).sum())


@pytest.mark.parametrize("channels", [1, 3])
def test_a_step_becomes_a_slope_and_grain_stays(channels: int) -> None:
    exemplar, match = uneven(channels), joined()
    before, after = copied(exemplar, match), evened(exemplar, match)
    assert seen(exemplar, before, match) > 40
    assert seen(exemplar, after, match) < 3
    ratio = (after.pixels / before.pixels)[18:34]  # between the squares
    low, high = np.median(ratio[:, 63]), np.median(ratio[:, 64])
    assert low > 1.02
    assert high < 0.98
    assert abs(np.log(low * high)) < 0.02  # both pieces change alike
    beside = np.abs(np.diff(np.log(ratio[..., 0]), axis=1))
    beside[:, 54:74] = 0
    assert beside.max() < 0.004  # but for the step itself all changes slowly: the grain is the exemplar's
    assert abs(np.log(np.median(ratio[:, 4]))) < 0.5 * np.log(low)


def test_what_shows_no_step_does_not_change() -> None:
    exemplar = uneven()
    match = np.stack(np.indices((SIDE, SIDE)), axis=2).astype(np.uint32)[:, :140]
    np.testing.assert_array_equal(evened(exemplar, match).pixels, copied(exemplar, match).pixels)
    far = match.copy()
    far[80:, :, 0] -= 40  # the same light: a joint without a step
    np.testing.assert_allclose(evened(exemplar, far).pixels, copied(exemplar, far).pixels, atol=2e-3)


def test_contours_that_do_not_meet_do_not_bleed() -> None:
    exemplar = Image(np.full((SIDE, SIDE, 1), 0.4, np.float32), ("Y",))
    exemplar.pixels[:, SIDE // 2 :] = 0.04
    match = joined()
    match[:, 64:, 1] = SIDE - 1 - np.arange(64)[None, :].astype(np.uint32)
    np.testing.assert_array_equal(evened(exemplar, match).pixels, copied(exemplar, match).pixels)


def test_across_the_border_where_the_result_wraps() -> None:
    exemplar = uneven(light=(0.36, 0.41))
    match = np.stack(np.indices((128, 144)), axis=2).astype(np.uint32) + np.uint32([0, 8])
    wraps = Wraps(False, True)
    assert seen(exemplar, copied(exemplar, match), match, wraps) > 40
    assert seen(exemplar, evened(exemplar, match, wraps), match, wraps) < 3


def test_other_maps_and_masked_pixels() -> None:
    exemplar, match = uneven(), joined()
    height = np.linspace(0, 1, SIDE * SIDE, dtype=np.float32).reshape(SIDE, SIDE, 1)
    usable = np.ones_like(height)
    usable[:, 70:90] = 0
    pixels = np.concatenate([exemplar.pixels, height, usable], axis=2)
    pixels[:, 70:90, :3] = 100
    whole = Image(pixels, (*exemplar.channels, "height", USABLE))
    made = evened(whole, match)
    np.testing.assert_array_equal(made.pixels[..., 3:], copied(whole, match).pixels[..., 3:])
    np.testing.assert_allclose(made.pixels[..., :3], evened(exemplar, match).pixels, atol=0.01)
    assert made.pixels[..., :3].max() <= exemplar.pixels.max()


def test_large_results_in_parts_and_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exemplar, match = uneven(), joined(150, 150)
    whole = evened(exemplar, match).pixels
    with threads.sharing(2):
        np.testing.assert_array_equal(evened(exemplar, match).pixels, whole)
    monkeypatch.setattr("texloom.stages.synthesis.optimisation.even_joints.LARGEST_WHOLE", 100)
    monkeypatch.setattr("texloom.stages.common.grids.parts._SIDE", 100)
    parts = evened(exemplar, match).pixels
    np.testing.assert_allclose(parts, whole, atol=1e-3)
    with using(Scratch(tmp_path, 0)):
        np.testing.assert_array_equal(evened(exemplar, match).pixels, parts)
