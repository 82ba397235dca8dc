from __future__ import annotations

import numpy as np

from texloom.stages.kernels.surface.raster import draw


def naive(corners: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The first of the nearest triangles at every pixel's centre."""
    owner, depth = np.full(size, -1, np.int32), np.full(size, np.inf, np.float32)
    for row, column in np.ndindex(size):
        for face, points in enumerate(corners):
            matrix = np.column_stack([points[1, :2] - points[0, :2], points[2, :2] - points[0, :2]])
            one, two = np.linalg.solve(matrix, [row - points[0, 0], column - points[0, 1]])
            shares = np.array([1 - one - two, one, two])
            if shares.min() >= 0 and np.float32(shares @ points[:, 2]) < depth[row, column]:
                owner[row, column], depth[row, column] = face, shares @ points[:, 2]
    return owner


def drawn(corners: np.ndarray, size: tuple[int, int], origin: tuple[int, int] = (0, 0)) -> tuple[np.ndarray, int]:
    owner, depth = np.full(size, -1, np.int32), np.full(size, np.inf, np.float32)
    again = draw(corners, np.arange(len(corners)), *origin, owner, depth)
    return owner, again


def test_as_the_naive_twin(rng: np.random.Generator) -> None:
    corners = rng.uniform(-4, 24, (30, 3, 3))
    np.testing.assert_array_equal(drawn(corners, (16, 20))[0], naive(corners, (16, 20)))


def test_an_origin_moves_the_picture(rng: np.random.Generator) -> None:
    corners = rng.uniform(0, 24, (5, 3, 3))
    whole, _ = drawn(corners, (24, 24))
    np.testing.assert_array_equal(drawn(corners, (10, 8), (5, 7))[0], whole[5:15, 7:15])


def test_a_mesh_without_gaps_covers_each_pixel_once() -> None:
    corners = np.array(
        [[[-0.5, -0.5, 0], [7.5, -0.5, 0], [7.5, 7.5, 0]], [[-0.5, -0.5, 0], [7.5, 7.5, 0], [-0.5, 7.5, 0]]]
    )
    owner, again = drawn(corners, (8, 8))
    assert (owner >= 0).all()
    assert again == 0
    assert drawn(np.concatenate([corners, corners]), (8, 8))[1] > 40
