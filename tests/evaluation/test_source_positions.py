"""Colours of the places that pixels come from."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.evaluation.source_positions import source_positions


def test_places_can_be_read_from_colours() -> None:
    exemplar = picture(np.zeros((41, 61)))
    match = np.random.default_rng(1).integers(0, (41, 61), (30, 50, 2)).astype(np.uint32)
    colors = source_positions(exemplar, match).image.pixels
    np.testing.assert_array_equal(np.rint(colors[..., 1] * 40), match[..., 0])
    np.testing.assert_array_equal(np.rint(colors[..., 2] * 60), match[..., 1])
    np.testing.assert_allclose(colors[..., 0] + colors[..., 1], 1, atol=1e-6)


def test_the_key_is_the_map_of_the_exemplar_itself() -> None:
    exemplar = picture(np.zeros((20, 30)))
    own = np.moveaxis(np.indices((20, 30), np.uint32), 0, 2)
    shown = source_positions(exemplar, own)
    np.testing.assert_allclose(shown.key.pixels, 0.65 * shown.image.pixels, atol=1e-6)
    lighter = source_positions(picture(np.ones((20, 30))), own)
    assert (lighter.key.pixels > shown.key.pixels).all()


def test_places_beyond_the_exemplar() -> None:
    with pytest.raises(ValueError, match="points outside an exemplar of 30 x 20 px"):
        source_positions(picture(np.zeros((20, 30))), np.full((4, 4, 2), 25, np.uint32))
