"""Borders between exemplars lie between their cells."""

import numpy as np

from tests.synthesis.optimisation.test_cell_completion import BORDER, HEIGHT, SIZE, wall
from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.common.grids.border import Border
from texloom.stages.synthesis.optimisation.several_cells import SeveralCellCompletion, SeveralCells
from texloom.stages.vocabulary.facts import NOWHERE


def two_walls(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A wall with dark joints beside a smooth green exemplar: colours, contours, and rectangles."""
    lab, strength = wall(rng)
    height, width = strength.shape
    green = np.full((height, width, 3), np.float32(50)) * np.array([1, -1, 1], np.float32)
    gap = np.zeros((height, 8, 3), np.float32)
    both = np.concatenate([lab, gap, green], axis=1)
    contours = np.concatenate([strength, np.zeros((height, 8 + width), np.float32)], axis=1)
    return both, contours, np.array([[0, 0, height, width], [0, width + 8, height, width]], np.int32)


def cut_lines(match: np.ndarray, cells: SeveralCells) -> int:
    """Pixels of the border between two exemplars that lie inside cells."""
    source = match + SIZE // 2
    exemplar, inside = cells.exemplar[tuple(source)], cells.core[tuple(source)]
    across = (exemplar[:, 1:] != exemplar[:, :-1]) & (inside[:, 1:] | inside[:, :-1])
    down = (exemplar[1:] != exemplar[:-1]) & (inside[1:] | inside[:-1])
    return int(across.sum() + down.sum())


def test_only_exemplars_that_have_cells_give_some(rng: np.random.Generator) -> None:
    _, contours, rectangles = two_walls(rng)
    cells = SeveralCells(contours, rectangles, Border(SIZE))
    alone = ContourCells(np.ascontiguousarray(contours[:, : rectangles[0, 3]]), Border(1))
    assert cells.clear
    assert cells.whole.sum() == alone.whole.sum()
    first, second = (cells.core[cells.exemplar == number] for number in (1, 2))
    assert first.any()
    assert not second.any()
    inside = cells.label[cells.core & cells.whole[cells.label]]
    assert cells.consists[inside].all()
    box = cells.boxes[inside[0]]
    rows, columns = np.nonzero(cells.core & (cells.label == inside[0]))
    assert box.tolist() == [rows.min(), columns.min(), rows.max() + 1, columns.max() + 1]


def test_exemplars_without_cells_have_none(rng: np.random.Generator) -> None:
    _, contours, rectangles = two_walls(rng)
    assert not SeveralCells(np.zeros_like(contours), rectangles, BORDER).clear


def test_borders_between_exemplars_cut_no_cells(rng: np.random.Generator) -> None:
    """A straight line between a wall and a smooth exemplar comes to lie along joints."""
    lab, contours, rectangles = two_walls(rng)
    cells = SeveralCells(contours, rectangles, BORDER)
    match = np.indices((7 * HEIGHT, 130)).astype(np.int32)
    match[1, :, 65:] += rectangles[1, 1] - 40
    straight = match.copy()
    before = cut_lines(match, cells)
    assert before >= 40
    assert SeveralCellCompletion(lab, cells, SIZE, None).complete(match, NOWHERE) >= 4
    assert cut_lines(match, cells) <= before // 4
    far = np.abs(np.arange(130) - 65) > 45
    assert np.array_equal(match[:, :, far], straight[:, :, far])
