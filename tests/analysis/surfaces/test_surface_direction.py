from __future__ import annotations

import numpy as np
import pytest

from tests.surfaces import cylinder, grid, square
from texloom.pipelines.media.shapes import terrain, torus
from texloom.stages.analysis.surfaces.surface_direction import SurfaceDirectionParams, surface_direction
from texloom.stages.common.features.control import from_painted
from texloom.stages.common.surface.mesh import with_normals
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def direction(mesh: np.ndarray, **params: object) -> np.ndarray:
    return surface_direction(with_normals(mesh), SurfaceDirectionParams(**params)).direction


@pytest.mark.parametrize("field", ["smooth", "texture"])
def test_on_a_wall_texture_points_down(field: str) -> None:
    for mesh in (square(), cylinder()):
        np.testing.assert_allclose(direction(mesh, field=field), np.tile([0, -1, 0], (len(mesh), 1)), atol=0.05)


def test_a_turn_is_counter_clockwise_seen_from_outside() -> None:
    np.testing.assert_allclose(direction(square(), turn=90), np.tile([1, 0, 0], (24, 1)), atol=1e-6)


def test_another_axis_may_point_up() -> None:
    np.testing.assert_allclose(direction(square(), up="x"), np.tile([-1, 0, 0], (24, 1)), atol=1e-6)


@pytest.mark.parametrize("mesh", [torus(24, 12), terrain(16)], ids=["torus", "terrain"])
def test_it_lies_in_the_surface_and_is_the_same_at_a_vertex(mesh: np.ndarray) -> None:
    whole = with_normals(mesh)
    made = surface_direction(whole, SurfaceDirectionParams()).direction
    np.testing.assert_allclose(np.linalg.norm(made, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(np.einsum("ni,ni->n", made, whole[:, 3:6]), 0, atol=1e-5)


def test_on_terrain_it_hardly_turns() -> None:
    made = direction(terrain(16))
    assert (made @ made.mean(axis=0) > 0.7).all()


def test_columns_run_where_the_surface_bends_least() -> None:
    """Around the hole of a torus, and along a cylinder that lies, in one sense."""
    mesh = torus(48, 24)
    ring = mesh[:, :3] * [1, 0, 1]
    around = np.cross([0, 1, 0], ring / np.linalg.norm(ring, axis=1, keepdims=True))
    made = direction(mesh, field="curvature")
    assert np.median(np.abs(np.einsum("ni,ni->n", made, around))) > 0.97
    lying = cylinder()
    lying[:, :3] = lying[:, [1, 0, 2]] * [-1, 1, 1]
    made = direction(lying, field="curvature")
    inside = np.abs(lying[:, 0]) < 0.5
    np.testing.assert_allclose(np.abs(made[inside, 0]), 1, atol=0.05)
    assert abs(made[inside, 0].mean()) > 0.9


def test_vectors_of_the_mesh_lead() -> None:
    mesh = plane(24)
    right = mesh[:, 0] > 0.5
    mesh[right, 8:11] = [1, 0, 0.5]
    made = surface_direction(mesh, SurfaceDirectionParams()).direction
    assert made[mesh[:, 0] > 0.6] == pytest.approx(np.tile([-1, 0, 0], ((mesh[:, 0] > 0.6).sum(), 1)), abs=0.1)
    assert made[mesh[:, 0] < 0.1] == pytest.approx(np.tile([0, -1, 0], ((mesh[:, 0] < 0.1).sum(), 1)), abs=0.2)


def test_arrows_lead_where_they_are_painted() -> None:
    """To the right in the right half of the square, to the left they lead nowhere."""
    mesh, pixels = plane(24), np.full((64, 64, 3), 0.5, np.float32)
    pixels[:, 40:] = (1.0, 0.5, 0.5)
    arrows = from_painted(pixels, ("R", "G", "B"))
    made = surface_direction(mesh, SurfaceDirectionParams(), arrows=arrows).direction
    np.testing.assert_allclose(made[mesh[:, 0] > 0.8], np.tile([-1, 0, 0], ((mesh[:, 0] > 0.8).sum(), 1)), atol=0.1)
    np.testing.assert_allclose(made[mesh[:, 0] < 0.1], np.tile([0, -1, 0], ((mesh[:, 0] < 0.1).sum(), 1)), atol=0.2)


def test_columns_run_along_strokes() -> None:
    mesh, pixels = plane(24), np.zeros((64, 64, 1), np.float32)
    np.fill_diagonal(pixels[..., 0], 1)
    strokes = Image(pixels, ("Y",))
    made = surface_direction(mesh, SurfaceDirectionParams(), strokes=strokes).direction
    near = np.abs(mesh[:, 0] + mesh[:, 1] - 1) < 0.1
    np.testing.assert_allclose(made[near], np.tile([0.5**0.5, -(0.5**0.5), 0], (near.sum(), 1)), atol=0.15)


def test_empty_strokes_are_refused() -> None:
    with pytest.raises(InputError, match="nothing is painted"):
        surface_direction(
            plane(2), SurfaceDirectionParams(), strokes=Image(np.zeros((8, 8, 1), np.float32), ("Y",))
        )


def plane(cells: int) -> np.ndarray:
    v, u = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    return with_normals(grid(np.stack([u, v, np.zeros_like(u)], axis=2), u, v))
