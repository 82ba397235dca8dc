from __future__ import annotations

import numpy as np
import pytest

from tests.plain import SHAPE, image_melding
from tests.synthetic import blobs, picture
from texloom.stages.vocabulary.arrays import Image


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


@pytest.mark.parametrize("tileable", [False, True])
def test_results_have_the_tone_of_the_exemplar(exemplar: Image, tileable: bool) -> None:
    pixels = image_melding(exemplar, tileable=tileable).image.pixels
    assert pixels.min() >= 0
    assert abs(pixels.mean() - exemplar.pixels.mean()) < 0.1


def test_maps_come_from_the_same_places(exemplar: Image) -> None:
    """A map that does not count leaves the colours unchanged, and is a plain average of the same sources."""
    height = 3 * exemplar.pixels[..., :1] - 40
    both = Image(np.concatenate([exemplar.pixels, height], axis=2), ("R", "G", "B", "height"))
    fixed = {"bias_color": 0, "bias_lightness": 0, "min_gain": 1, "max_gain": 1, "gradient_weight": 0}
    result, alone = image_melding(both, weights={"height": 0}, **fixed), image_melding(exemplar, **fixed)
    np.testing.assert_array_equal(result.image.pixels[..., :3], alone.image.pixels)
    red, voted = result.image.pixels[..., 0], result.image.pixels[..., 3]
    assert np.corrcoef(red.ravel(), voted.ravel())[0, 1] > 0.98


def test_grey_pictures_stay_grey(exemplar: Image) -> None:
    grey = picture(exemplar.pixels[..., 0])
    assert image_melding(grey).image.channels == ("Y",)
