"""Maps voted from the patches of an earlier result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthesis.optimisation.test_optimise import SHAPE, run
from tests.synthetic import blobs, identity, masked, picture, smooth_noise
from tests.wraps import X
from texloom.stages.synthesis.optimisation.optimise import Optimised
from texloom.stages.synthesis.optimisation.reapply import reapply
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.voted_patches import VotedPatches


def patches_of(result: Optimised) -> VotedPatches:
    assert result.patches is not None
    return VotedPatches.of(result.patches, result.voting)


@pytest.fixture
def material(rng: np.random.Generator) -> Image:
    """Colour, normals and a height."""
    colors = blobs((*SHAPE, 3), rng)
    slopes = smooth_noise((*SHAPE, 2), 2, rng) * 0.2
    normals = np.dstack([slopes, np.ones(SHAPE)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    pixels = np.dstack([colors, normals, colors.mean(axis=2)]).astype(np.float32)
    return Image(pixels, ("R", "G", "B", *NORMAL, "height"))


@pytest.mark.parametrize(
    "options", [{"tileable": True}, {"tileable": X}, {"border": False}, {"preset": "kaspar2015"}]
)
def test_the_exemplar_gives_the_earlier_result(material: Image, options: dict[str, Any]) -> None:
    made = run(material, **options)
    again = reapply(material, patches_of(made))
    np.testing.assert_array_equal(again.image.pixels, made.image.pixels)
    np.testing.assert_array_equal(again.match, made.match)
    assert again.image.wraps == made.image.wraps


def test_masked_pixels_are_not_voted(rng: np.random.Generator) -> None:
    usable = np.ones(SHAPE, bool)
    usable[10:20, 30:40] = False
    exemplar = masked(picture(blobs((*SHAPE, 3), rng)), usable, 9.0)
    made = run(exemplar)
    np.testing.assert_array_equal(reapply(exemplar, patches_of(made)).image.pixels, made.image.pixels)


def test_a_map_that_comes_later_is_in_register(material: Image) -> None:
    """Its votes are those of a map that was there: of the heights, once more."""
    colors = material.with_pixels(material.pixels[..., :3].copy(), ("R", "G", "B"))
    height = material.pixels[..., 6:]
    made = run(colors, tileable=True, even_joints=False)
    more = Image(np.dstack([colors.pixels, height]), ("R", "G", "B", "roughness"))
    again = reapply(more, patches_of(made)).image.pixels
    np.testing.assert_array_equal(again[..., :3], made.image.pixels)
    np.testing.assert_allclose(again[..., 3], made.image.pixels.mean(axis=2), atol=1e-5)


def test_any_number_of_threads_gives_the_same_bits(material: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    votes = patches_of(run(material))
    one, two = run_with_threads(lambda: reapply(material, votes), monkeypatch)
    np.testing.assert_array_equal(one.image.pixels, two.image.pixels)


def test_maps_of_another_size_are_refused(material: Image) -> None:
    votes = patches_of(run(material))
    with pytest.raises(InputError, match="has 48 x 40 px, but the exemplar of that result had 64 x 56 px"):
        reapply(material.cropped(slice(0, 40), slice(0, 48)), votes)


def test_where_pixels_are_kept_there_are_no_patches(rng: np.random.Generator) -> None:
    exemplar = picture(blobs((*SHAPE, 3), rng))
    keep = np.ones(SHAPE, bool)
    keep[20:30, 20:40] = False
    made = run(exemplar, identity(SHAPE), keep=keep)
    assert made.patches is None
    with pytest.raises(ValueError, match="does not say how a result was voted"):
        VotedPatches.of(np.zeros((1, 1, 2), np.uint32), made.voting)
