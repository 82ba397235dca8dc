"""Sources of pixels whose control a coarser scale did not show."""

import numpy as np

from texloom.stages.common.pyramid import resize
from texloom.stages.synthesis._kcoherence.reseed import reseeded

OWN = np.zeros((32, 48, 1), np.float32)
OWN[:, 20:26] = 80
"""control of an exemplar: a line from top to bottom"""


def line() -> np.ndarray:
    """Control of a result: a slanting line, 3 px wide."""
    rows, columns = np.indices((64, 64))
    return np.where(np.abs(columns - 20 - rows // 3) < 2, np.float32(80), np.float32(0))[..., None]


def again(wanted: np.ndarray, coarser: np.ndarray, explained: float = 1.0) -> np.ndarray:
    """Control at the new sources, of a result that came without the line."""
    source = np.zeros((*wanted.shape[:2], 2), np.int32)
    new = reseeded(source, OWN, wanted, coarser, explained, np.random.default_rng(3))
    assert not source.any()
    return np.asarray(OWN[new[..., 0], new[..., 1], 0])


def test_a_line_that_the_coarser_scale_lost_returns_whole() -> None:
    """All of it, and nothing beside it."""
    wanted = line()
    coarser = resize(resize(wanted, 8, 8), 64, 64, bilinear=True)
    assert (again(wanted, coarser) == wanted[..., 0]).all()


def test_what_the_coarser_scale_showed_stays() -> None:
    """It was decided there."""
    assert not again(line(), line()).any()


def test_single_pixels_stay() -> None:
    """Noise of control is no line."""
    wanted = np.zeros((64, 64, 1), np.float32)
    wanted[2::5, 2::5] = 80
    assert not again(wanted, np.zeros_like(wanted)).any()


def test_control_that_explains_nothing_changes_nothing() -> None:
    """Its deviations do not matter."""
    assert not again(line(), np.zeros((64, 64, 1), np.float32), explained=0.02).any()


def test_constant_control_and_none() -> None:
    """There is nothing to replace."""
    source = np.zeros((16, 16, 2), np.int32)
    for channels in (0, 1):
        own, wanted = np.zeros((32, 48, channels), np.float32), np.zeros((16, 16, channels), np.float32)
        assert (reseeded(source, own, wanted, wanted, 1.0, np.random.default_rng(3)) == source).all()
