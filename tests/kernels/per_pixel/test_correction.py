from collections.abc import Callable

import numpy as np
import pytest

from tests.kernels.per_pixel.naive import SIDES, PerPixel, Repeats
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.common.similarity.appearance import FAR
from texloom.stages.kernels.distortion.distorted_windows import describe_whole
from texloom.stages.kernels.per_pixel.arguments import Bonuses, Distortion, LevelState, PhaseMaps, Pieces, Subpass
from texloom.stages.kernels.per_pixel.correction import contribute, correct, refine, start
from texloom.stages.synthesis.per_pixel.per_pixel import prepare

SHAPE = (32, 40)
NO_REPETITION = PhaseMaps(np.zeros((1, 2), np.uint32), np.zeros((1, 2), np.uint32), (0, 0, 0, 0))


def tables(kind: str, rng: np.random.Generator) -> Tables:
    """An exemplar's tables: ``plain``, ``torus``, ``control`` (which is a torus) or ``bent`` (with control)."""
    image = picture(smooth_noise((*SHAPE, 3), 1.5, rng))
    control = picture(smooth_noise(SHAPE, 4.0, rng)) if kind in ("control", "bent") else None
    jacobian = None
    if kind == "bent":
        jacobian = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.15, (*SHAPE, 4))).astype(np.float32)
    params = AppearanceStackParams(toroidal=kind in ("torus", "control"), coarsest=8, k=3)
    stack = appearance_stack(image, params, jacobian=jacobian)
    return prepare(image, stack, control, jacobian, 1.0)[0]


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
    nearest_valid = np.arange(known.places, dtype=np.int32).reshape(SHAPE)
    nearest_valid[rng.random(SHAPE) < 0.5] = 7
    sums = np.full((*SHAPE, 16), 5, np.int16)
    shared = known.appearance[: known.places].reshape(*SHAPE, 8), known.sides[:32], 0, nearest_valid
    assert known.jacobian is not None
    describe_whole(*shared, known.jacobian.reshape(*SHAPE, 4), 1.0, 3, FAR, sums, 2, 6)
    assert (sums[:6] == 5).all()
    assert (sums[18:] == 5).all()
    assert (sums[..., 8:] == 5).all()
    twin = PerPixel(known, 0, 0)
    whole = nearest_valid == np.arange(nearest_valid.size).reshape(SHAPE)
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


def bend(known: Tables, kind: str, shape: tuple[int, int], rng: np.random.Generator) -> Distortion | None:
    if kind != "bent":
        return None
    assert known.jacobian is not None
    inverse = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.3, (*shape, 4))).astype(np.float32)
    sampled = rng.integers(0, known.levels, shape).astype(np.uint8)
    return Distortion(known.jacobian, inverse.reshape(-1, 4), sampled.ravel())


def frame(distortion: Distortion | None, pixel: int) -> tuple[int, np.ndarray] | None:
    return None if distortion is None else (int(distortion.sampled[pixel]), distortion.inverse[pixel])


@pytest.mark.parametrize("kind", ["plain", "torus", "control", "bent"])
@pytest.mark.parametrize("part", [Subpass(1, 1, 0, 0), Subpass(1, 1, 1, 1)])
def test_corrections_are_those_of_the_slow_twin(kind: str, part: Subpass, rng: np.random.Generator) -> None:
    known, shape, moved = tables(kind, rng), (12, 14), 0
    for number in range(known.levels):
        before, after = random_places(known, number, shape, rng), random_places(known, number, shape, rng)
        same = rng.random(shape) < 0.8
        after[same] = before[same]
        if kind == "plain" and number == 0:  # pixels that all continue
            rows, columns = np.indices(shape)
            before[:] = after[:] = known.places_of(rows + 8, columns + 8)
        after[2:11:2, 1:13:2] = random_places(known, number, (5, 6), rng)
        given = rng.integers(-500, 500, (*shape, known.values.shape[1] - 8)).astype(np.int16)
        distortion = bend(known, kind, shape, rng)
        opened, closed = stored(known)
        states = np.stack([rng.permuted(before), before, after])
        if kind == "bent":
            states = positions(known, states, rng)
        level = LevelState(number, 0, 0, states, given, np.empty((0, 0), states.dtype))
        expected = states[2].copy()
        twin = PerPixel(known, 20, 9000, 12)
        for y in range(2, 11, 2):
            for x in range(1, 13, 2):
                late = [part.diagonal, part.vertical, part.diagonal, part.horizontal]
                sources = [states[1 + which] for which in late + late[::-1]]
                around = [opened(source[y + r, x + c]) for source, (r, c) in zip(sources, SIDES, strict=True)]
                own, bent = opened(states[1, y, x]), frame(distortion, y * shape[1] + x) or (number, None)
                expected[y, x] = closed(twin.corrected(around, own, bent[0], given[y, x], bent[1]))
        old = states.copy()
        shared = part, known.exemplar, known.vectors, distortion, Bonuses(20, 12), 9000, (2, 11, 1, 13)
        changed = correct(level, *shared)
        np.testing.assert_array_equal(states[2], expected)
        np.testing.assert_array_equal(states[:2], old[:2])
        rows, columns = np.nonzero(states[2] != old[2])
        assert changed == (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1)
        moved += np.count_nonzero(states[2] != states[1])
    assert moved


@pytest.mark.parametrize("kind", ["torus", "bent"])
def test_pixels_that_read_the_same_stay(kind: str, rng: np.random.Generator) -> None:
    known, shape = tables(kind, rng), (12, 14)
    state = random_places(known, 0, shape, rng)
    if kind == "bent":
        state = positions(known, state, rng)
    states = np.stack([np.roll(state, 1, 0), state, np.roll(state, 1, 1)])
    given = np.zeros((*shape, known.values.shape[1] - 8), np.int16)
    level = LevelState(0, 0, 0, states, given, np.empty((0, 0), states.dtype))
    shared = known.exemplar, known.vectors, bend(known, kind, shape, rng), Bonuses(20, 12), 9000, (2, 11, 1, 13)
    correct(level, Subpass(1, 0, 0, 0), *shared)
    expected = states[2].copy()
    states[0] = state
    states[0, 3, 4] += 1
    correct(level, Subpass(1, 0, 0, 0), *shared)
    same = np.zeros(shape, bool)
    same[2:11:2, 1:13:2] = True
    same[2:5, 3:6] = False
    np.testing.assert_array_equal(states[2][same], state[same])
    np.testing.assert_array_equal(states[2][~same], expected[~same])
    assert (expected != state)[same].any()


@pytest.mark.parametrize("kind", ["torus", "bent"])
def test_children_are_those_of_the_slow_twin(kind: str, rng: np.random.Generator) -> None:
    known, shape = tables(kind, rng), (12, 11)
    for number in range(known.levels - 1):
        parents = random_places(known, number + 1, (9, 9), rng)
        opened, closed = stored(known)
        if kind == "bent":
            parents = positions(known, parents, rng)
        now = np.full((1, *shape), -1, parents.dtype)
        pinned = np.full(shape, -1, parents.dtype)
        pinned[3, 4] = 17
        given = np.zeros((0, 0, 0), np.int16)
        level = LevelState(number, -5, 2**20 - 3, now, given, pinned)
        coarse = LevelState(number + 1, -4, 2**19 - 3, parents[None], given, pinned)
        distortion, amplitude = bend(known, kind, shape, rng), 2**number * 40000
        changed = refine(level, coarse, known.exemplar, distortion, amplitude, np.uint64(99), (1, 11, 2, 10))
        assert changed == (1, 11, 2, 10)
        twin = PerPixel(known, 0, 0)
        for y, x in np.ndindex(shape):
            row, column = y + level.row, x + level.column
            parent = opened(parents[row // 2 - coarse.row, column // 2 - coarse.column])
            bent = frame(distortion, y * shape[1] + x)
            expected = closed(twin.child(parent, row, column, number, amplitude, 99, bent))
            inside = 1 <= y < 11 and 2 <= x < 10
            assert now[0, y, x] == (17 if (y, x) == (3, 4) else expected if inside else -1)


def coarsest(known: Tables, given: np.ndarray) -> LevelState:
    """To be filled."""
    dtype = np.int32 if known.jacobian is None else np.int64
    states = np.full((1, *given.shape[:2]), -1, dtype)
    return LevelState(known.levels - 1, -3, 5, states, given, np.empty((0, 0), dtype))


def test_the_start_is_pieces_whose_control_fits(rng: np.random.Generator) -> None:
    known = tables("control", rng)
    given = rng.integers(0, round(known.strengths[-1]), (9, 9, 8)).astype(np.int16)
    given[..., 1:] = 0
    base, twin = (known.levels - 1) * known.places, PerPixel(known, 0, 0)
    for tries, tolerance in ((1, 0), (40, 0), (40, 10**6)):
        level = coarsest(known, given)
        pieces = Pieces(known.core, known.endless, np.zeros(1, np.int32), 3, tries)
        start(level, known.exemplar, None, pieces, NO_REPETITION, tolerance, np.uint64(5), (0, 9, 0, 9))
        for y, x in np.ndindex(9, 9):
            found = []
            for attempt in range(tries):
                place = twin.place(twin.begun(y - 3, x + 5, 3, 5, attempt, None))
                far = ((known.values[base + place, 8:].astype(int) - given[y, x]) ** 2).sum()
                found.append((far, place))
                if far <= tolerance:
                    break
            else:
                far, place = min(found, key=lambda pair: pair[0])
            assert level.states[0, y, x] == place


@pytest.mark.parametrize("kind", ["plain", "torus", "bent"])
def test_pieces_that_repeat_are_laid_in_step(kind: str, rng: np.random.Generator) -> None:
    known = tables(kind, rng)
    distortion = bend(known, kind, (9, 9), rng)
    starts = rng.choice(known.places, 20).astype(np.int32)
    given = np.zeros((9, 9, known.values.shape[1] - 8), np.int16)
    pieces = Pieces(known.core, known.endless, starts, 3, 1)
    twin, (_, closed) = PerPixel(known, 0, 0), stored(known)
    moved = []
    for repeating in (False, True):
        level, repetition, repeats = coarsest(known, given), NO_REPETITION, None
        if repeating:
            wanted, places = (rng.integers(0, 2**32, (count, 2), np.uint32) for count in (81, known.places))
            repetition = PhaseMaps(wanted, places, (1500, -200, 90, -2100))
            repeats = Repeats(places, wanted.reshape(9, 9, 2), (-3, 5), np.array(repetition.generators))
        start(level, known.exemplar, distortion, pieces, repetition, 0, np.uint64(5), (0, 9, 0, 9))
        for y, x in np.ndindex(9, 9):
            bent, begins = frame(distortion, 9 * y + x), None if distortion is None else starts
            assert level.states[0, y, x] == closed(twin.begun(y - 3, x + 5, 3, 5, 0, repeats, bent, begins))
        moved.append(level.states[0].copy())
    assert (moved[0] != moved[1]).mean() > 0.5
