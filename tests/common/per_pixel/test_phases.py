"""Phases of places in a texture that repeats."""

import numpy as np
import pytest

from texloom.stages.common.per_pixel.phases import NO_PHASES, phases_of

GENERATORS = np.array([[10.25, -3.5], [4.125, 12.75]], np.float32)  # whole numbers of 1/256 px


def signed(phases: np.ndarray) -> np.ndarray:
    """-0.5 to 0.5 of a repetition."""
    return np.asarray(phases.astype(np.int64).astype(np.int32) / 2**32)


def test_without_generators_nothing_repeats() -> None:
    assert phases_of(np.zeros((0, 2), np.float32), (5, 6), 2) is NO_PHASES


def test_flat_places_have_the_phases_of_the_result() -> None:
    found = phases_of(GENERATORS, (20, 30), 4)
    np.testing.assert_array_equal(found.generators, [2624, -896, 1056, 3264])
    own = found.places.reshape(28, 38, 2)
    result = found.of_result(np.arange(-4, 24), np.arange(-4, 34), None)
    np.testing.assert_array_equal(own, result)
    expected = np.moveaxis(np.indices((28, 38)) - 4, 0, 2) @ np.linalg.inv(GENERATORS.astype(float))
    np.testing.assert_allclose(signed(own - (expected % 1 * 2**32).astype(np.uint32)), 0, atol=1e-6)


def test_distant_windows_fit_together() -> None:
    found = phases_of(GENERATORS, (8, 8), 0)
    near, far = (found.of_result(np.arange(4) + at, np.arange(4), None) for at in (0, 2**30))
    # the same distances have the same differences of phase, exactly
    np.testing.assert_array_equal(near[1:] - near[:-1], far[1:] - far[:-1])


def test_charts_say_where_distorted_places_are() -> None:
    chart = np.random.default_rng(1).random((6, 7, 2), np.float32) * 100
    found = phases_of(GENERATORS, (6, 7), 0, chart).places.reshape(6, 7, 2)
    expected = chart.astype(float) @ np.linalg.inv(GENERATORS.astype(float))
    np.testing.assert_allclose(signed(found - (expected % 1 * 2**32).astype(np.uint32)), 0, atol=1e-6)


@pytest.mark.parametrize("sides", [(96, 128), (100, 104), (16, 16)])
def test_a_torus_holds_whole_repetitions(sides: tuple[int, int]) -> None:
    found = phases_of(GENERATORS, (8, 8), 0)
    line = np.arange(max(sides) + 1)
    phases = found.of_result(line[: sides[0] + 1], line[: sides[1] + 1], sides)
    np.testing.assert_allclose(signed(phases[-1] - phases[0]), 0, atol=1e-6)
    np.testing.assert_allclose(signed(phases[:, -1] - phases[:, 0]), 0, atol=1e-6)
    # about as far apart as they were
    steps = signed(phases[1, 0] - phases[0, 0]), signed(phases[0, 1] - phases[0, 0])
    np.testing.assert_allclose(np.linalg.inv(np.array(steps)), GENERATORS, atol=6.5)


def test_a_torus_that_is_smaller_than_a_repetition_keeps_them() -> None:
    found = phases_of(GENERATORS, (8, 8), 0)
    one, other = (found.of_result(np.arange(4), np.arange(4), torus) for torus in (None, (4, 4)))
    np.testing.assert_array_equal(one, other)
