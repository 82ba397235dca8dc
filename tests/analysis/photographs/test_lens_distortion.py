"""Walls through lenses of known distortion."""

from __future__ import annotations

import numpy as np
import pytest

from tests.analysis.photographs.test_plane_proposal import SHAPE, bricks, pixels, rectangle, rendered
from tests.photographs import unit_square
from texloom.stages.analysis.photographs.lens_distortion import LensDistortionParams, lens_distortion
from texloom.stages.analysis.photographs.plane_proposal import PlaneProposalParams, plane_proposal
from texloom.stages.common.features.line_segments import Frame
from texloom.stages.kernels.core.resample import sampled
from texloom.stages.kernels.core.threads import sharing
from texloom.stages.vocabulary.arrays import Image

FRAME = Frame(SHAPE)


def through_lens(photo: Image, distortion: float) -> Image:
    """A photograph as a lens shows it: places at r come from r / (1 + distortion r^2)."""
    places = FRAME.places(np.moveaxis(np.indices(SHAPE), 0, 2).astype(float))
    places /= 1 + distortion * np.square(places).sum(axis=2, keepdims=True)
    return photo.elsewhere(sampled(photo.pixels, FRAME.pixels(places)))


@pytest.mark.parametrize("distortion", [-0.15, 0.08, 0.0])
def test_the_distortion_of_a_wall(distortion: float, rng: np.random.Generator) -> None:
    corners = pixels(rectangle(2.9, 4.2, 0.2, -0.4, 0.05))
    straight = rendered([(bricks(12, 9, True, rng), corners)], rng)
    photo = through_lens(straight, distortion) if distortion else straight
    made = lens_distortion(photo, LensDistortionParams())
    assert abs(made.distortion - distortion) <= 0.02
    if not distortion:
        assert made.image is photo
        return
    inner = np.s_[60:-60, 80:-80]
    before, after = (np.abs(one.pixels - straight.pixels)[inner].mean() for one in (photo, made.image))
    if distortion < 0:  # cushions are reduced, so that all is shown
        assert after < 0.5 * before
    (proposed,) = plane_proposal(made.image, PlaneProposalParams()).corners
    scale = min(1.0, 1 / (1 + distortion))
    flat = unit_square(corners, *FRAME.pixels(FRAME.places(proposed) * scale).T) * (2.9, 4.2)
    sides = np.abs(np.roll(flat, -1, axis=0) - flat)
    assert np.degrees(np.arctan2(sides.min(axis=1), sides.max(axis=1))).max() < 2


def test_the_same_bits_on_one_thread_and_two(rng: np.random.Generator) -> None:
    photo = rendered([(bricks(5, 4, True, rng), pixels(rectangle(2.4, 3.2, 0.2, -0.4, 0)))], rng)
    made = []
    for threads in (1, 2):
        with sharing(threads):
            made.append(lens_distortion(photo, LensDistortionParams(distortion=-0.1)))
    np.testing.assert_array_equal(made[0].image.pixels, made[1].image.pixels)


def test_a_distortion_that_is_given_moves_places_as_the_model_says() -> None:
    ramp = np.tile(np.arange(SHAPE[1], dtype=np.float32), (SHAPE[0], 1))[..., None]
    made = lens_distortion(Image(ramp, ("Y",)), LensDistortionParams(distortion=-0.2)).image.pixels[..., 0]
    row, column = 100, 400
    source = (made[row, column] - (SHAPE[1] - 1) / 2) / (column - (SHAPE[1] - 1) / 2)
    place = FRAME.places(np.array([row, column], float)) * source
    assert abs(1 / (1 - 0.2 * np.square(place).sum()) * source - 1) < 1e-3
