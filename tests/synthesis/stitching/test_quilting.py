from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.stitching.exemplar import Stitched, lab_of
from texloom.stages.synthesis.stitching.quilting import QuiltingParams, quilting
from texloom.stages.synthesis.stitching.seam_map import SeamMap, slopes
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Wraps


def quilt(image: Image, seed: int = 1, **params: Any) -> Stitched:
    params = {"size": (96, 108), "seam_refinement": 0.0, **params}
    return quilting(image, QuiltingParams(**params), np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((96, 120, 3), 2.0, rng))


def seams(result: Stitched) -> float:
    """Mean jump where the source jumps."""
    moves = result.match.astype(int) - np.indices(result.match.shape[:2]).transpose(1, 2, 0)
    total, count = 0.0, 0
    for axis in (0, 1):
        cut = (np.diff(moves, axis=axis) != 0).any(axis=2)
        total += float(np.abs(np.diff(result.image.pixels, axis=axis))[cut].sum())
        count += int(cut.sum())
    return total / count


def test_wider_overlaps_are_cut_better(image: Image) -> None:
    narrow, wide = (
        [seams(quilt(image, seed, size=(150, 170), overlap=overlap, block=40)) for seed in range(3)]
        for overlap in (0.04, 0.25)
    )
    assert np.mean(wide) < 0.85 * np.mean(narrow)


def test_tolerance_varies_the_blocks(image: Image) -> None:
    """With much of it, neighbours suit each other less, if not the cheapest cut of several is taken."""
    strict = np.mean([seams(quilt(image, seed, tolerance=0, tries=1)) for seed in range(3)])
    loose = np.mean([seams(quilt(image, seed, tolerance=3, tries=1)) for seed in range(3)])
    assert strict < 0.9 * loose


def test_blocks_with_minimum_cuts_are_chosen(image: Image) -> None:
    one = np.mean([seams(quilt(image, seed, tolerance=3, tries=1)) for seed in range(2)])
    some = np.mean([seams(quilt(image, seed, tolerance=3, tries=16)) for seed in range(2)])
    assert some < 0.95 * one


def test_used_blocks_cost_more(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    def unused() -> float:
        """Share of the exemplar's pixels, mean of some seeds."""
        shares = []
        for seed in range(4):
            free = np.ones((image.height, image.width), bool)
            free[tuple(np.moveaxis(quilt(image, seed, block=30, tolerance=3).match, 2, 0))] = False
            shares.append(free.mean())
        return float(np.mean(shares))

    even = unused()
    monkeypatch.setattr("texloom.stages.synthesis.stitching.quilting._REUSE_WEIGHT", 0.0)
    assert even < 0.9 * unused()


def test_refinement_lowers_the_cost_of_visible_seams(image: Image) -> None:
    """All together cost less, and so does the costliest."""

    def seam_costs(seam_refinement: float, seed: int, tileable: bool) -> np.ndarray:
        match = quilt(image, seed, seam_refinement=seam_refinement, tileable=tileable).match
        features = lab_of(image)
        return SeamMap(features, slopes(features), match, Wraps(tileable, tileable)).costs

    for tileable in (False, True):
        before_refinement = [seam_costs(0, seed, tileable) for seed in range(2)]
        refined = [seam_costs(2, seed, tileable) for seed in range(2)]
        assert all(
            after.sum() < 0.9 * before.sum() for before, after in zip(before_refinement, refined, strict=True)
        )
        assert np.mean([one.max() for one in refined]) < 0.8 * np.mean([one.max() for one in before_refinement])


@pytest.mark.parametrize("block", [None, 17])
def test_blocks_have_their_size(image: Image, block: int | None) -> None:
    """The first block is whole but for its overlaps, and no piece is larger than a block."""
    side = block or 36
    match = quilt(image, block=block).match.astype(int)
    moves = match - np.indices(match.shape[:2]).transpose(1, 2, 0)
    own = side - round(side / 3) - 2
    assert (moves[:own, :own] == moves[0, 0]).all()
    row = (moves[0] == moves[0, 0]).all(axis=1)
    assert row[:own].all()
    assert not row[side:].all()
