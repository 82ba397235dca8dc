from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from texloom.stages.common.grids.pyramid import resize, scale_sizes, scaled


@given(st.integers(8, 5000), st.integers(8, 5000), st.integers(8, 200), st.floats(1.05, 4))
def test_scales_rise_evenly_to_full_size(height: int, width: int, coarsest: int, ratio: float) -> None:
    factors = scale_sizes(height, width, coarsest, ratio)
    shorter = min(height, width)
    assert factors[-1] == 1
    steps = np.divide(factors[1:], factors[:-1])
    if shorter <= coarsest:
        assert factors == [1]
    elif len(factors) == 1:
        assert shorter / coarsest < ratio * (1 + 1e-9)
    else:
        assert factors[0] * shorter == pytest.approx(coarsest)
        np.testing.assert_allclose(steps, steps[0])
        assert ratio * (1 - 1e-9) <= steps[0] < ratio**2


def test_known_scales() -> None:
    assert scale_sizes(256, 512, 32, 2.0) == pytest.approx([1 / 8, 1 / 4, 1 / 2, 1])
    assert scale_sizes(35, 35, 35, 1.3) == [1.0]
    assert len(scale_sizes(512, 512, 35, 1.3)) == 11  # log(512 / 35) / log(1.3) = 10.2


def test_scaled_sizes_are_whole_and_never_nothing() -> None:
    assert scaled(100, 0.354) == 35
    assert scaled(100, 1.0) == 100
    assert scaled(3, 0.01) == 1


@pytest.mark.parametrize("shape", [(10, 9), (33, 47), (64, 80), (100, 100)])
def test_resizing_keeps_constants_and_channels_apart(shape: tuple[int, int]) -> None:
    planes = np.ones((64, 80, 3), np.float32) * np.float32([50, -20, 3])
    small = resize(planes, *shape)
    assert small.shape == (*shape, 3)
    np.testing.assert_allclose(small, np.broadcast_to(np.float32([50, -20, 3]), small.shape), rtol=1e-5)


def test_resizing_to_the_same_size_changes_nothing(rng: np.random.Generator) -> None:
    planes = rng.random((20, 30, 4), np.float32)
    np.testing.assert_array_equal(resize(planes, 20, 30), planes)


def test_resizing_does_not_alias() -> None:
    """A chessboard of single pixels turns grey, whatever the phase."""
    board = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)[..., None]
    for size in (16, 23, 31):
        inner = resize(board, size, size)[3:-3, 3:-3]
        np.testing.assert_allclose(inner, 0.5, atol=0.02)


def test_resizing_keeps_places() -> None:
    """Pixel centres: a ramp stays a ramp of the same values at the same share of the width."""
    ramp = np.tile((np.arange(64, dtype=np.float32) + 0.5) / 64, (8, 1))[..., None]
    for size in (32, 24, 128):
        small = resize(ramp, 8, size)[4, :, 0]
        inside = slice(size // 8, -size // 8)
        np.testing.assert_allclose(small[inside], ((np.arange(size) + 0.5) / size)[inside], atol=2e-3)
