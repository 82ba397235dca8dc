"""Flat textures from rendered photographs of textures that are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stages.analysis import _bezier
from stages.analysis.appearance_stack import AppearanceStackParams, appearance_stack
from stages.analysis.gaussian_stack import GaussianStackParams, gaussian_stack
from stages.analysis.jacobian_field import JacobianFieldParams, jacobian_field
from stages.arrays import Image
from stages.synthesis.per_pixel import PerPixelParams, per_pixel
from tests.synthetic import picture

SIDE = 128
FINER = 8  # samples a px and side of the rendering
CORNERS = [[10.0, 44.0], [10.0, 84.0], [128.0, 180.0], [128.0, -52.0]]  # of a plane of 2 x 1
CELLS = 8  # of a checkerboard, across
DIRECTION = np.array([4.8, 6.4])  # periods of stripes in a unit of the plane, down and across


def photographed(checkered: bool) -> Image:
    """A plane that runs away from the viewer, every pixel a mean over its area."""
    rows, columns = (np.indices((SIDE * FINER, SIDE * FINER)) + 0.5) / FINER - 0.5
    matrix = np.linalg.inv(_bezier.homography(np.array(CORNERS)))
    back = np.stack([rows, columns, np.ones_like(rows)], axis=2) @ matrix.T
    down, across = 2 * back[..., 0] / back[..., 2], back[..., 1] / back[..., 2]
    if checkered:
        fine = (np.floor(down * CELLS) + np.floor(across * CELLS)) % 2
    else:
        fine = np.floor(2 * (down * DIRECTION[0] + across * DIRECTION[1])) % 2
    return picture(fine.reshape(SIDE, FINER, SIDE, FINER).mean(axis=(1, 3)))


def flattened(photo: Image, folder: Path) -> tuple[np.ndarray, float]:
    """The flat texture, and how many elements a unit of the plane has in it."""
    path = folder / "geometry.json"
    region = [[14, 0], [14, SIDE - 1], [SIDE - 1, SIDE - 1], [SIDE - 1, 0]]
    path.write_text(json.dumps({"patches": [{"corners": CORNERS, "size": [2, 1]}], "region": [region]}))
    surface = jacobian_field(photo, JacobianFieldParams(geometry=path))
    levels = gaussian_stack(
        photo, surface.jacobian, surface.level, surface.region, GaussianStackParams(neighbourhoods=50)
    )
    look = appearance_stack(
        photo, AppearanceStackParams(), jacobian=surface.jacobian, stack=levels.stack, valid=levels.valid
    )
    made = per_pixel(
        photo,
        look.appearance,
        look.basis,
        look.similar,
        look.toroidal,
        PerPixelParams(size=(SIDE, SIDE)),
        np.random.default_rng(1),
        jacobian=surface.jacobian,
    )
    return made.image.pixels[..., 0], surface.scale


def test_stripes_have_their_width_and_direction(tmp_path: Path) -> None:
    flat, scale = flattened(photographed(checkered=False), tmp_path)
    window = np.outer(np.hanning(SIDE), np.hanning(SIDE))
    spectrum = np.abs(np.fft.fft2((flat - flat.mean()) * window, (1024, 1024)))[:512]
    peak = np.array(np.unravel_index(spectrum.argmax(), spectrum.shape))
    found = np.array([peak[0], (peak[1] + 512) % 1024 - 512]) / 1024
    wanted = DIRECTION / scale
    assert np.hypot(*found) == pytest.approx(np.hypot(*wanted), rel=0.05)
    assert np.arctan2(*found) == pytest.approx(np.arctan2(*wanted), abs=np.radians(3))


def test_a_checkerboard_has_its_cells(tmp_path: Path) -> None:
    """[Eisenacher2008]_ Figure 16: few cells of the photograph are sharp."""
    flat, scale = flattened(photographed(checkered=True), tmp_path)
    cell = scale / CELLS
    assert np.mean((flat > 0.2) & (flat < 0.8)) < 0.06
    assert flat.mean() == pytest.approx(0.5, abs=0.1)
    near = round(cell)
    for axis in (0, 1):
        across = np.moveaxis(flat, axis, 0) > 0.5
        borders = np.mean(across[1:] != across[:-1])
        assert 0.9 < borders * cell < 1.3
        # a cell further is the other colour
        assert np.mean(across[near:] == across[:-near]) < 0.3
