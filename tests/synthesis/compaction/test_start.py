"""The start of a compaction."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from texloom.stages.analysis.k_coherence import KCoherenceParams
from texloom.stages.analysis.tsvq import TsvqParams
from texloom.stages.kernels.compaction.solver import seam_sum
from texloom.stages.synthesis._compaction import start as inverse_start
from texloom.stages.synthesis._compaction.start import start
from texloom.stages.synthesis.inverse.level import Level


def level(features: np.ndarray) -> Level:
    return Level(features, 5, 2, None, TsvqParams(neighbourhood=5), KCoherenceParams(k=2))


def halves(rng: np.random.Generator) -> np.ndarray:
    """Two textures side by side, dark stripes and light noise."""
    planes = np.zeros((60, 80, 3), np.float32)
    planes[:, :40, 0] = 20 + 10 * np.sin(np.arange(40) * 2 * np.pi / 8)
    planes[:, 40:, 0] = rng.uniform(70, 90, (60, 40))
    return planes


@pytest.mark.parametrize("method", ["cover", "random"])
@pytest.mark.parametrize("size", [(32, 32), (33, 27), (9, 60)])
@pytest.mark.parametrize("wrap", [False, True])
def test_blocks_of_the_texture_fill_the_compaction(
    method: Literal["cover", "random"], size: tuple[int, int], wrap: bool, rng: np.random.Generator
) -> None:
    source = start(level(halves(rng)), size, 12, method, 0.3, 0.0, wrap, rng)
    assert source.shape == (2, *size)
    assert (source >= 0).all()
    assert (source.max(axis=(1, 2)) < (60, 80)).all()
    beside = (source[:, :, 1:] - source[:, :, :-1] == np.array([0, 1])[:, None, None]).all(axis=0)
    assert beside.mean() > 0.75  # all but the joints


def test_both_halves_are_covered(rng: np.random.Generator) -> None:
    source = start(level(halves(rng)), (24, 24), 12, "cover", 0.3, 0.0, False, rng)
    assert 0.2 < (source[1] < 40).mean() < 0.8


def test_proportion_preserves_area_shares(rng: np.random.Generator) -> None:
    """A plain field and, in a fifth of the texture, all kinds of noise."""
    planes = np.zeros((60, 80, 3), np.float32)
    planes[..., 0] = 30
    planes[:, 64:, 0] = rng.uniform(40, 90, (60, 16))
    shares = [
        float((start(level(planes), (48, 48), 12, "cover", 0.0, weight, True, rng)[1] < 64).mean())
        for weight in (0.0, 4.0)
    ]
    assert shares[0] < 0.6
    assert shares[1] == pytest.approx(0.8, abs=0.1)


@pytest.mark.parametrize("wrap", [False, True])
def test_cover_joins_similar_blocks(wrap: bool, rng: np.random.Generator) -> None:
    """Stripes of one period can be laid without a visible joint."""
    planes = np.zeros((60, 80, 3), np.float32)
    planes[..., 0] = 50 + 30 * np.sin(np.arange(80) * 2 * np.pi / 8)
    fitted, random = (
        start(level(planes), (40, 40), 12, method, 100.0, 0.0, wrap, rng) for method in ("cover", "random")
    )
    shown = [planes[source[0], source[1], 0] for source in (fitted, random)]
    if wrap:
        shown = [np.pad(picture, 1, mode="wrap") for picture in shown]
    steps = [np.abs(np.diff(picture, axis=1)).max() for picture in shown]
    within = np.abs(np.diff(planes[0, :, 0])).max()
    assert steps[0] <= within + 1e-3
    assert steps[1] > 1.2 * within


def test_restarts_lower_the_seam_cost(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    planes = rng.uniform(0, 100, (15, 20, 3)).repeat(4, axis=0).repeat(4, axis=1).astype(np.float32)
    texture = level(planes)
    visible = []
    for restarts in (1, 16):
        monkeypatch.setattr(inverse_start, "_RESTARTS", restarts)
        source = start(texture, (40, 40), 12, "cover", 100.0, 0.0, True, np.random.default_rng(3))
        visible.append(seam_sum(texture.pixels, texture.channels, True, source))
    assert visible[1] < 0.95 * visible[0]
