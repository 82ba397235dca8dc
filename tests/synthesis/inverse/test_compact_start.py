"""The start of a compaction, which is the result of a run that ends before pixels are chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import TsvqParams, tsvq
from texloom.stages.synthesis.inverse.compact import Compacted, CompactParams, compact
from texloom.stages.vocabulary.arrays import Image


def start(features: np.ndarray, rng: np.random.Generator, **params: Any) -> Compacted:
    tree = tsvq(features, TsvqParams(neighbourhood=5))
    candidates = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=2)).candidates
    checked = CompactParams.model_validate(
        {"block": 12, "iterations": 1, "coarsest": 1024, "start": "cover", **params}
    )
    return compact(Image(features, ("R", "G", "B")), features, tree.nodes, tree.leaf, candidates, checked, rng)


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
    method: str, size: tuple[int, int], wrap: bool, rng: np.random.Generator
) -> None:
    source = start(halves(rng), rng, size=size, start=method, seams=0.3, tileable=wrap).source.astype(int)
    assert source.shape == (*size, 2)
    assert (source.max(axis=(0, 1)) < (60, 80)).all()
    continued = (np.diff(source, axis=1) == (0, 1)).all(axis=2)
    assert continued.mean() > 0.75  # all but the joints


def test_both_halves_are_covered(rng: np.random.Generator) -> None:
    source = start(halves(rng), rng, size=(24, 24), seams=0.3).source
    assert 0.2 < (source[..., 1] < 40).mean() < 0.8


def test_proportion_preserves_area_shares(rng: np.random.Generator) -> None:
    """A plain field and, in a fifth of the texture, all kinds of noise."""
    planes = np.zeros((60, 80, 3), np.float32)
    planes[..., 0] = 30
    planes[:, 64:, 0] = rng.uniform(40, 90, (60, 16))
    without, preserved = (
        float(
            (
                start(planes, rng, size=(48, 48), seams=0, proportion=weight, tileable=True).source[..., 1] < 64
            ).mean()
        )
        for weight in (0.0, 4.0)
    )
    assert without < 0.6
    assert preserved == pytest.approx(0.8, abs=0.1)


@pytest.mark.parametrize("wrap", [False, True])
def test_cover_joins_similar_blocks(wrap: bool, rng: np.random.Generator) -> None:
    """Stripes of one period can be joined without a visible seam."""
    planes = np.zeros((60, 80, 3), np.float32)
    planes[..., 0] = 50 + 30 * np.sin(np.arange(80) * 2 * np.pi / 8)
    steps = []
    for method in ("cover", "random"):
        image = start(planes, rng, size=(40, 40), start=method, seams=100, tileable=wrap).image.pixels[..., 0]
        steps.append(np.abs(np.diff(np.pad(image, 1, mode="wrap" if wrap else "edge"), axis=1)).max())
    within = np.abs(np.diff(planes[0, :, 0])).max()
    assert steps[0] <= within + 1e-3
    assert steps[1] > 1.2 * within


def test_restarts_lower_the_seam_cost(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    planes = rng.uniform(0, 100, (15, 20, 3)).repeat(4, axis=0).repeat(4, axis=1).astype(np.float32)
    seams = []
    for restarts in (1, 16):
        monkeypatch.setattr("texloom.stages.synthesis.inverse.start._RESTARTS", restarts)
        result = start(planes, np.random.default_rng(3), size=(40, 40), seams=100, tileable=True)
        seams.append(result.energy[0]["seams"])
    assert seams[1] < 0.95 * seams[0]
