import cv2
import numpy as np
import pytest

from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.common.grids.border import Border
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cell_completion import CellCompletion
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIZE, HEIGHT, COURSES = 8, 14, 10
BORDER = Border(1)


def wall(rng: np.random.Generator, lengths: tuple[int, ...] = (18, 24, 30)) -> tuple[np.ndarray, np.ndarray]:
    """Courses of bricks of random lengths and tones between dark joints: lightness and colour, and its contours."""
    width = 150
    lightness = np.zeros((HEIGHT * COURSES, width), np.float32)
    for course in range(COURSES):
        left = -int(rng.integers(0, 20))
        while left < width:
            length = int(rng.choice(lengths))
            brick = np.s_[course * HEIGHT : (course + 1) * HEIGHT, max(0, left) : max(0, left + length)]
            lightness[brick] = rng.choice([40, 52, 64, 76, 88])
            lightness[brick][:, :2] = 10
            left += length
        lightness[course * HEIGHT : course * HEIGHT + 2] = 10
    lab = np.stack([lightness, 0 * lightness, 0 * lightness], axis=2)
    return lab, cv2.GaussianBlur((lightness == 10).astype(np.float32), (0, 0), 1)


def mixed(match: np.ndarray, lab: np.ndarray) -> int:
    """Bricks of more than one tone, by more than a sixteenth of their area."""
    tone = lab[match[0] + SIZE // 2, match[1] + SIZE // 2, 0]
    inside = cv2.erode((tone > 10).astype(np.uint8), np.ones((3, 3), np.uint8))
    count, number = cv2.connectedComponents(inside, connectivity=4)
    tones = [np.unique(tone[number == index], return_counts=True)[1] for index in range(1, count)]
    return sum(int(16 * (counts.sum() - counts.max()) > counts.sum()) for counts in tones)


def joined(places: tuple[int, int]) -> np.ndarray:
    """The exemplar, three courses farther right of a line that crosses bricks."""
    match = np.indices(places).astype(np.int32)
    match[0, :, 70:] = (match[0, :, 70:] + 3 * HEIGHT) % (7 * HEIGHT)
    return match


def test_cells_of_courses_become_whole(rng: np.random.Generator) -> None:
    lab, strength = wall(rng)
    cells = ContourCells(strength, BORDER)
    assert cells.clear
    match = joined((7 * HEIGHT, 130))
    before = mixed(match, lab)
    assert before >= 5
    completion = CellCompletion(lab, cells, SIZE, None)
    assert completion.complete(match, NOWHERE) >= 4
    assert mixed(match, lab) <= before // 4
    assert (match >= 0).all()
    assert (match.max(axis=(1, 2)) <= np.array(lab.shape[:2]) - SIZE).all()


@pytest.mark.parametrize("wrap", [NOWHERE, Wraps(False, True)])
def test_cells_across_a_border_that_wraps_become_whole(wrap: Wraps, rng: np.random.Generator) -> None:
    """Its left and right end show different bricks, in the same courses."""
    lab, strength = wall(rng, (24,))
    match = np.indices((7 * HEIGHT, 96)).astype(np.int32)
    completion = CellCompletion(lab, ContourCells(strength, BORDER), SIZE, None)
    rolled = np.roll(match, 48, axis=2)
    before = mixed(rolled, lab)
    assert before >= 3
    completion.complete(match, wrap)
    after = mixed(np.roll(match, 48, axis=2), lab)
    assert after == (0 if wrap.across else before)


def test_only_allowed_patches_are_used(rng: np.random.Generator) -> None:
    lab, strength = wall(rng)
    usable = np.ones(lab.shape[:2], bool)
    usable[100:104, 60:64] = False
    allowed = Allowed(usable, *lab.shape[:2], SIZE)
    match = allowed.moved(joined((7 * HEIGHT, 130)))
    CellCompletion(lab, ContourCells(strength, BORDER), SIZE, allowed).complete(match, NOWHERE)
    assert allowed.places[tuple(match)].all()


def test_same_bits_on_any_number_of_threads(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    lab, strength = wall(rng)
    results = []
    for threads in ("1", "2"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        match = joined((7 * HEIGHT, 130))
        CellCompletion(lab, ContourCells(strength, BORDER), SIZE, None).complete(match, NOWHERE)
        results.append(match)
    assert np.array_equal(*results)


def test_seams_that_nobody_sees_stay(rng: np.random.Generator) -> None:
    lab, strength = wall(rng)
    even = np.where(lab > 10, np.float32(60), lab) * np.array([1, 0, 0], np.float32)
    match = np.indices((7 * HEIGHT, 130)).astype(np.int32)
    before = match.copy()
    CellCompletion(even, ContourCells(strength, BORDER), SIZE, None).complete(match, NOWHERE)
    assert np.array_equal(match, before)


@pytest.mark.parametrize("kind", ["noise", "flat", "ramp"])
def test_exemplars_without_cells_are_not_clear(kind: str, rng: np.random.Generator) -> None:
    strength = {
        "noise": rng.random((96, 96)),
        "flat": np.zeros((96, 96)),
        "ramp": np.add.outer(np.arange(96), np.arange(96)) / 190,
    }[kind].astype(np.float32)
    assert not ContourCells(strength, BORDER).clear


def test_cells_that_the_border_cuts_are_not_whole(rng: np.random.Generator) -> None:
    _, strength = wall(rng)
    cells = ContourCells(strength, Border(SIZE))
    first = SIZE // 2
    rim = np.unique(cells.label[first, first:-first])
    assert not cells.whole[rim].any()
    assert cells.whole.sum() > 20
