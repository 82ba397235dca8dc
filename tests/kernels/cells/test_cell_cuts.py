from typing import Any

import numpy as np
import pytest

from tests.kernels.cells import naive
from texloom.stages.kernels.cells.cell_cuts import cut_cells
from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, cut_window, window_cost
from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT

UNIT, MOST, OFFSET = 64.0, 4096.0, 8.0


def kernel_costs(lab: np.ndarray, slopes: np.ndarray) -> tuple[Any, ...]:
    return lab, slopes, np.float32(OFFSET), np.float32(UNIT), np.float32(MOST), True


@pytest.mark.parametrize("exemplars", [1, 2])
def test_cuts_cost_least(exemplars: int, rng: np.random.Generator) -> None:
    lab = rng.integers(0, 40, (20, 24, 3)).astype(np.float32)  # sums are exact
    slopes = rng.integers(0, 9, (2, 20, 24)).astype(np.float32)
    number = 1 + np.arange(24) * exemplars // 24
    inside = np.where(rng.random((20, 24)) < 0.4, number, -number).astype(np.int16)
    count, height, width = 8, 4, 4
    rows = np.arange(count + 1) * height
    old = np.zeros((count * height, width, 2), np.int32)
    state = rng.choice([KEPT, FREE, FREE, FILLED], (count * height, width)).astype(np.int8)
    for index in range(count):
        free = np.argwhere(state[rows[index] : rows[index + 1]] == FREE)
        for place in free[5:]:
            state[rows[index] + place[0], place[1]] = KEPT
    places = np.moveaxis(np.indices((height, width)), 0, 2)
    shifts = np.array([[*rng.integers(0, 12, 2), width] for _ in range(count)])
    for index in range(count):
        parts = rng.integers(0, 14, (2, 2))
        old[rows[index] : rows[index + 1]] = places + parts[rng.integers(0, 2, (height, width))]
    taken, costs = np.zeros(state.shape, bool), np.zeros((count, 2), np.int64)
    for span in ((0, 3), (3, count)):
        cut_cells(kernel_costs(lab, slopes), inside, old, rows, shifts, state, *span, taken, costs)
    given = lab, slopes, inside, OFFSET, UNIT, MOST
    exact = 0
    for index in range(count):
        own = np.s_[rows[index] : rows[index + 1]]
        new = places + shifts[index, :2]
        assert taken[own][state[own] == FILLED].all()
        assert not taken[own][state[own] == KEPT].any()
        assert costs[index, 0] == naive.seams(*given, old[own], state[own])
        after = naive.seams(*given, np.where(taken[own][..., None], new, old[own]), state[own])
        assert costs[index, 1] == after
        least = naive.least_seams(given, old[own], new, state[own])
        exact += after == least
        assert after <= 1.25 * least  # old seams may cost more than both new ones, and count as no more
    assert exact >= count // 2


def test_a_window_may_have_any_sources_and_pixels_without_one(rng: np.random.Generator) -> None:
    """Nothing beside those counts."""
    lab = rng.integers(0, 40, (20, 24, 5)).astype(np.float32)
    slopes = rng.integers(0, 9, (2, 20, 24)).astype(np.float32)
    given = lab, slopes, np.zeros((20, 24), np.int16), OFFSET, UNIT, MOST
    exact = 0
    for _ in range(8):
        places = np.moveaxis(np.indices((4, 5)), 0, 2)
        old = np.ascontiguousarray(places + rng.integers(0, 14, (2, 2))[rng.integers(0, 2, (4, 5))], np.int32)
        new = np.ascontiguousarray(np.rint(places * 1.3) + rng.integers(0, 12, 2), np.int32)
        state = rng.choice([KEPT, FILLED, ABSENT, ABSENT], (4, 5)).astype(np.int8)
        state.ravel()[rng.permutation(20)[:5]] = FREE
        taken, window = np.zeros((4, 5), bool), (kernel_costs(lab, slopes), NO_CELLS, NO_PRICE, old, new, state)
        cut_window(*window, taken)
        assert taken[state == FILLED].all()
        assert not taken[state == KEPT].any()
        after = naive.seams(*given, np.where(taken[..., None], new, old), state)
        assert window_cost(*window, taken) == after
        least = naive.least_seams(given, old, new, state)
        exact += after == least
        assert after <= 1.25 * least
    assert exact >= 4
