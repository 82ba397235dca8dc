from __future__ import annotations

import numpy as np
import pytest

from tests.plain import SHAPE, bidirectional, distances
from tests.runs import run_with_progress
from tests.synthetic import blobs, picture
from texloom.stages.vocabulary.arrays import Image


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def test_completeness_brings_in_what_coherence_leaves_out() -> None:
    """Half of the exemplar is plain; random starts lose the other half, unless the result must contain it."""
    rng = np.random.default_rng(2)
    pixels = np.full((*SHAPE, 3), 0.3)
    pixels[:, SHAPE[1] // 2 :] = blobs((SHAPE[0], SHAPE[1] // 2, 3), rng)
    image = picture(pixels)
    lost = [
        distances(image.pixels, bidirectional(image, completeness=share, preset="default").image.pixels)
        for share in (0.0, 0.5)
    ]
    assert lost[1] < 0.6 * lost[0]


@pytest.mark.parametrize("tileable", [False, True])
def test_energies_fall_and_colours_are_means(exemplar: Image, tileable: bool) -> None:
    result, progress = run_with_progress(lambda: bidirectional(exemplar, tileable=tileable))
    assert exemplar.pixels.min() - 1e-5 < result.image.pixels.min()
    assert result.image.pixels.max() < exemplar.pixels.max() + 1e-5
    for scale in range(1, progress[-1].scales + 1):
        energies = [report.energy for report in progress if report.scale == scale]
        assert energies[-1] <= energies[0] * 1.001  # type: ignore[operator]


def test_maps_stay_in_register_with_colour(exemplar: Image) -> None:
    """A map that is a linear function of a colour in the exemplar is the same function in the result."""
    height = 3 * exemplar.pixels[..., :1] - 40
    both = Image(np.concatenate([exemplar.pixels, height], axis=2), ("R", "G", "B", "height"))
    result, alone = bidirectional(both, weights={"height": 0}), bidirectional(exemplar)
    np.testing.assert_array_equal(result.image.pixels[..., :3], alone.image.pixels)
    red, voted = result.image.pixels[..., 0], result.image.pixels[..., 3]
    np.testing.assert_allclose(voted, 3 * red - 40, atol=1e-3)
