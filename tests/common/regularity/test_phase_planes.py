from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.common.regularity.phase_planes import PhasePlanes, phase_planes
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

GENERATORS = np.array([[12, 0], [0, 8]], np.float32)
SIZE = (96, 80)


def joints(shape: tuple[int, int], row: int = 0, column: int = 0, cell: tuple[int, int] = (12, 8)) -> np.ndarray:
    """A map that is 0 along the joints of a grid, (h, w, 1)."""
    down, across = np.indices(shape)
    inside = ((down - row) % cell[0] > 1) & ((across - column) % cell[1] > 1)
    return inside[..., None].astype(np.float32)


def planes(
    own: np.ndarray, wanted: np.ndarray, source: np.ndarray | None = None, wrap: Wraps = NOWHERE
) -> PhasePlanes:
    found = phase_planes(GENERATORS, source, own, wanted, wrap)
    assert found is not None
    return found


def test_phases_are_those_that_control_shows():
    own = joints(SIZE)
    found = planes(own, joints((60, 70), 3, 5))
    # pixel (3, 5) of the result is at a crossing of joints, as pixel (0, 0) of the exemplar
    assert found.wanted[3, 5] == pytest.approx(found.own[0, 0], abs=1e-5)
    assert found.wanted[20, 30] == pytest.approx(found.own[17, 25], abs=1e-5)
    assert found.own.var(axis=(0, 1)).sum() == pytest.approx(own.var(), rel=1e-3)
    assert np.abs(found.own[12:] - found.own[:-12]).max() < 1e-5
    assert np.abs(found.own[6:] - found.own[:-6]).max() > 0.3


def test_phases_of_a_compaction_are_those_of_where_its_pixels_come_from(rng):
    down, across = rng.integers(0, 500, (2, 40, 40))
    source = np.stack([down, across], axis=2).astype(np.uint32)
    own = ((down % 12 > 1) & (across % 8 > 1))[..., None].astype(np.float32)
    found = planes(own, joints(SIZE), source)
    for row, column in ((0, 0), (5, 5), (17, 30)):
        place = source[row, column] % (12, 8)
        assert found.own[row, column] == pytest.approx(found.wanted[tuple(place)], abs=1e-4)
    assert (found.places == source).all()


def test_control_with_another_repetition_decides():
    assert phase_planes(GENERATORS, None, joints(SIZE), joints(SIZE, cell=(17, 11)), NOWHERE) is None


def test_control_that_knows_nothing_of_the_repetition_is_no_hindrance(rng):
    own, wanted = (smooth_noise((192, 160), 6, rng)[..., None].astype(np.float32) for _ in range(2))
    assert phase_planes(GENERATORS, None, own, wanted, NOWHERE) is not None


def test_an_exemplar_of_hardly_a_cell_has_no_phases(rng):
    own = smooth_noise((12, 15), 3, rng)[..., None].astype(np.float32)
    assert phase_planes(GENERATORS, None, own, own, NOWHERE) is None


def test_phases_continue_around_a_torus(rng):
    own = smooth_noise((192, 160), 6, rng)[..., None].astype(np.float32)
    wanted = planes(own, np.zeros((100, 60, 1), np.float32), wrap=TORUS).wanted
    steps = [np.abs(np.roll(wanted, 1, axis) - wanted).max(axis=(1 - axis, 2)) for axis in (0, 1)]
    for step in steps:
        assert step[0] < 1.1 * step[1:].max()
