"""Mixtures of stochastic exemplars, whose statistics change gradually."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, wall
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.remix.colour_statistics import Statistics, with_statistics
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet, ExemplarSheetParams, exemplar_sheet
from texloom.stages.synthesis.remix.graded_statistics import graded_statistics
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear

SIDE = 96


def coarse_and_fine() -> list[Image]:
    """Bright red clouds, and dark green grains."""
    rng = np.random.default_rng(0)
    clouds, grains = smooth_noise((SIDE, SIDE), 1.0, rng)[..., None], rng.random((SIDE, SIDE, 1))
    return [
        picture((0.3 + 0.4 * clouds * [1, 0.5, 0.4]).astype(np.float32)),
        picture((0.02 + 0.2 * grains * [0.3, 1, 0.3]).astype(np.float32)),
    ]


def sheet(images: list[Image], gradual: bool = True) -> ExemplarSheet:
    return exemplar_sheet(
        images, [{"name": name} for name in "abc"[: len(images)]], ExemplarSheetParams(gradual=gradual)
    )


def strips(made: ExemplarSheet, number: int) -> tuple[np.ndarray, np.ndarray]:
    """A texture of copies of one exemplar, and its place in the sheet, without end along the way."""
    corner = made.rectangles[number, :2]
    match = (np.stack(np.indices((SIDE, SIDE)), axis=2) + corner).astype(np.uint32)
    return made.image.pixels[match[..., 0], match[..., 1]][..., :3], match


def distances(lab: np.ndarray, other: np.ndarray) -> float:
    """Between all histograms, CIELAB units."""
    every = np.ones(lab.shape[:2], bool)
    one, two = Statistics.of(lab, every), Statistics.of(other, every)
    pairs = zip((*one.bands, *one.colors), (*two.bands, *two.colors), strict=True)
    return float(np.mean([np.abs(a - b).mean() for left, right in pairs for a, b in zip(left, right, strict=True)]))


def at(made: ExemplarSheet, number: int, place: float) -> np.ndarray:
    """CIELAB of an exemplar's copy at a place of the way."""
    pixels, match = strips(made, number)
    way = np.full((SIDE, SIDE), place, np.float32)
    graded = graded_statistics(picture(pixels), match, way, made.image, made.rectangles, made.original)
    return lab_from_linear(graded.image.color)


def test_statistics_change_steadily_and_are_halfway_in_the_middle() -> None:
    images = coarse_and_fine()
    made = sheet(images)
    assert made.original is not None
    ends = [lab_from_linear(image.color) for image in images]
    whole = distances(*ends)
    for number in (0, 1):
        shown = [at(made, number, place) for place in (0, 0.125, 0.25, 0.5, 0.75, 1)]
        from_first = [distances(one, ends[0]) for one in shown]
        to_last = [distances(one, ends[1]) for one in shown]
        assert (np.diff(from_first) > 0).all()
        assert (np.diff(to_last) < 0).all()
        assert from_first[3] == pytest.approx(whole / 2, rel=0.15)
        assert to_last[3] == pytest.approx(whole / 2, rel=0.15)
        for measure in (np.mean, np.std):
            values = [measure(one[..., 0]) for one in shown]
            assert (np.diff(values) * np.sign(values[-1] - values[0]) > 0).all()
        fine = [(one[..., 0] - gaussian_blur(one[..., 0], 1.0)).std() for one in shown]
        assert (np.diff(fine) * np.sign(fine[-1] - fine[0]) > 0).all()


def test_both_have_the_same_statistics_at_each_place() -> None:
    made = sheet(coarse_and_fine())
    whole = distances(at(made, 0, 0), at(made, 1, 1))
    for place in (0.25, 0.5, 0.75):
        assert distances(at(made, 0, place), at(made, 1, place)) < 0.15 * whole


def test_ends_are_the_exemplars() -> None:
    images = coarse_and_fine()
    made = sheet(images)
    for number, image in enumerate(images):
        np.testing.assert_allclose(at(made, number, number), lab_from_linear(image.color), atol=0.02)


def test_a_structured_exemplar_keeps_all_as_they_are(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    images = [coarse_and_fine()[0], wall((SIDE, SIDE), 16, 0, rng)]
    with caplog.at_level(logging.INFO):
        made = sheet(images)
    assert made.original is None
    assert "patches of either in between, as not all are stochastic: " in caplog.text
    np.testing.assert_array_equal(made.image.pixels, sheet(images, gradual=False).image.pixels)
    pixels, match = strips(made, 0)
    way = np.full((SIDE, SIDE), 0.5, np.float32)
    same = graded_statistics(picture(pixels), match, way, made.image, made.rectangles)
    np.testing.assert_array_equal(same.image.pixels, pixels)


def test_own_statistics_change_nothing_and_flat_planes_are_moved_whole() -> None:
    image = coarse_and_fine()[0]
    lab, every = lab_from_linear(image.color), np.ones((SIDE, SIDE), bool)
    own = Statistics.of(lab, every)
    np.testing.assert_allclose(with_statistics(lab, every, own), lab, atol=0.5)
    flat = np.zeros_like(lab)
    moved = with_statistics(flat, every, own)
    np.testing.assert_allclose(moved, np.broadcast_to(lab.mean(axis=(0, 1)), lab.shape), atol=1)
    assert moved.std(axis=(0, 1)).max() < 1e-2


def test_excluded_pixels_do_not_count() -> None:
    lab = lab_from_linear(coarse_and_fine()[0].color)
    valid = np.ones((SIDE, SIDE), bool)
    valid[:, :20] = False
    damaged = np.where(valid[..., None], lab, np.float32(100))
    for one, two in zip(Statistics.of(lab, valid).colors, Statistics.of(damaged, valid).colors, strict=True):
        np.testing.assert_array_equal(np.stack(one), np.stack(two))
