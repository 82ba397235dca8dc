from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import points
from tests.tilings import basket_weave, herringbone, hexagons, running_bond
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline, cell_outline, course_outline

TILINGS = {
    "hexagons": hexagons((190, 200), 20.0),
    "herringbone": herringbone((200, 200), 14),
    "basket weave": basket_weave((190, 190), 10),
    "running bond": running_bond((180, 200), 20, 44),
}


def outline_of(
    label: np.ndarray, generators: np.ndarray, origin: np.ndarray, rng: np.random.Generator
) -> CellOutline:
    colours = rng.uniform(0, 80, (int(label.max()) + 1, 3)).astype(np.float32)
    features = colours[label]
    vertices = points(generators, features.shape[:2], origin)
    return cell_outline(features, np.ones(label.shape, bool), vertices, generators, 2.0)


@pytest.mark.parametrize("name", TILINGS)
def test_outlines_follow_joints(name: str, rng: np.random.Generator) -> None:
    """No two parts of a tile belong to different cells, wherever the lattice's points lie."""
    label, generators = TILINGS[name]
    origin = rng.uniform(0, 20, 2)
    outline = outline_of(label, generators, origin, rng)
    cell = outline.cell_of(np.moveaxis(np.indices(label.shape), 0, -1) - origin)
    cuts = lengths = 0
    for axis in (0, 1):
        ends = [np.s_[:-1], np.s_[1:]] if axis == 0 else [np.s_[:, :-1], np.s_[:, 1:]]
        differs = (cell[ends[0]] != cell[ends[1]]).any(axis=-1)
        lengths += int(differs.sum())
        cuts += int((differs & (label[ends[0]] > 0) & (label[ends[0]] == label[ends[1]])).sum())
    assert lengths > 500
    assert cuts < 0.03 * lengths


@pytest.mark.parametrize("name", TILINGS)
def test_copies_cover_the_plane_once(name: str, rng: np.random.Generator) -> None:
    label, generators = TILINGS[name]
    outline = outline_of(label, generators, np.zeros(2), rng)
    places = rng.uniform(-200, 200, (500, 2))
    cells = outline.cell_of(places)
    for step in ((1, 0), (0, 1), (2, -3)):
        moved = outline.cell_of(places + np.array(step) @ generators)
        assert (moved - cells == step).all(axis=1).mean() > 0.99  # but where rounding meets the outline
    inside = places[(cells == 0).all(axis=1)]
    low, high = outline.box
    assert ((inside >= low - 1e-9) & (inside <= high + 1e-9)).all()
    area = abs(np.linalg.det(generators))
    grid = np.moveaxis(np.indices((400, 400)), 0, -1) - 200
    assert (outline.cell_of(grid.astype(float)) == 0).all(axis=-1).sum() == pytest.approx(area, rel=0.05)


def test_an_outline_moves_with_its_lattice(rng: np.random.Generator) -> None:
    label, generators = TILINGS["hexagons"]
    outline = outline_of(label, generators, np.zeros(2), rng)
    change = np.array([[1.1, 0.2], [-0.1, 0.9]])
    places = rng.uniform(-60, 60, (300, 2))
    moved = outline.moved(generators @ change)
    assert (moved.cell_of(places @ change) == outline.cell_of(places)).all(axis=1).mean() > 0.99
    np.testing.assert_allclose(moved.base, outline.base @ change)


def test_courses_are_divided_where_they_are_alike(rng: np.random.Generator) -> None:
    label, _ = running_bond((160, 180), 20, 44)
    colours = rng.uniform(0, 80, (int(label.max()) + 1, 3)).astype(np.float32)
    frame = np.array([[20.0, 0.0], [0.0, 50.0]])
    vertices = points(frame, label.shape, np.array([7.0, 3.0]))
    outline = course_outline(colours[label], np.ones(label.shape, bool), vertices, frame)
    assert outline.phase is not None
    border = (7 + 20 * outline.phase[0]) % 20
    assert min(border, 20 - border) < 3
