"""Sources of pixels that show another texture than their control asks for."""

import numpy as np

from texloom.stages.synthesis.reconstruction.reseed import reseeded

OWN = np.zeros((64, 96, 1), np.float32)
OWN[:, 40:46] = 80
"""control of an exemplar: a line from top to bottom"""

RIVER = np.where(OWN > 0, [30, 0, -40], [60, -20, 40]).astype(np.float32)
"""a texture that it explains"""


def line() -> np.ndarray:
    """Control of a result: a slanting line, 3 px wide."""
    rows, columns = np.indices((64, 64))
    return np.where(np.abs(columns - 20 - rows // 3) < 2, np.float32(80), np.float32(0))[..., None]


def again(texture: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Control at the new sources, of a result that came without the line."""
    source = np.zeros((*wanted.shape[:2], 2), np.int32)
    new = reseeded(source, texture, OWN, wanted, np.random.default_rng(3))
    assert not source.any()
    return np.asarray(OWN[new[..., 0], new[..., 1], 0])


def test_a_line_that_was_lost_returns_whole() -> None:
    """All of it, and nothing beside it."""
    wanted = line()
    assert (again(RIVER, wanted) == wanted[..., 0]).all()


def test_a_line_of_a_noisy_texture_returns(rng: np.random.Generator) -> None:
    """Its share of the texture is small, and so is what it explains of the whole."""
    noise = rng.normal(0, 12, RIVER.shape).astype(np.float32)
    wanted = line()
    assert (again(RIVER + noise, wanted) == wanted[..., 0]).all()


def test_single_pixels_stay() -> None:
    """Noise of control is no line."""
    wanted = np.zeros((64, 64, 1), np.float32)
    wanted[2::5, 2::5] = 80
    assert not again(RIVER, wanted).any()


def test_control_that_explains_nothing_changes_nothing(rng: np.random.Generator) -> None:
    """Its deviations do not matter."""
    assert not again(rng.normal(0, 12, RIVER.shape).astype(np.float32), line()).any()


def test_constant_control_and_none() -> None:
    """There is nothing to replace."""
    source = np.zeros((16, 16, 2), np.int32)
    for channels in (0, 1):
        own, wanted = np.zeros((64, 96, channels), np.float32), np.zeros((16, 16, channels), np.float32)
        assert (reseeded(source, RIVER, own, wanted, np.random.default_rng(3)) == source).all()
