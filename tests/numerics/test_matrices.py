"""Algebra in one order, beside LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from texloom.stages.numerics.matrices import (
    cubic_spline,
    determinant,
    eigenvectors,
    inverse_of,
    least_squares,
    length_of,
    matrix_product,
    pseudo_inverse,
    rank,
    row_product,
    solve,
    solve_symmetric,
    square_sums,
)


@pytest.mark.parametrize(
    ("first", "second"),
    [((3,), (3,)), ((5, 3), (3,)), ((3,), (3, 2)), ((5, 3), (3, 2)), ((4, 5, 3), (3, 2)), ((4, 5, 3), (4, 3, 2)),
     ((6, 5, 3), (3,))],
)  # fmt: skip
def test_products_are_those_of_numpy(
    first: tuple[int, ...], second: tuple[int, ...], rng: np.random.Generator
) -> None:
    one, other = rng.integers(-9, 10, first), rng.integers(-9, 10, second)
    np.testing.assert_array_equal(matrix_product(one, other), one @ other)
    np.testing.assert_array_equal(matrix_product(one * 0.5, other * 0.5), one @ other / 4)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("count", [0, 1, 600, 5001])
def test_products_of_rows_are_made_of_all(count: int, kind: type, rng: np.random.Generator) -> None:
    rows, basis = (rng.integers(-9, 10, shape).astype(kind) for shape in ((count, 50), (50, 17)))
    found = row_product(rows, basis)
    assert found.dtype == kind
    np.testing.assert_array_equal(found, rows @ basis)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize(("count", "width"), [(1, 1), (5, 16), (6, 17), (103, 8), (200, 40)])
def test_products_of_rows_are_added_in_order_and_not_fused(
    count: int, width: int, kind: type, rng: np.random.Generator
) -> None:
    rows, basis = (rng.normal(size=shape).astype(kind) for shape in ((count, 51), (51, width)))
    total = np.zeros((count, width), kind)
    for column, line in zip(rows.T, basis, strict=True):
        total += column[:, None] * line
    np.testing.assert_array_equal(row_product(rows, basis), total)


@pytest.mark.parametrize("shape", [(0, 3), (1, 5), (131, 20)])
def test_square_sums(shape: tuple[int, int], rng: np.random.Generator) -> None:
    sample = rng.integers(-9, 10, shape)
    np.testing.assert_array_equal(square_sums(sample), sample.T @ sample)


@pytest.mark.parametrize("size", [1, 2, 3, 8, 75])
@pytest.mark.parametrize("of_rank", [0, 1, 100])
def test_eigenvectors(size: int, of_rank: int, rng: np.random.Generator) -> None:
    part = rng.normal(size=(3, of_rank, size))
    matrices = np.swapaxes(part, 1, 2) @ part
    values, vectors = eigenvectors(matrices)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrices), atol=1e-9)
    np.testing.assert_allclose(matrices @ vectors, vectors * values[:, None], atol=1e-9)
    np.testing.assert_allclose(np.swapaxes(vectors, 1, 2) @ vectors, np.tile(np.eye(size), (3, 1, 1)), atol=1e-12)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_inverses_and_determinants(size: int, rng: np.random.Generator) -> None:
    matrices = rng.normal(size=(7, size, size))
    np.testing.assert_allclose(inverse_of(matrices), np.linalg.inv(matrices))
    np.testing.assert_allclose(determinant(matrices), np.linalg.det(matrices))
    with pytest.raises(np.linalg.LinAlgError):
        inverse_of(np.zeros((size, size)))


@pytest.mark.parametrize("values", [(6,), (6, 2)])
def test_systems_are_solved(values: tuple[int, ...], rng: np.random.Generator) -> None:
    matrix, right = rng.normal(size=(6, 6)), rng.normal(size=values)
    matrix[0, 0] = 0  # another pivot is needed
    np.testing.assert_allclose(matrix @ solve(matrix, right), right, atol=1e-12)
    with pytest.raises(np.linalg.LinAlgError):
        solve(np.zeros((6, 6)), right)


def test_least_squares(rng: np.random.Generator) -> None:
    system, right = rng.normal(size=(40, 3)) + 1000, rng.normal(size=(40, 2))
    np.testing.assert_allclose(least_squares(system, right), np.linalg.lstsq(system, right)[0], atol=1e-9)
    system[:, 2] = 2 * system[:, 0]
    found = least_squares(system, right)
    assert not found[2].any()
    np.testing.assert_allclose(system @ found, system @ np.linalg.lstsq(system, right)[0], atol=1e-9)


def test_ranks_lengths_and_pseudo_inverses(rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(2, 3))
    assert [rank(matrix) for matrix in (vectors, vectors[:1], np.zeros((4, 2)), np.ones((4, 2)))] == [2, 1, 0, 1]
    assert length_of([[3.0], [4.0]]) == 5.0
    for some in (vectors, vectors[:1]):
        np.testing.assert_allclose(pseudo_inverse(some), np.linalg.pinv(some))


def test_sparse_systems_are_solved(rng: np.random.Generator) -> None:
    from scipy import sparse

    part = sparse.random_array((90, 60), density=0.05, rng=rng)
    matrix, right = part.T @ part + sparse.eye_array(60), rng.normal(size=(60, 2))
    np.testing.assert_allclose(matrix @ solve_symmetric(matrix, right), right, atol=1e-12)


@pytest.mark.parametrize(("knots", "every", "count"), [(5, 1, 5), (5, 3, 11), (6, 4, 21), (40, 7, 270)])
def test_splines_are_those_of_scipy(knots: int, every: int, count: int, rng: np.random.Generator) -> None:
    values = rng.normal(size=(knots, 3))
    expected = CubicSpline(every * np.arange(knots), values)(np.arange(count))
    np.testing.assert_allclose(cubic_spline(values, every, count), expected, atol=1e-12)
