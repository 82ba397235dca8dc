"""Geometry of faces in a texture, welding, gutters, and links of texels beside charts."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from texloom.stages.common.surface.faces import Faces, pixels_of
from texloom.stages.common.surface.gutters import nearest_known
from texloom.stages.common.surface.texels import Texels, texels_of
from texloom.stages.common.surface.unwrap import unwrapped
from texloom.stages.common.surface.weld import weld
from texloom.stages.kernels.surface.links import carry

SIZE = (24, 40)


def faces_of(mesh: np.ndarray, scale: float = 1.0) -> Faces:
    return Faces(mesh, np.tile(np.array([0, -1, 0], np.float32), (len(mesh), 1)), SIZE, scale)


def test_rows_and_columns_of_corners() -> None:
    mesh = square()
    np.testing.assert_allclose(pixels_of(mesh, SIZE)[0, 0], [SIZE[0] - 0.5, -0.5])


def test_what_there_is_on_a_face(rng: np.random.Generator) -> None:
    """Of a square of 2 x 2 units on 24 x 40 px, and texture of half a unit."""
    faces = faces_of(square(2.0), 0.5)
    places = rng.uniform(2, 20, (5, 2))
    owner = np.array([np.flatnonzero(_inside(faces.pixels, place))[0] for place in places])
    points = faces.at(owner, places)
    np.testing.assert_allclose(points.position[:, 0], (places[:, 1] + 0.5) / 40 * 2)
    np.testing.assert_allclose(points.position[:, 1], 2 - (places[:, 0] + 0.5) / 24 * 2)
    np.testing.assert_allclose(points.texture, np.tile([[0, -2.0, 0], [2.0, 0, 0]], (5, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(
        points.to_pixels @ points.per_pixel, np.tile(np.eye(3)[:, :2], (5, 1, 1)), atol=1e-12
    )
    wanted = [0.5 * 24 / 2, 0, 0, 0.5 * 40 / 2]
    np.testing.assert_allclose(faces.jacobians(owner, places), np.tile(wanted, (5, 1)), atol=1e-5)


def _inside(pixels: np.ndarray, place: np.ndarray) -> np.ndarray:
    turns = []
    for corner in range(3):
        along, to = pixels[:, (corner + 1) % 3] - pixels[:, corner], place - pixels[:, corner]
        turns.append(along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0])
    return np.asarray((np.array(turns) >= 0).all(axis=0) | (np.array(turns) <= 0).all(axis=0))


def test_a_direction_along_the_normal_leaves_that_of_the_texture() -> None:
    mesh = square()
    faces = Faces(mesh, np.tile(np.array([0, 0, 1], np.float32), (len(mesh), 1)), SIZE, 1.0)
    np.testing.assert_allclose(
        faces.at(np.array([0]), np.array([[2.0, 2.0]])).texture[0, 0], [0, -1, 0], atol=1e-12
    )


def test_faces_without_area_are_not_usable() -> None:
    mesh = square()
    mesh[0:3, 6:8] = 0.5
    mesh[3:6, :3] = 0
    np.testing.assert_array_equal(faces_of(mesh).usable, [False, False, *[True] * 6])


def test_equal_rows_are_welded(rng: np.random.Generator) -> None:
    rows = rng.integers(-2, 3, (200, 3)).astype(np.float32)
    rows[rows == 0] *= rng.choice([-1, 1], (rows == 0).sum())
    _, wanted = np.unique(rows + 0.0, axis=0, return_inverse=True)
    same = weld(rows)[:, None] == weld(rows)
    np.testing.assert_array_equal(same, wanted.ravel()[:, None] == wanted.ravel())


def test_gutters_have_the_nearest_pixel(rng: np.random.Generator) -> None:
    known = rng.random((12, 15)) < 0.1
    index = nearest_known(known)
    rows, columns = np.nonzero(known)
    for (row, column), chosen in np.ndenumerate(index):
        distance = np.hypot(rows - row, columns - column)
        there = divmod(int(chosen), 15)
        assert known[there]
        assert np.hypot(there[0] - row, there[1] - column) <= distance.min() * 1.05


@pytest.mark.parametrize("number", [0, 1, 2])
def test_texels_beside_a_cylinder_are_those_of_its_other_side(number: int) -> None:
    mesh = cylinder((0, 1), cells=40)
    level = texels_of(faces_of(mesh, 0.1), np.zeros(len(mesh) // 3, np.int32), 3)[number]
    height, width = (side // 2**number for side in SIZE)
    rows, columns = level.in_result(level.flat, level.place).T
    assert (len(rows), rows.max(), columns.max()) == (height * width, height - 1, width - 1)
    targets = level.in_result(level.links.targets, level.link_place)
    sources = level.in_result(level.links.sources, level.link_place)
    beside = (targets[:, 0] >= 0) & (targets[:, 0] < height)
    np.testing.assert_array_equal(sources[beside], targets[beside] % [1000, width])
    np.testing.assert_array_equal(level.links.offsets[beside], 0)
    assert len(targets) == 2 * (height + width + 2)


def test_a_chart_smaller_than_a_texel_has_one() -> None:
    levels: list[Texels] = texels_of(faces_of(square(1.0, (0.5, 0.55))), np.zeros(8, np.int32), 6)
    assert all(level.flat.size for level in levels)
    for finer, coarser in itertools.pairwise(levels):
        rows, columns = finer.in_result(finer.flat, finer.place).T >> 1
        known = np.concatenate([coarser.flat, coarser.links.targets])
        assert np.isin(coarser.tiles.flat(finer.place, rows, columns), known).all()


def test_positions_are_carried_by_offsets_in_texture() -> None:
    """Into an exemplar that is twice as wide as its texture."""
    jacobian = np.tile(np.array([1, 0, 0, 2], np.float32), (100, 1))
    states = np.array([3 * 256 << 32 | 4 * 256, -1, -1], np.int64)
    offsets = np.array([[1, 1], [-0.5, 0.25]], np.float32)
    carry(states, np.array([1, 2]), np.array([0, 0]), offsets, jacobian, 10, 10, 0, 2)
    assert states[1] == (4 * 256 << 32 | 6 * 256)
    assert states[2] == (640 << 32 | 4 * 256 + 128)


def test_modules_of_the_working_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    points, normals = np.eye(3, dtype=np.float32), np.ones((3, 3), np.float32)
    assert unwrapped(points, normals, np.array([[0, 1, 2]], np.uint32), 64).shape == (3, 2)
