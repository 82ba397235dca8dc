from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import points
from tests.tilings import basket_weave, herringbone, hexagons, running_bond
from texloom.stages.numerics.filters import gaussian_blur
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
    assert cut_share(label, outline, origin) < 0.06


def cut_share(label: np.ndarray, outline: CellOutline, origin: np.ndarray) -> float:
    """Share of an outline that runs inside tiles."""
    cell = outline.cell_of(np.moveaxis(np.indices(label.shape), 0, -1) - origin)
    cuts = lengths = 0
    for ends in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        differs = (cell[ends[0]] != cell[ends[1]]).any(axis=-1)
        lengths += int(differs.sum())
        cuts += int((differs & (label[ends[0]] > 0) & (label[ends[0]] == label[ends[1]])).sum())
    return cuts / lengths


def displaced(label: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Tiles of alike tones whose joints are dark, and .6 px out of place."""
    moves = np.stack([gaussian_blur(rng.standard_normal(label.shape).astype(np.float32), 6.0) for _ in range(2)])
    places = np.indices(label.shape) + 0.6 / moves.std() * moves
    last = np.array(label.shape)[:, None, None] - 1
    tones = rng.uniform(30, 70, int(label.max()) + 1)
    tones[0] = 0
    tone = tones[label[tuple(np.clip(np.rint(places), 0, last).astype(int))]] + rng.normal(0, 1, label.shape)
    return gaussian_blur(tone.astype(np.float32), 0.6)[..., None]


@pytest.mark.parametrize("name", ["hexagons", "herringbone"])
def test_outlines_follow_joints_that_are_not_quite_in_place(name: str) -> None:
    """Cells vary more there than within tiles, but contours hide a cut, which would show in a tile."""
    label, generators = TILINGS[name]
    shares = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        features, origin = displaced(label, rng), rng.uniform(0, 20, 2)
        vertices = points(generators, label.shape, origin)
        outline = cell_outline(features, np.ones(label.shape, bool), vertices, generators, 2.0)
        shares.append(cut_share(label, outline, origin))
    assert np.mean(shares) < 0.1


@pytest.mark.parametrize(("name", "side", "seed", "least"), [("hexagons", 90, 1, 3), ("basket weave", 110, 9, 2)])
def test_where_cells_are_few_each_counts_more_than_how_joints_show(
    name: str, side: int, seed: int, least: int
) -> None:
    rng = np.random.default_rng(seed)
    label, generators = TILINGS[name]
    features = rng.uniform(0, 80, (int(label.max()) + 1, 3)).astype(np.float32)[label[:side, :side]]
    valid = np.ones((side, side), bool)
    vertices = points(generators, valid.shape, rng.uniform(0, 20, 2))
    low, high = cell_outline(features, valid, vertices, generators, 2.0).box
    assert ((vertices + low >= 2) & (vertices + high <= side - 3)).all(axis=1).sum() >= least


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
