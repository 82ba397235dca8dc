"""Exclusion by a mask, and the stages of analysis that respect it."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from tests.synthetic import LATTICES, difference, picture, stamped
from texloom.stages.analysis.exemplars.exclusion_mask import ExclusionMask, ExclusionMaskParams, exclusion_mask
from texloom.stages.analysis.regularity.autocorrelation import AutocorrelationParams, autocorrelation
from texloom.stages.analysis.regularity.lattice import LatticeParams, lattice
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.analysis.structure.guidance_weight import GuidanceWeightParams, guidance_weight
from texloom.stages.analysis.structure.otsu import OtsuParams, otsu
from texloom.stages.analysis.structure.signed_distance import signed_distance
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import USABLE


def under(image: Image, mask: np.ndarray | None, **params: Any) -> ExclusionMask:
    marks = None if mask is None else picture(mask.astype(np.float32))
    return exclusion_mask(image, ExclusionMaskParams(**params), marks)


def test_white_may_be_used(rng: np.random.Generator) -> None:
    image = picture(rng.random((6, 8, 3)))
    levels = np.linspace(0, 1, 48).reshape(6, 8)
    result = under(image, levels)
    np.testing.assert_array_equal(result.valid, levels >= 0.214)
    np.testing.assert_array_equal(under(image, levels, avoid="white").valid, ~result.valid)
    assert result.image.channels == ("R", "G", "B", USABLE)
    np.testing.assert_array_equal(result.image.pixels[..., 3], result.valid)
    np.testing.assert_array_equal(result.image.pixels[..., :3], image.pixels)


def test_alpha_and_earlier_masks_stay(rng: np.random.Generator) -> None:
    pixels = rng.random((6, 8, 4), np.float32) * 0.4 + 0.6
    pixels[2, 3, 3] = 0
    first = np.ones((6, 8))
    first[0, 0] = 0
    second = np.ones((6, 8))
    second[5, 5] = 0
    twice = under(under(Image(pixels, ("R", "G", "B", "A")), first).image, second)
    assert np.argwhere(~twice.valid).tolist() == [[0, 0], [2, 3], [5, 5]]
    assert twice.image.channels == ("R", "G", "B", "A", USABLE)


def test_a_picture_is_taken_as_a_tile_where_that_is_asked(rng: np.random.Generator) -> None:
    noise = picture(rng.random((32, 32, 3)))  # whose borders fit everywhere
    marked = np.ones((32, 32))
    marked[:4, 8:16] = 0
    asked = {"off": "off", "y": "y", None: "both"}
    assert {keep: str(under(noise, marked, keep_tile=keep).image.wraps) for keep in asked} == asked
    tile = noise.wrapping(Wraps.of("x"))
    assert str(under(tile, marked, keep_tile="y").image.wraps) == "both"
    assert str(under(tile, marked, keep_tile=None).image.wraps) == "x"


def test_a_mask_that_excludes_nothing_is_a_warning(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    image = picture(rng.random((6, 8, 3)))
    marked = np.zeros((6, 8))
    marked[2, 3] = 1
    with caplog.at_level(logging.WARNING):
        under(image, marked, avoid="white")
        assert caplog.messages == []
        under(image, np.zeros((6, 8)), avoid="white")
    assert caplog.messages == ["the mask excludes no pixel: none of it is white"]


def test_marks_can_grow(rng: np.random.Generator) -> None:
    mask = np.ones((9, 9))
    mask[4, 4] = 0
    grown = under(picture(rng.random((9, 9, 3))), mask, grow=2).valid
    assert (~grown).sum() == 25
    assert not grown[2:7, 2:7].any()


def test_a_mask_must_fit_and_leave_something(rng: np.random.Generator) -> None:
    image = picture(rng.random((6, 8, 3)))
    check = find_stage("analysis.exclusion_mask").check
    assert check is not None
    with pytest.raises(InputError, match="mask: 6 x 8 px; must have the size of the image, 8 x 6 px") as caught:
        check(ExclusionMaskParams(), {"image": image, "mask": picture(np.ones((8, 6)))})
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no pixel of it is transparent, and no mask is given"):
        check(ExclusionMaskParams(), {"image": image})
    with pytest.raises(InputError, match="all pixels of the image are excluded"):
        under(image, np.zeros((6, 8)))


def logo(image: Image, color: float) -> Image:
    """``image`` with a chequered sign on it, which is masked."""
    mask = np.ones((image.height, image.width), np.float32)
    mask[40:130, 60:190] = 0
    row, column = np.indices(mask.shape)
    sign = (color * ((row // 9 + column // 9) % 2)).astype(np.float32)
    pixels = np.where(mask[..., None] > 0, image.pixels, sign[..., None])
    return under(picture(pixels), mask).image


def test_analysis_never_sees_what_is_masked(rng: np.random.Generator) -> None:
    """Not a bit of any result depends on it, and the lattice of the rest is found."""
    clean = stamped(LATTICES["sheared"], rng)
    result = []
    for image in (logo(clean, 1.0), logo(clean, 40.0)):
        contours = edges(image, EdgesParams()).strength
        structure = otsu(contours, OtsuParams(), image)
        weighed = guidance_weight(image, signed_distance(structure.structure).pixels, GuidanceWeightParams())
        offsets = offset_statistics(image, OffsetStatisticsParams())
        cells = lattice(image, offsets.density, LatticeParams())
        assert not structure.structure[40:130, 60:190].any()
        assert difference(cells.generators, LATTICES["sheared"]) < 1
        correlated = autocorrelation(image, AutocorrelationParams())
        result.append([contours, structure.structure, weighed.densities, offsets.density, correlated.density])
        result[-1].append(cells.generators)
    for one, other in zip(*result, strict=True):
        np.testing.assert_array_equal(one, other)
    assert contours.max() == 1


def test_the_threshold_counts_usable_pixels_only(rng: np.random.Generator) -> None:
    strength = rng.random((40, 40)).astype(np.float32) * 0.2
    strength[:, 20] = 0.5
    mask = np.ones((40, 40))
    mask[:, :8] = 0
    image = under(picture(np.ones((40, 40, 3))), mask).image
    alone = otsu(np.ascontiguousarray(strength[:, 8:]), OtsuParams())
    strength[:, :8] = 1
    result = otsu(strength, OtsuParams(), image)
    assert result.threshold == alone.threshold
    np.testing.assert_array_equal(result.structure[:, 8:], alone.structure)
    assert otsu(strength, OtsuParams()).threshold != alone.threshold
