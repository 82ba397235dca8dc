import numpy as np
import pytest

from tests.kernels.core.naive import bilinear
from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.distorted_windows import (
    MARGIN,
    describe_neighbourhoods,
    describe_windows,
    follow,
    gather_windows,
    interpolate,
    whole_windows,
)

SHAPE = (13, 15)


def bent(rng: np.random.Generator) -> np.ndarray:
    return (np.array([1, 0.2, -0.1, 0.9]) + 0.15 * rng.random((*SHAPE, 4))).astype(np.float32)


@pytest.mark.parametrize("even", [False, True])
def test_windows_along_the_distortion(even: bool, rng: np.random.Generator) -> None:
    """Where it is even, windows are read side by side."""
    planes, jacobian = rng.random((*SHAPE, 2), np.float32), bent(rng)
    if even:
        jacobian[:] = jacobian[0, 0]
    known = rng.random(SHAPE) < 0.97
    sharp = known & (rng.random(SHAPE) < 0.98)
    mean = rng.random(50).astype(np.float32)
    basis = np.linalg.qr(rng.normal(size=(50, 8)))[0].astype(np.float32)
    doubt = rng.uniform(0.05, 0.5, 8)
    out, seen = np.full((*SHAPE, 8), 9, np.int16), np.zeros(SHAPE, bool)
    around = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    padded = (
        np.pad(np.moveaxis(planes, 2, 0), ((0, 0), *around), "edge"),
        np.pad(known, around),
        np.pad(sharp, around),
    )
    for span in ((0, 1), (1, 2)):
        describe_windows(
            padded[0], jacobian, *padded[1:], known, 1.0, mean, basis, doubt, 500.0, 700.0, out, seen, *span
        )  # fmt: skip
    assert (out[~known] == 9).all()
    partial = shortened = 0
    for place in map(tuple, np.argwhere(known)):
        values, found = naive.window(planes, jacobian, known, place, 1.0)
        partial += not found.all()
        wanted = 500 * naive.described(values, found, mean, basis, doubt)
        shortened += np.hypot.reduce(wanted) > 700
        wanted *= min(1, 700 / np.hypot.reduce(wanted))
        np.testing.assert_allclose(out[place], wanted, atol=1.2, err_msg=str(place))
        assert seen[place] == naive.window(planes, jacobian, sharp, place, 1.0)[1].all()
    assert 20 < partial < known.sum() - 5
    assert shortened


def test_windows_that_are_whole_and_laid_out(rng: np.random.Generator) -> None:
    planes, jacobian = rng.random((*SHAPE, 2), np.float32), bent(rng)
    usable = rng.random(SHAPE) < 0.97
    out = np.zeros((7, 8), bool)
    whole_windows(usable, jacobian, 1.0, 2, 2, out, 0, 7)
    for i, j in np.ndindex(7, 8):
        ways = [(down, across) for down in range(-2, 3) for across in range(-2, 3)]
        ends = [naive.landed(jacobian, (2 * i, 2 * j), *way, 1.0) for way in ways]
        assert out[i, j] == all(naive.stands_on(usable, end) for end in ends)
    laid = np.empty((1, 50), np.float32)
    gather_windows(planes, jacobian, np.array([6 * 15 + 7]), 1.0, laid)
    wanted = [bilinear(planes, *naive.landed(jacobian, (6, 7), *way, 1.0)) for way in ways]
    np.testing.assert_allclose(laid[0], np.ravel(wanted), atol=1e-5)


def test_neighbourhoods_along_the_distortion(rng: np.random.Generator) -> None:
    appearance = rng.integers(-500, 500, (*SHAPE, 8)).astype(np.int16)
    basis = rng.integers(-400, 400, (64, 8)).astype(np.int16)
    jacobian, known, seen = bent(rng), rng.random(SHAPE) < 0.9, rng.random(SHAPE) < 0.95
    out, whole = np.zeros((7, 8, 8), np.int16), np.zeros((7, 8), bool)
    for span in ((0, 4), (4, 7)):
        describe_neighbourhoods(appearance, seen, jacobian, known, 2.0, basis, 2, out, whole, *span)
    sides = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]
    for i, j in np.argwhere(known[::2, ::2]):
        place = 2 * i, 2 * j
        total, complete = np.zeros(8, np.int64), seen[place]
        for side, way in enumerate(sides):
            end = naive.landed(jacobian, place, *way, 2.0)
            near = np.clip(np.floor(end + 0.5).astype(int), 0, [12, 14])
            part = appearance[tuple(near)].astype(np.int64) @ basis[8 * side : 8 * side + 8]
            total += np.rint(part / 2048).astype(np.int64)
            complete = complete and naive.stands_on(seen, end)
        np.testing.assert_array_equal(out[i, j], total)
        assert whole[i, j] == complete


def test_values_between_those_of_a_grid() -> None:
    fine = np.indices(SHAPE).transpose(1, 2, 0) * np.float32(3)
    out = np.empty((*SHAPE, 2), np.float32)
    for span in ((0, 4), (4, 13)):
        interpolate(fine[::3, ::3], 3, out, *span)
    np.testing.assert_allclose(out, np.minimum(fine, 36), atol=1e-5)


def test_blocks_follow_their_first_pixel() -> None:
    """Into a part of the picture where texture is twice as large."""
    jacobian = np.tile(np.array([1, 0, 0, 1], np.float32), (20, 20, 1))
    jacobian[:, 10:] *= 2
    whole = np.ones((20, 20), bool)
    whole[:, 19] = False
    found = np.full((5, 5), -1)
    found[0, 0] = 6 * 20 + 12
    out = np.empty((20, 20), np.int32)
    follow(found, 4, whole, jacobian, out, 0, 20)
    for y, x in np.ndindex(4, 4):
        assert out[y, x] == (6 + 2 * y) * 20 + 12 + 2 * x
    assert (out[4:] == -1).all()
    whole[6:, 14] = False
    follow(found, 4, whole, jacobian, out, 0, 20)
    assert out[2, 1] == found[0, 0]
