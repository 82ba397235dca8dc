"""Surfaces in photographs: patches, Jacobians, invalid files."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import texloom
from tests.photographs import homography, unit_square
from tests.synthetic import picture
from texloom.stages.analysis.photographs.gaussian_stack import GaussianStackParams, gaussian_stack
from texloom.stages.analysis.photographs.geometry import parsed_geometry
from texloom.stages.analysis.photographs.jacobian_field import (
    JacobianField,
    JacobianFieldParams,
    check_geometry,
    jacobian_field,
    outlines,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Document, InputError
from texloom.stages.vocabulary.sizes import size_value

SHAPE = (96, 128)
CORNERS = [[20.0, 30.0], [25.0, 95.0], [90.0, 120.0], [85.0, 5.0]]
PLANE = {"corners": CORNERS, "size": "3x2"}
FLAT = {"corners": [[0, 0], [0, 127], [95, 127], [95, 0]], "size": "127x95"}


def grey(shape: tuple[int, int] = SHAPE) -> Image:
    return picture(np.full((*shape, 3), 0.5))


def filed(folder: Path, *patches: Any, **more: Any) -> Path:
    path = folder / "geometry.json"
    path.write_text(json.dumps({"patches": patches, **more}))
    return path


def field(folder: Path, *patches: Any, **more: Any) -> JacobianField:
    return jacobian_field(grey(), JacobianFieldParams(geometry=filed(folder, *patches, **more), detail=1.0))


@pytest.mark.parametrize("size", [(1.0, 3.0), (3.0, 2.0), (1.0, 1.0)])
def test_cells_of_the_drawn_grid_are_square_in_the_texture(tmp_path: Path, size: list[float]) -> None:
    shape = (round(480 * size[0]), round(480 * size[1]))
    bottom, right = shape[0] - 1, shape[1] - 1
    patch = {"corners": [[0, 0], [0, right], [bottom, right], [bottom, 0]], "size": size_value(size)}
    params = JacobianFieldParams(geometry=filed(tmp_path, patch))
    color = jacobian_field(grey(shape), params).grid.color
    # lines across are green, those down are red; between them is the photograph
    rows = np.flatnonzero((color[..., 1] > color[..., 0] + 0.2).mean(axis=1) > 0.5)
    columns = np.flatnonzero((color[..., 0] > color[..., 1] + 0.2).mean(axis=0) > 0.5)
    steps = [line[1] - line[0] for part in (rows, columns) for line in [part[np.append(True, np.diff(part) > 3)]]]
    assert abs(steps[0] - steps[1]) <= 3
    assert steps[0] == pytest.approx(max(shape) / 8, abs=3)


def unscaled(result: JacobianField) -> np.ndarray:
    return result.jacobian.astype(np.float64) * result.scale


def analytic(corners: list[list[float]], size: list[float]) -> np.ndarray:
    """By differences of the homography, all pixels at once."""
    matrix = homography(corners)
    u, v = np.moveaxis(unit_square(corners, *np.indices(SHAPE)), 2, 0)

    def pixel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        point = np.stack([a, b, np.ones(SHAPE)], axis=2) @ matrix.T
        return np.asarray(point[..., :2] / point[..., 2:])

    e = 1e-4
    by_u = (pixel(u + e, v) - pixel(u - e, v)) / (2 * e * size[0])
    by_v = (pixel(u, v + e) - pixel(u, v - e)) / (2 * e * size[1])
    return np.stack([by_u[..., 0], by_v[..., 0], by_u[..., 1], by_v[..., 1]], axis=2)


def test_a_plane_is_its_homography(tmp_path: Path) -> None:
    result = field(tmp_path, PLANE)
    wanted = analytic(CORNERS, [2.0, 3.0])
    inside = result.region
    assert np.count_nonzero(inside) > 4000
    np.testing.assert_allclose(unscaled(result)[inside], wanted[inside], rtol=2e-5, atol=2e-5)


def test_a_plane_by_control_points_is_the_plane_by_corners(tmp_path: Path) -> None:
    points, weights = texloom.control_points(CORNERS)
    np.testing.assert_allclose(points[[0, 0, 3, 3], [0, 3, 3, 0]], CORNERS, atol=1e-9)
    curved = {"controls": points.tolist(), "weights": weights.tolist(), "size": "3x2"}
    one, other = field(tmp_path, PLANE), field(tmp_path, curved)
    np.testing.assert_array_equal(one.region, other.region)
    np.testing.assert_allclose(one.jacobian, other.jacobian, rtol=1e-6, atol=1e-6)
    # and so it is with weights that follow from the corners
    del curved["weights"]
    np.testing.assert_allclose(one.jacobian, field(tmp_path, curved).jacobian, rtol=1e-6, atol=1e-6)


def test_the_size_of_the_jacobians_is_told_before_they_are_computed(tmp_path: Path) -> None:
    told = outlines(JacobianFieldParams(), {"image": grey()})["jacobian"]
    assert (told.height, told.width) == field(tmp_path, PLANE).jacobian.shape[:2]


def test_a_frontal_plane_is_not_distorted(tmp_path: Path) -> None:
    result = field(tmp_path, FLAT)
    assert result.region.all()
    np.testing.assert_allclose(result.jacobian, np.broadcast_to([1, 0, 0, 1], (*SHAPE, 4)), atol=1e-5)
    np.testing.assert_allclose(result.level, 0, atol=1e-5)
    assert result.scale == pytest.approx(1)
    np.testing.assert_array_equal(jacobian_field(grey(), JacobianFieldParams()).jacobian, result.jacobian)


def seen(
    size: tuple[float, float], tilt: float, turn: float, place: tuple[float, float, float], focal: float = 150.0
) -> list[Any]:
    """Corners of a rectangle that is tilted away from the viewer, through a lens whose focal length is in px."""
    about = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    about = about @ np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    down, across = size
    sides = np.array([[-down, -across, 0], [-down, across, 0], [down, across, 0], [down, -across, 0]]) / 2
    points = sides @ about.T + np.array(place)
    return (focal * points[:, :2] / points[:, 2:] + [47.5, 63.5]).tolist()


def test_the_aspect_ratio_is_found_in_one_view(tmp_path: Path) -> None:
    corners = seen((2, 3), 0.7, 0.4, (0, 0, 6))
    measured = field(tmp_path, {"corners": corners}).jacobian
    known = field(tmp_path, {"corners": corners, "size": "3x2"}).jacobian
    np.testing.assert_allclose(measured, known, rtol=1e-3)


def test_planes_without_sizes_have_one_unit(tmp_path: Path) -> None:
    """A wall and the ground that meet at an edge, and another part of the wall."""

    def corners(points: list[tuple[float, float, float]]) -> list[list[float]]:
        """Seen askew, from a distance of 7."""
        (a, b), (c, d) = np.cos([0.5, 0.6]), np.sin([0.5, 0.6])
        turn = np.array([[a, 0, c], [0, 1, 0], [-c, 0, a]]) @ np.array([[1, 0, 0], [0, b, d], [0, -d, b]])
        turned = (np.array(points) - [0, 0, 5.5]) @ turn + [0, 0, 7]
        return (100 * turned[:, :2] / turned[:, 2:] + [47.5, 63.5]).tolist()

    wall = [(-1.0, -1.5, 6.0), (-1.0, 0.5, 6.0), (1.0, 0.5, 6.0), (1.0, -1.5, 6.0)]
    ground = [(1.0, -1.5, 6.0), (1.0, 0.5, 6.0), (1.0, 0.5, 4.5), (1.0, -1.5, 4.5)]
    beside = [(-1.0, 0.7, 6.0), (-1.0, 1.7, 6.0), (1.0, 1.7, 6.0), (1.0, 0.7, 6.0)]
    sizes = ([2, 2], [1.5, 2], [2, 1])
    quads = [corners(points) for points in (wall, ground, beside)]
    known = field(
        tmp_path, *({"corners": quad, "size": size_value(size)} for quad, size in zip(quads, sizes, strict=True))
    )
    measured = field(tmp_path, *({"corners": quad} for quad in quads))
    inside = known.region
    np.testing.assert_allclose(measured.jacobian[inside], known.jacobian[inside], rtol=0.01, atol=0.01)


def test_each_pair_of_patches_is_compared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """To find where they meet; 256 patches took minutes and a gigabyte."""
    places = [(row, column) for row in range(4) for column in range(4)]
    patches = [
        {"corners": [[y, x], [y, x + 20], [y + 20, x + 20], [y + 20, x]]}
        for y, x in np.multiply(places, 25).tolist()
    ]
    calls, hypot = [], np.hypot
    monkeypatch.setattr(np, "hypot", lambda *args: (calls.append(args[0].shape), hypot(*args))[1])
    parsed_geometry({"patches": patches}, (120, 120), {})
    assert calls.count((100, 100)) == 16 * 15 // 2  # points of two outlines


def test_patches_have_one_focal_length(tmp_path: Path) -> None:
    """A plane whose sides converge gives the lens to one whose sides are parallel in the photograph."""
    tilted = seen((2, 3), 0.7, 0.4, (0, -1, 6), 90)
    parallel = seen((2, 2), 0.9, 0.0, (0, 2, 6), 90)
    wall, ground = {"corners": tilted, "size": "3x2"}, {"corners": parallel, "edge": 2}
    measured = field(tmp_path, wall, ground).jacobian
    known = field(tmp_path, wall, {"corners": parallel, "size": "2x2"}).jacobian
    np.testing.assert_allclose(measured, known, rtol=1e-2)
    alone = field(tmp_path, ground).jacobian
    assert np.abs(alone[48, 100] / alone[48, 100, 3] - known[48, 100] / known[48, 100, 3]).max() > 0.1


def test_a_cylinder_is_passed_at_even_speed(tmp_path: Path) -> None:
    """A column of radius 1 that is 4 away: on its surface texture has the same size everywhere."""
    focal, half = 1.2 * 128, 0.9
    bow = 4 / 3 * np.tan(half / 2)
    ends = np.array([[-np.sin(half), -np.cos(half)], [np.sin(half), -np.cos(half)]])
    along = bow * np.array([[np.cos(half), -np.sin(half)], [np.cos(half), np.sin(half)]])
    arc = np.array([ends[0], ends[0] + along[0], ends[1] - along[1], ends[1]])  # across and depth
    space = np.array([[[down, x, 4 + z] for x, z in arc] for down in np.linspace(-0.9, 0.9, 4)])
    pixels = focal * space[..., :2] / space[..., 2:] + [47.5, 63.5]
    patch = {"controls": pixels.tolist(), "weights": space[..., 2].tolist(), "size": size_value((1.8, 2 * half))}
    result = unscaled(field(tmp_path, patch))[48]
    columns = np.arange(35, 93)
    # the angle around the column at which each pixel's ray meets it
    slope = (columns - 63.5) / focal
    depth = (4 - np.sqrt(16 - 15 * (1 + slope**2))) / (1 + slope**2)
    angle = np.arctan2(slope * depth, 4 - depth)
    # what a step along the surface is in the picture
    rate = focal * (np.cos(angle) * depth - slope * depth * np.sin(angle)) / depth**2
    np.testing.assert_allclose(result[columns, 3], rate, rtol=0.02)
    np.testing.assert_allclose(result[columns, 0], focal / depth, rtol=0.02)


def test_overlaps_are_averaged_and_gaps_are_filled(tmp_path: Path) -> None:
    left = {"corners": [[0, 0], [0, 70], [95, 70], [95, 0]], "size": "70x95"}
    right = {"corners": [[0, 50], [0, 100], [95, 100], [95, 50]], "size": "25x95"}
    result = unscaled(field(tmp_path, left, right))
    np.testing.assert_allclose(result[50, 20, 3], 1, rtol=1e-4)
    np.testing.assert_allclose(result[50, 90, 3], 2, rtol=1e-4)
    np.testing.assert_allclose(result[50, 60, 3], 1.5, rtol=1e-4)
    assert np.isfinite(result).all()
    assert 1 < result[50, 127, 3] < 2.3


def test_extrapolation_keeps_constants(tmp_path: Path) -> None:
    patch = {"corners": [[30, 20], [30, 71], [70, 71], [70, 20]], "size": "51x40"}
    result = field(tmp_path, patch)
    assert not result.region.all()
    np.testing.assert_allclose(result.jacobian, np.broadcast_to([1, 0, 0, 1], (*SHAPE, 4)), atol=1e-4)


def test_threads_do_not_matter(tmp_path: Path, on_threads: Any) -> None:
    np.testing.assert_array_equal(*on_threads(lambda: field(tmp_path, PLANE).jacobian))


@pytest.mark.parametrize(
    ("patch", "said"),
    [
        ({"corners": [CORNERS[i] for i in (0, 2, 1, 3)], "name": "wall"}, "patch 'wall': the corners are crossed"),
        ({"corners": CORNERS[::-1]}, r"patch 'patches\[0\]': the corners run anticlockwise"),
        ({"corners": [[20, 20], [20, 100], [90, 100], [30, 90]]}, "crosses the horizon"),
        ({**PLANE, "beyond": 40}, "crosses the horizon"),
        ({"corners": [[0, 0], [0, 10], [0, 20], [20, 0]]}, "are collinear"),
        ({"corners": [[500, 500], [500, 600], [600, 600], [600, 500]]}, "is outside the photograph"),
        ({"corners": CORNERS[:3]}, r"patches\.0\.corners\.3: Field required"),
        ({**PLANE, "size": "1x0"}, r"patches\.0\.size: the height should be greater than 0, got 0"),
        (
            {**PLANE, "size": [10, 13.2]},
            r"patches\.0\.size: .* got the list \[10, 13\.2\]; write 13\.2x10 or 10x13\.2",
        ),
        ({**PLANE, "size": "3 x 2"}, r"patches\.0\.size: must be N or WIDTHxHEIGHT, as 2 or 13\.2x10, got '3 x 2'"),
        ({**PLANE, "size": "1x0.0001"}, "size: one side is more than 1000 times as long as the other"),
        ({**PLANE, "colour": 1}, r"patches\.0\.colour: no such entry"),
        ({"controls": [[[0.0, 0.0]] * 4] * 4}, "have no area"),
        ({}, "want either corners or controls"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(tmp_path: Path, patch: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        field(tmp_path, patch)
    assert "\n" not in str(caught.value)


def test_a_patch_that_folds_over(tmp_path: Path) -> None:
    controls = [[[10.0 + 25 * i, 10.0 + 30 * j] for j in range(4)] for i in range(4)]
    for row in controls:
        row[1], row[2] = [row[1][0], 140.0], [row[2][0], -30.0]
    with pytest.raises(InputError, match="patch 'bark': the surface folds over"):
        field(tmp_path, {"controls": controls, "name": "bark"})


def test_regions(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"region \(patch 'patches\[0\]'\): 0 px remain"):
        field(tmp_path, PLANE, without=[[[-9, -9], [-9, 200], [200, 200], [200, -9]]])
    params = JacobianFieldParams(geometry=filed(tmp_path, PLANE))
    with pytest.raises(InputError, match="region: 10 x 10 px; must have the size"):
        jacobian_field(grey(), params, grey((10, 10)))
    assert jacobian_field(grey(), params, picture(np.ones(SHAPE))).region.all()


def test_a_flat_stack_is_gaussian(tmp_path: Path) -> None:
    from scipy.ndimage import gaussian_filter

    surface = field(tmp_path, FLAT)
    noise = picture(np.random.default_rng(2).random((*SHAPE, 3)))
    result = gaussian_stack(
        noise, surface.jacobian, surface.level, surface.region, GaussianStackParams(max_levels=3, min_whole=0.15)
    )
    assert len(result.stack) == 3
    inner = (slice(20, -20), slice(20, -20))
    for level in (1, 2):
        sigma = 0.6 * np.sqrt(4.0**level - 1)
        wanted = lab_from_linear(gaussian_filter(noise.pixels, (sigma, sigma, 0))[inner])[..., 0]
        assert np.corrcoef(result.stack[level][inner][..., 0].ravel(), wanted.ravel())[0, 1] > 0.98
    np.testing.assert_array_equal(result.sharp.pixels, noise.pixels)


def test_far_places_are_only_in_coarse_levels(tmp_path: Path) -> None:
    path = filed(tmp_path, {"corners": [[10, 50], [10, 78], [95, 127], [95, 0]], "size": "1x1"})
    params = GaussianStackParams(max_levels=3, min_whole=0.15)
    near = jacobian_field(grey(), JacobianFieldParams(geometry=path, detail=0.2))
    assert near.level[15, 64] > near.level[90, 64]
    result = gaussian_stack(grey(), near.jacobian, near.level, near.region, params)
    assert (result.valid[:-1] <= result.valid[1:]).all()
    assert not result.valid[0, 15, 64]


def test_a_region_without_neighbourhoods(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"region \(patch 'patches\[0\]'\): does not contain a square of 7 x 7 px"):
        field(tmp_path, FLAT, region=[[[0, 0], [0, 127], [2, 127], [2, 0]]])
    surface = field(tmp_path, FLAT, region=[[[0, 0], [0, 127], [8, 127], [8, 0]]])
    surface = dataclasses.replace(surface, jacobian=surface.jacobian * 2)
    with pytest.raises(InputError, match="fewer than 16 whole neighbourhoods"):
        gaussian_stack(grey(), surface.jacobian, surface.level, surface.region, GaussianStackParams())


def test_areas_may_be_pictures(tmp_path: Path) -> None:
    import cv2

    area = np.zeros(SHAPE, np.uint8)
    area[30:80, 40:90] = 255
    cv2.imwrite(str(tmp_path / "area.png"), area)
    result = field(
        tmp_path, FLAT, region="area.png", features={"dots": "area.png", "band": [[[0, 0], [0, 9], [9, 9]]]}
    )
    np.testing.assert_array_equal(result.region, area > 0)
    np.testing.assert_array_equal(result.features[0], area > 0)
    assert result.features.shape == (2, *SHAPE)
    assert result.features[1, 2, 5]
    assert not result.features[1, 5, 2]
    cv2.imwrite(str(tmp_path / "other.png"), area[:50])
    for content, said in (
        (
            {"region": "other.png"},
            r"region: other\.png: 128 x 50 px; must have the size of the photograph, 128 x 96 px",
        ),
        ({"hole": "area"}, r"hole: 'area' is not the name of an image"),
        ({"features": "area.png"}, r"features: Input should be a valid dictionary"),
    ):
        with pytest.raises(InputError, match=said):
            field(tmp_path, FLAT, **content)
    (tmp_path / "area.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"region: area\.png: is not a readable image"):
        field(tmp_path, FLAT, region="area.png")


@pytest.mark.parametrize(
    "name", ["coffee", "coffee_hole", "coffee_table", "lund_street", "gourds", "squirrel_trunk"]
)
def test_the_files_that_come_along_can_be_read(name: str) -> None:
    from texloom.pipelines.yaml import read_document

    path = Path(__file__).parents[3] / "configs" / "photographs" / f"{name}.yaml"
    params = JacobianFieldParams(geometry=Document.of(path, read_document(path)))
    check_geometry(params, {"image": grey((768, 1024))})
