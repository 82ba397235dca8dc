from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from tests.synthetic import picture
from texloom.pipelines.media.shapes import blob, torus
from texloom.stages.analysis.surfaces.surface_control import SurfaceControlParams, surface_control
from texloom.stages.common.features.control import painted_values
from texloom.stages.common.surface.mesh import with_normals
from texloom.stages.vocabulary.declare import InputError

GREY = picture(np.full((8, 8), 0.5))


def made(mesh: np.ndarray, geometry: str, **params: object) -> np.ndarray:
    checked = SurfaceControlParams.model_validate({"geometry": geometry, **params})
    image = surface_control(with_normals(mesh), 64, 64, checked, control=GREY).image
    assert image is not None
    assert image.channels == ("Y",)
    return painted_values(image)[..., 0]


def test_up_and_height() -> None:
    rows = 2 * np.pi * (np.arange(64) + 0.5) / 64
    around = np.tile(0.5 - 0.5 * np.sin(rows)[:, None], (1, 64))  # v grows upwards
    np.testing.assert_allclose(made(torus(), "up"), around, atol=0.02)
    np.testing.assert_allclose(made(torus(), "height"), around, atol=0.02)
    np.testing.assert_allclose(made(square(), "up"), 0.5, atol=1e-3)
    np.testing.assert_allclose(
        made(square(), "height", up="x"), np.tile((np.arange(64) + 0.5) / 64, (64, 1)), atol=1e-3
    )


def test_slope() -> None:
    rows = 2 * np.pi * (np.arange(64) + 0.5) / 64
    wanted = np.minimum(np.abs((rows - 1.5 * np.pi + np.pi) % (2 * np.pi) - np.pi) / (np.pi / 2), 1)
    np.testing.assert_allclose(made(torus(), "slope"), np.tile(wanted[:, None], (1, 64)), atol=0.03)


def test_the_mesh_s_own_values() -> None:
    mesh = square()
    with pytest.raises(InputError, match="has no control of its own"):
        made(mesh, "vertices")
    mesh[:, 11] = mesh[:, 0]
    np.testing.assert_allclose(made(mesh, "vertices"), np.tile((np.arange(64) + 0.5) / 64, (64, 1)), atol=1e-3)


def test_curvature_of_a_cylinder_and_a_square() -> None:
    """Half of 1 / radius, times the mesh's radius, 2 ** 0.5, and a tenth."""
    inner = np.s_[16:48, 8:56]
    np.testing.assert_allclose(made(cylinder(cells=128), "curvature")[inner], 0.5 + 0.05 * 2**0.5 / 2, atol=0.02)
    np.testing.assert_allclose(made(square(), "curvature"), 0.5, atol=1e-3)


def test_the_hole_of_a_torus_is_darker_and_curved_inwards() -> None:
    open_ = made(torus(tube=0.7), "ao")
    outside, inside = open_[[0, -1]], open_[31:33]
    assert outside.min() > 0.95
    assert inside.max() < 0.75
    curved = made(torus(tube=0.7), "curvature")
    assert curved[31:33].mean() < curved[[0, -1]].mean()


def test_nothing_hides_a_convex_mesh() -> None:
    assert made(cylinder(), "ao").min() > 0.9


def test_what_is_not_asked_for_is_passed_on() -> None:
    mesh = with_normals(square())
    assert surface_control(mesh, 8, 8, SurfaceControlParams()).image is None
    passed = surface_control(mesh, 8, 8, SurfaceControlParams(), control=GREY, picture=GREY).image
    assert passed is GREY


@pytest.mark.parametrize(("geometry", "names"), [(None, ["control"]), (None, ["picture"]), ("ao", [])])
def test_one_control_map_without_the_other_is_refused(geometry: str | None, names: list[str]) -> None:
    with pytest.raises(InputError, match=r"control: .*goes with"):
        surface_control(
            with_normals(square()), 8, 8, SurfaceControlParams.model_validate({"geometry": geometry}),
            **dict.fromkeys(names, GREY),
        )  # fmt: skip


def test_any_number_of_threads_gives_the_same_bits(
    on_threads: Callable[[Callable[[], np.ndarray]], tuple[np.ndarray, np.ndarray]],
) -> None:
    mesh = blob(2)
    mesh[:, 6:8] = np.random.default_rng(1).random((len(mesh), 2))
    np.testing.assert_array_equal(*on_threads(lambda: made(mesh, "ao", directions=8)))
