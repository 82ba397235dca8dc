"""Offsets between a result whose texture turns and its exemplar."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.synthesis.reconstruction.oriented_places import Frames, at_scale, grown, interpolated
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

TURN = np.array([[0.8, 0.6], [-0.6, 0.8]])
SIZE = (30, 42)


def rotated(size: tuple[int, int], factor: float = 1.0) -> np.ndarray:
    """Sources of a result that is one turned piece of an exemplar."""
    pixels = grown(np.indices(size), 1 / factor)  # at full size
    places = np.einsum("ij,jyx->iyx", TURN.T, pixels) + np.array([40.0, 12.0])[:, None, None]
    return grown(places, factor).astype(np.float32)


def frames(height: int, width: int) -> Frames:
    return Frames.of(np.broadcast_to(TURN.reshape(4), (7, 9, 4)).astype(np.float32), height, width)


def test_offsets_are_transformed_to_the_exemplar() -> None:
    rng = np.random.default_rng(1)
    jacobian = (np.array([1, 0, 0, 1]) + 0.3 * rng.normal(size=(*SIZE, 4))).astype(np.float32)
    offset = rng.normal(size=(2, *SIZE))
    own = Frames.of(jacobian, *SIZE)
    transformed = own.to_exemplar(offset)
    back = np.einsum("yxij,jyx->iyx", jacobian.reshape(*SIZE, 2, 2), transformed)
    np.testing.assert_allclose(back, offset, atol=1e-3)
    window = (slice(3, 8), slice(10, 20))
    np.testing.assert_allclose(own.to_exemplar(offset[:, *window], window), transformed[:, *window])


def test_other_sizes_take_the_nearest_jacobian() -> None:
    jacobian = np.zeros((4, 6, 4), np.float32)
    jacobian[..., 0] = jacobian[..., 3] = 1 + np.arange(24).reshape(4, 6)
    np.testing.assert_array_equal(
        Frames.of(jacobian, 8, 12).jacobian[..., 0], np.kron(jacobian[..., 0], np.ones((2, 2)))
    )
    np.testing.assert_array_equal(Frames.of(jacobian, 2, 3).jacobian[..., 0], jacobian[1::2, 1::2, 0])


@pytest.mark.parametrize("factor", [2.0, 1.5])
def test_one_piece_stays_one_at_a_finer_scale(factor: float) -> None:
    coarse = rotated((round(SIZE[0] / factor), round(SIZE[1] / factor)), 1 / factor)
    finer = frames(*SIZE).finer(coarse, factor, (100, 100))
    np.testing.assert_allclose(finer, rotated(SIZE), atol=1e-4)


def test_places_stay_in_the_exemplar() -> None:
    finer = frames(*SIZE).finer(rotated((15, 21), 0.5) - 10, 2.0, (50, 30))
    assert finer.min() == 0
    assert finer[0].max() < 49
    assert finer[1].max() == 29


def test_a_correspondence_begins_at_a_scale() -> None:
    source = np.indices((40, 60)).transpose(1, 2, 0).astype(np.uint32)
    np.testing.assert_allclose(at_scale(source, 0.5, (20, 30), (21, 31)), np.indices((20, 30)) + 0.25)


def test_pixels_between_are_interpolated(rng: np.random.Generator) -> None:
    rows, columns = np.indices((20, 21))
    plane = (0.1 * rows + 0.02 * columns).astype(np.float32)
    places = np.array([[[8.25, 10.0]], [[9.5, 6.0]]], np.float32)
    np.testing.assert_allclose(interpolated(picture(plane), places).pixels[0, :, 0], [1.015, 1.12], atol=1e-4)
    rough = Image(rng.random((20, 21, 2), np.float32), ("Y", "height"))
    rough.pixels[..., 1] = 3
    pixels = interpolated(rough, np.indices((20, 21)).astype(np.float32)).pixels
    np.testing.assert_allclose(pixels, rough.pixels, atol=1e-5)
    moved = interpolated(rough, (np.indices((20, 21)) + 0.5).astype(np.float32)).pixels
    assert moved[..., 0].min() >= rough.pixels[..., 0].min()
    assert moved[..., 0].max() <= rough.pixels[..., 0].max()
    np.testing.assert_array_equal(moved[..., 1], 3)


def test_a_pixel_without_area_is_refused() -> None:
    jacobian = np.broadcast_to(TURN.reshape(4), (*SIZE, 4)).astype(np.float32)
    jacobian[2, 3] = [1, 1, 1, 1]
    with pytest.raises(InputError, match="target_jacobian: a pixel has no area"):
        Frames.of(jacobian, *SIZE)
