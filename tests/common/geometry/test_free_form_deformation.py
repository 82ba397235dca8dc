from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import points
from texloom.stages.common.geometry.free_form_deformation import FreeForm, fitted

TORUS = (np.zeros(2), np.array([200.0, 240.0]))
BOX = (np.full(2, -60.0), np.array([260.0, 300.0]))  # all points lie within
CELLS = np.array([[22.0, 5.0], [-4.0, 26.0]])


def waves(places: np.ndarray, height: float = 4.0, period: tuple[float, float] = (200.0, 240.0)) -> np.ndarray:
    """A smooth displacement that repeats."""
    row, column = (2 * np.pi * places / period).T
    return height * np.stack([np.sin(row + 1) * np.cos(column), np.sin(column - row)], axis=1)


def vertices() -> np.ndarray:
    return points(CELLS, (200, 240), np.array([3.0, 4.0]))


def inner(step: float = 7.3) -> np.ndarray:
    grid = np.meshgrid(np.arange(0, 200, step), np.arange(0, 240, step), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2)


def jacobians(warp: FreeForm, places: np.ndarray) -> np.ndarray:
    sides = [(warp(places + step) - warp(places - step)) / 0.02 for step in np.eye(2) * 0.01]
    return np.linalg.det(np.stack(sides, axis=1))


def test_affine_maps_are_reproduced(rng: np.random.Generator) -> None:
    affine = np.array([[1.1, 0.2], [-0.1, 0.9], [12.0, -7.0]])
    places = vertices()
    warp = fitted(places, places @ affine[:2] + affine[2], BOX, 10.0)
    places = rng.uniform(-50, 300, (60, 2))
    np.testing.assert_allclose(warp(places), places @ affine[:2] + affine[2], atol=1e-6)
    assert not warp.levels


@pytest.mark.parametrize("wrap", [False, True])
def test_smooth_fields_are_found_again(wrap: bool) -> None:
    """At the given points and between them."""
    places = vertices() % TORUS[1] if wrap else vertices()
    warp = fitted(places, places + waves(places), TORUS if wrap else BOX, 12.0, wrap=wrap)
    inside = places[((places >= 0) & (places <= TORUS[1])).all(axis=1)]
    assert np.hypot(*(warp(inside) - inside - waves(inside)).T).max() < 0.1
    assert np.hypot(*(warp(inner()) - inner() - waves(inner())).T).max() < 0.5
    assert jacobians(warp, inner()).min() > 0


def test_there_and_back() -> None:
    places = vertices()
    moved = places + waves(places)
    there, back = fitted(places, moved, BOX, 12.0), fitted(moved, places, BOX, 12.0)
    away = np.hypot(*(back(there(inner())) - inner()).T)
    assert away.max() < 0.5
    assert away.mean() < 0.1


def test_never_folds(rng: np.random.Generator) -> None:
    """Even where points are moved past each other."""
    places = vertices()
    warp = fitted(places, places + rng.normal(0, 12, places.shape), BOX, 6.0)
    assert jacobians(warp, inner(3.1)).min() > 0


def test_wraps_around(rng: np.random.Generator) -> None:
    places = rng.uniform(0, 1, (40, 2)) * TORUS[1]
    warp = fitted(places, places + waves(places), TORUS, 12.0, wrap=True)
    places = rng.uniform(0, 1, (50, 2)) * TORUS[1]
    np.testing.assert_allclose(warp(places + TORUS[1]), warp(places) + TORUS[1], atol=1e-9)


def test_threads_do_not_matter(on_threads: Any) -> None:
    places = vertices()
    warp = fitted(places, places + waves(places), BOX, 12.0)
    places = np.random.default_rng(2).uniform(0, 200, (100_000, 2))
    np.testing.assert_array_equal(*on_threads(lambda: warp(places)))
