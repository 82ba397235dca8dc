import numpy as np
import pytest

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.free_form import approximate, deform

LOW, SPACING = np.array([-3.0, 2.0]), np.array([5.0, 7.0])


@pytest.mark.parametrize(("wrap", "shape"), [(False, (7, 6)), (True, (6, 5)), (True, (2, 3)), (False, (4, 4))])
def test_equal_twins(wrap: bool, shape: tuple[int, int], rng: np.random.Generator) -> None:
    points = LOW + rng.uniform(-0.3, 1.3, (40, 2)) * SPACING * shape
    values = rng.normal(size=(40, 2))
    control = np.full((*shape, 2), np.nan)
    approximate(points, values, LOW, SPACING, wrap, control)
    np.testing.assert_allclose(control, naive.approximate(points, values, LOW, SPACING, wrap, shape), atol=1e-12)

    control = rng.normal(size=(*shape, 2))
    moved = points.copy()
    deform(control, LOW, SPACING, wrap, moved)
    np.testing.assert_allclose(moved, naive.deform(control, LOW, SPACING, wrap, points), atol=1e-12)


def test_control_points_on_a_plane_reproduce_it(rng: np.random.Generator) -> None:
    """A cubic B-spline reproduces every affine field within its box."""
    affine = rng.normal(size=(3, 2))
    rows, columns = np.arange(-1, 6), np.arange(-1, 5)
    places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1) * SPACING + LOW
    control = places @ affine[:2] + affine[2]
    points = LOW + rng.uniform(0, 1, (50, 2)) * SPACING * [4, 3]
    moved = points.copy()
    deform(control, LOW, SPACING, False, moved)
    np.testing.assert_allclose(moved - points, points @ affine[:2] + affine[2], atol=1e-10)


def test_a_single_value_is_met() -> None:
    point, value = np.array([[4.0, 11.0]]), np.array([[2.0, -3.0]])
    control = np.empty((7, 7, 2))
    approximate(point, value, LOW, SPACING, False, control)
    moved = point.copy()
    deform(control, LOW, SPACING, False, moved)
    np.testing.assert_allclose(moved - point, value, atol=1e-12)


def test_wraps_around(rng: np.random.Generator) -> None:
    control = rng.normal(size=(4, 5, 2))
    points = rng.uniform(0, 20, (30, 2))
    once, again = points.copy(), points + SPACING * [4, -10]
    deform(control, LOW, SPACING, True, once)
    deform(control, LOW, SPACING, True, again)
    np.testing.assert_allclose(again - SPACING * [4, -10], once, atol=1e-9)
