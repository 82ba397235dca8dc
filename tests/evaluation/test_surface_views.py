from __future__ import annotations

import numpy as np

from tests.surfaces import square
from texloom.stages.common.surface.mesh import with_normals
from texloom.stages.evaluation.surface_views import SurfaceViewsParams, surface_views
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL


def views(image: Image, **params: object) -> np.ndarray:
    checked = SurfaceViewsParams.model_validate({"side": 32, "tilt": 0, **params})
    return surface_views(with_normals(square()), image, checked).image.pixels


def test_the_texture_is_upright_and_not_mirrored() -> None:
    pixels = np.zeros((8, 8, 3), np.float32)
    pixels[:4, 4:] = (1, 0, 0)
    shown = views(Image(pixels, ("R", "G", "B")), views=1)
    red = np.argwhere(shown[..., 0] - shown[..., 1] > 0.2)
    assert len(red) > 50
    assert red[:, 0].max() <= 16
    assert red[:, 1].min() >= 15


def test_views_go_around() -> None:
    """From the side a square is not seen; from behind it is mirrored."""
    pixels = np.zeros((8, 8, 3), np.float32)
    pixels[:, 4:] = (1, 0, 0)
    front, side, back, _ = np.split(views(Image(pixels, ("R", "G", "B")), views=4), 4, axis=1)
    assert front.max() > 0.3
    assert side.max() < 0.3
    np.testing.assert_allclose((front[..., 0] > 0.3).sum(), (back[:, ::-1, 0] > 0.3).sum(), atol=16)


def test_normals_of_the_material_count() -> None:
    normals = np.broadcast_to(np.array([-0.6, 0.0, 0.8], np.float32), (8, 8, 3))
    plain = np.full((8, 8, 1), 0.5, np.float32)
    facing = views(Image(np.concatenate([plain, normals], axis=2), ("Y", *NORMAL)), views=1)
    flat = views(Image(plain, ("Y",)), views=1)
    assert facing[16, 16, 0] > 1.1 * flat[16, 16, 0]  # the light comes from the upper left
