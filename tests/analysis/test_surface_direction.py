from __future__ import annotations

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from texloom.pipelines.media.shapes import terrain, torus
from texloom.stages.analysis.surface_direction import SurfaceDirectionParams, surface_direction
from texloom.stages.common.surface.mesh import with_normals


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
