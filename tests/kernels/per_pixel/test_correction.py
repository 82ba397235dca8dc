from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.kernels.per_pixel.naive import SIDES, PerPixel, Repeats
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.appearance import FAR
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.kernels.distortion.windows import describe_whole
from texloom.stages.kernels.per_pixel.correction import contribute, correct, refine, start
from texloom.stages.synthesis._arrangement import prepared

SHAPE = (32, 40)
NOTHING_REPEATS = np.zeros((0, 0, 2), np.uint32), np.zeros((0, 2), np.uint32), np.zeros(4, np.int64)


def tables(kind: str, rng: np.random.Generator) -> Tables:
    """An exemplar's tables: ``plain``, ``torus``, ``control`` (which is a torus) or ``bent`` (with control)."""
    image = picture(smooth_noise((*SHAPE, 3), 1.5, rng))
    control = picture(smooth_noise(SHAPE, 4.0, rng)) if kind in ("control", "bent") else None
    jacobian = None
    if kind == "bent":
        jacobian = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.15, (*SHAPE, 4))).astype(np.float32)
    params = AppearanceStackParams(toroidal=kind in ("torus", "control"), coarsest=8, k=3)
    stack = appearance_stack(image, params, jacobian=jacobian)
    return prepared(image, stack, control, jacobian, 1.0)[0]


def random_places(given: Tables, level: int, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Whole places, mostly continuing each other."""
    rows, columns = np.indices(size) * 2**level + rng.integers(0, 8, (2, *size)) // 7
    pixels = given.places_of(rows % SHAPE[0], columns % SHAPE[1])
    return np.ascontiguousarray(given.candidates[level * given.places + pixels, 0])


def positions(known: Tables, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Positions near places."""
    rows, columns = np.divmod(places.astype(np.int64), known.pitch)
    away = rng.integers(-127, 128, (2, *places.shape))
    return rows * 256 + away[0] << 32 | columns * 256 + away[1]


def stored(known: Tables) -> tuple[Callable[..., tuple[int, int]], Callable[..., int]]:
    """From what is stored to a row and a column in 1/256 px, and back."""
    if known.jacobian is None:
        twin = PerPixel(known, 0, 0)
        return lambda value: twin.position(int(value)), twin.place
    return lambda value: (int(value) >> 32, int(value) % 2**32), lambda at: at[0] << 32 | at[1]


@pytest.mark.parametrize("kind", ["plain", "torus", "control", "bent"])
def test_sums_describe_the_exemplar(kind: str, rng: np.random.Generator) -> None:
    known = tables(kind, rng)
    twin = PerPixel(known, 0, 0)
    rows, columns = (rng.integers(0, side, 30) for side in SHAPE)
    for level in range(known.levels):
        for row, column, place in zip(rows, columns, known.places_of(rows, columns), strict=True):
            at = level * known.places + place
            own = known.candidates[at, 0] == place
            expected = twin.sum_at(row, column, level) if own else [FAR, *(0,) * 7]
            np.testing.assert_array_equal(known.values[at, :8], expected)
        assert (known.values[level * known.places : (level + 1) * known.places, 0] != FAR).any()


def test_one_pixel_is_described_for_a_block(rng: np.random.Generator) -> None:
    known = tables("bent", rng)
    home = np.arange(known.places, dtype=np.int32).reshape(SHAPE)
    home[rng.random(SHAPE) < 0.5] = 7
    sums = np.full((*SHAPE, 16), 5, np.int16)
    shared = known.appearance[: known.places].reshape(*SHAPE, 8), known.sides[:32], 0, home
    assert known.jacobian is not None
    describe_whole(*shared, known.jacobian.reshape(*SHAPE, 4), 1.0, 3, FAR, sums, 2, 6)
    assert (sums[:6] == 5).all()
    assert (sums[18:] == 5).all()
    assert (sums[..., 8:] == 5).all()
    twin = PerPixel(known, 0, 0)
    whole = home == np.arange(home.size).reshape(SHAPE)
    assert (sums[6:18, :, 0] == FAR)[~whole[6:18]].all()
    for top, left in np.ndindex(4, 13):
        block = np.s_[6 + 3 * top : 9 + 3 * top, 3 * left : 3 * left + 3]
        for row, column in np.argwhere(whole[block])[:1]:
            expected = twin.sum_at(6 + 3 * top + row, 3 * left + column, 0)
            assert (sums[block][whole[block]][:, :8] == expected).all()


def test_contributions_are_those_of_the_slow_twin(rng: np.random.Generator) -> None:
    known = tables("plain", rng)
    out, twin = np.zeros_like(known.appearance), PerPixel(known, 0, 0)
    contribute(known.appearance, known.sides, 32 + 5 * 4, out, 3, 40)
    expected = [twin.contribution(5, row, 1) for row in range(3, 40)]
    np.testing.assert_array_equal(out[3:40], expected)
    assert not out[:3].any()
    assert not out[40:].any()


@pytest.mark.parametrize("kind", ["plain", "torus", "control", "bent"])
def test_corrections_are_those_of_the_slow_twin(kind: str, rng: np.random.Generator) -> None:
    known = tables(kind, rng)
    for level in range(known.levels):
        states = [random_places(known, level, (12, 14), rng) for _ in range(5)]
        before, vertical, horizontal, diagonal, after = states
        for state in (vertical, horizontal, diagonal):
            same = rng.random(state.shape) < 0.8
            state[same] = before[same]
        if kind == "plain":  # some pixels that all continue
            for state in states[:4]:
                rows, columns = np.indices(state.shape) * 2**level
                if level == 0:
                    state[:] = known.places_of(rows + 8, columns + 8)
        given = rng.integers(-500, 500, (12, 14, known.values.shape[1] - 8)).astype(np.int16)
        inverse = sampled = None
        if kind == "bent":
            inverse = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.3, (12, 14, 4))).astype(np.float32)
            sampled = rng.integers(0, known.levels, (12, 14)).astype(np.uint8)
        opened, closed = stored(known)
        if kind == "bent":
            states = [positions(known, state, rng) for state in states]
            before, vertical, horizontal, diagonal, after = states
        expected = after.copy()
        twin = PerPixel(known, 20, 9000, 12)
        for y in range(2, 11, 2):
            for x in range(1, 13, 2):
                sources = [diagonal, vertical, diagonal, horizontal, horizontal, diagonal, vertical, diagonal]
                around = [opened(source[y + r, x + c]) for source, (r, c) in zip(sources, SIDES, strict=True)]
                own, frame = opened(before[y, x]), (level, None)
                if inverse is not None:
                    frame = (int(sampled[y, x]), inverse[y, x])
                expected[y, x] = closed(twin.corrected(around, own, frame[0], given[y, x], frame[1]))
        old, nobody = after.copy(), np.empty((0, 0), after.dtype)
        changed = correct(
            known.run, before, vertical, horizontal, diagonal, after, *(before,) * 4, False, given, nobody, inverse,
            sampled, known.jacobian, known.appearance, known.sides, known.values, known.candidates,
            level * known.places, known.places, known.pitch, 2**level, 20, 12, 9000, 2, 11, 1, 13,
        )  # fmt: skip
        np.testing.assert_array_equal(after, expected)
        assert (after != before).any()
        rows, columns = np.nonzero(after != old)
        assert changed == (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1)
        # what has been computed from the same pixels in the pass before this one is not computed again
        last = [part.copy() for part in (before, vertical, horizontal, diagonal)]
        last[3][3, 4] += 1
        correct(
            known.run, before, vertical, horizontal, diagonal, after, *last, True, given, nobody, inverse, sampled,
            known.jacobian, known.appearance, known.sides, known.values, known.candidates,
            level * known.places, known.places, known.pitch, 2**level, 20, 12, 9000, 2, 11, 1, 13,
        )  # fmt: skip
        kept = np.ones(after.shape, bool)
        kept[2:5, 3:6] = False
        turn = np.zeros(after.shape, bool)
        turn[2:11:2, 1:13:2] = True
        np.testing.assert_array_equal(after[turn & kept], before[turn & kept])
        np.testing.assert_array_equal(after[~kept], expected[~kept])


@pytest.mark.parametrize("kind", ["torus", "bent"])
def test_children_are_those_of_the_slow_twin(kind: str, rng: np.random.Generator) -> None:
    known = tables(kind, rng)
    for level in range(known.levels - 1):
        coarse = random_places(known, level + 1, (9, 9), rng)
        opened, closed = stored(known)
        if kind == "bent":
            coarse = positions(known, coarse, rng)
        now = np.full((12, 11), -1, coarse.dtype)
        origin, coarse_origin = (-5, 2**20 - 3), (-4, 2**19 - 3)
        inverse = sampled = None
        if kind == "bent":
            inverse = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.3, (12, 11, 4))).astype(np.float32)
            sampled = rng.integers(0, known.levels, (12, 11)).astype(np.uint8)
        pinned = np.full(now.shape, -1, coarse.dtype)
        pinned[3, 4] = 17
        amplitude = 2**level * 40000
        changed = refine(
            coarse, *coarse_origin, now, *origin, pinned, inverse, sampled, known.jacobian, known.candidates,
            level * known.places, known.places, known.pitch, 2**level, amplitude, np.uint64(99), 1, 11, 2, 10,
        )  # fmt: skip
        assert changed == (1, 11, 2, 10)
        twin = PerPixel(known, 0, 0)
        for y, x in np.ndindex(now.shape):
            row, column = y + origin[0], x + origin[1]
            parent = coarse[row // 2 - coarse_origin[0], column // 2 - coarse_origin[1]]
            frame = None if inverse is None else (int(sampled[y, x]), inverse[y, x])
            expected = closed(twin.child(opened(parent), row, column, level, amplitude, 99, frame))
            inside = 1 <= y < 11 and 2 <= x < 10
            assert now[y, x] == (17 if (y, x) == (3, 4) else expected if inside else -1)


def test_the_start_is_pieces_whose_control_fits(rng: np.random.Generator) -> None:
    known = tables("control", rng)
    level, step = known.levels - 1, 2 ** (known.levels - 1)
    given = rng.integers(0, round(known.strengths[-1]), (9, 9, 8)).astype(np.int16)
    given[..., 1:] = 0
    base, nobody, twin = level * known.places, np.empty((0, 0), np.int32), PerPixel(known, 0, 0)
    for tries, tolerance in ((1, 0), (40, 0), (40, 10**6)):
        now = np.zeros((9, 9), np.int32)
        start(
            now, -3, 5, given, nobody, None, None, None, known.values, known.candidates, base, known.places,
            known.pitch, *known.core, known.endless, nobody.ravel(), step, 3, tries, tolerance, np.uint64(5),
            *NOTHING_REPEATS, 0, 9, 0, 9,
        )  # fmt: skip
        for y, x in np.ndindex(now.shape):
            found = []
            for attempt in range(tries):
                place = twin.place(twin.begun(y - 3, x + 5, 3, 5, attempt, None))
                far = ((known.values[base + place, 8:].astype(int) - given[y, x]) ** 2).sum()
                found.append((far, place))
                if far <= tolerance:
                    break
            else:
                far, place = min(found, key=lambda pair: pair[0])
            assert now[y, x] == place


@pytest.mark.parametrize("kind", ["plain", "torus", "bent"])
def test_pieces_that_repeat_are_laid_in_step(kind: str, rng: np.random.Generator) -> None:
    known = tables(kind, rng)
    level, origin, inverse, sampled, begins = known.levels - 1, (-3, 5), None, None, None
    if kind == "bent":
        inverse = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.3, (9, 9, 4))).astype(np.float32)
        sampled = rng.integers(0, known.levels, (9, 9)).astype(np.uint8)
        begins = rng.choice(known.places, 20).astype(np.int32)
    now = np.full((9, 9), -1, np.int64 if kind == "bent" else np.int32)
    given = np.zeros((9, 9, known.values.shape[1] - 8), np.int16)
    twin, (_, closed) = PerPixel(known, 0, 0), stored(known)
    moved = []
    for repeating in (False, True):
        phases = NOTHING_REPEATS
        if repeating:
            wanted, places = (rng.integers(0, 2**32, (*size, 2), np.uint32) for size in ((9, 9), (known.places,)))
            phases = wanted, places, np.array([1500, -200, 90, -2100])
        repeats = Repeats(phases[1], phases[0], origin, phases[2]) if repeating else None
        start(
            now, *origin, given, np.empty((0, 0), now.dtype), inverse, sampled, known.jacobian, known.values,
            known.candidates, level * known.places, known.places, known.pitch, *known.core, known.endless,
            np.empty(0, np.int32) if begins is None else begins, 2**level, 3, 1, 0, np.uint64(5), *phases,
            0, 9, 0, 9,
        )  # fmt: skip
        for y, x in np.ndindex(now.shape):
            frame = None if inverse is None or sampled is None else (int(sampled[y, x]), inverse[y, x])
            at = twin.begun(y + origin[0], x + origin[1], 3, 5, 0, repeats, frame, begins)
            assert now[y, x] == closed(at)
        moved.append(now.copy())
    assert (moved[0] != moved[1]).mean() > 0.5
