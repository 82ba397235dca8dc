"""Small pictures of results."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.pipelines.studio.thumbnails import sphere
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL


@pytest.mark.parametrize("side", [64, 512])
def test_a_sphere_shows_a_material_of_many_maps_of_any_size(side: int) -> None:
    channels = ("R", "G", "B", "height", "roughness", *NORMAL)
    pixels = np.full((side, side, len(channels)), 0.5, np.float32)
    pixels[..., 5:] = (0, 0, 1)
    shown = sphere(Image(pixels, channels), 48)
    assert shown.shape == (48, 48, 4)
    assert (shown[24, 24] > 0).all()
    assert shown[0, 0, 3] == 0
