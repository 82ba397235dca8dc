import numpy as np
import pytest

from texloom.stages.synthesis.optimisation import cells
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cells import complete_cells
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.vocabulary.facts import NOWHERE

SIZE, MIDDLE = 8, 4
HEIGHT, WIDTH = 14, 18
"""of a tile, px"""
GENERATORS = {
    "grid": np.array([[HEIGHT, 0], [0, WIDTH]], np.float32),
    "bond": np.array([[HEIGHT, WIDTH // 3], [0, WIDTH]], np.float32),
}


def wall(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Tiles of random tone between dark joints of 2 px, as lightness and colour."""
    rows, columns = np.indices((8 * HEIGHT, 8 * WIDTH))
    row = rows // HEIGHT
    shifted = columns - row * int(GENERATORS[kind][0, 1])
    tone = rng.uniform(40, 80, (8, 20))[row, shifted // WIDTH + 8]
    tone[(rows % HEIGHT < 2) | (shifted % WIDTH < 2)] = 10
    return np.stack([tone, 0 * tone, 0 * tone], axis=2).astype(np.float32)


def joined(patches: tuple[int, int], generators: np.ndarray) -> tuple[np.ndarray, LatticePhase]:
    """The exemplar, one tile farther from a line on that crosses tiles, and its phase."""
    match = np.indices(patches).astype(np.int32)
    match[:, :, 5 * WIDTH // 2 :] += generators[1].astype(np.int32)[:, None, None]
    start = np.moveaxis(match, 0, 2).astype(np.uint32)
    return match, LatticePhase(generators, start, NOWHERE)


def mixed_tiles(match: np.ndarray, lab: np.ndarray, kind: str) -> int:
    """Tiles whose inner pixels are of tones that differ visibly."""
    rows, columns = np.indices(match.shape[1:]) + MIDDLE
    row = rows // HEIGHT
    shifted = columns - row * int(GENERATORS[kind][0, 1])
    inner = (
        (rows % HEIGHT > 2) & (shifted % WIDTH > 2) & (rows % HEIGHT < HEIGHT - 1) & (shifted % WIDTH < WIDTH - 1)
    )
    tiles = np.asarray(row * 100 + shifted // WIDTH)[inner]
    tone = lab[match[0] + MIDDLE, match[1] + MIDDLE, 0][inner]
    return sum(bool(np.ptp(tone[tiles == tile]) >= 4) for tile in np.unique(tiles))


@pytest.mark.parametrize("kind", ["grid", "bond"])
@pytest.mark.parametrize("window", [1024, 70])
def test_joints_inside_tiles_are_moved_to_their_outlines(
    kind: str, window: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    generators = GENERATORS[kind]
    match, phase = joined((7 * HEIGHT, 6 * WIDTH), generators)
    lab = wall(kind, rng)
    assert mixed_tiles(match, lab, kind) >= 5
    monkeypatch.setattr(cells, "_WINDOW", window)
    complete_cells(match, lab, SIZE, (0, 0), NOWHERE, generators, phase, None)
    assert mixed_tiles(match, lab, kind) == 0


def test_joints_stay_where_moving_them_would_break_contours(rng: np.random.Generator) -> None:
    """In stripes across the tiles there is nowhere to go."""
    lab = rng.uniform(20, 80, (8 * HEIGHT, 8 * WIDTH, 1)).astype(np.float32) * np.ones(3, np.float32)
    match, phase = joined((7 * HEIGHT, 6 * WIDTH), GENERATORS["grid"])
    before = match.copy()
    complete_cells(match, lab, SIZE, (0, 0), NOWHERE, GENERATORS["grid"], phase, None)
    assert np.array_equal(match, before)


def test_masked_patches_are_not_used(rng: np.random.Generator) -> None:
    lab, generators = wall("grid", rng), GENERATORS["grid"]
    match, phase = joined((7 * HEIGHT, 6 * WIDTH), generators)
    match[:, :, 5 * WIDTH // 2 :] -= generators[1].astype(np.int32)[:, None, None]
    match[:, 60:, 40:] += 1
    usable = np.ones(lab.shape[:2], bool)
    usable[50, 30] = False
    allowed = Allowed(usable, 8 * HEIGHT, 8 * WIDTH, SIZE)
    match = allowed.moved(match)
    complete_cells(match, lab, SIZE, (0, 0), NOWHERE, generators, phase, allowed)
    assert allowed.places[tuple(match)].all()


def test_large_cells_are_left(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    match, phase = joined((7 * HEIGHT, 6 * WIDTH), GENERATORS["grid"])
    before = match.copy()
    monkeypatch.setattr(cells, "_WINDOW", 2 * WIDTH)
    complete_cells(match, wall("grid", rng), SIZE, (0, 0), NOWHERE, GENERATORS["grid"], phase, None)
    assert np.array_equal(match, before)
