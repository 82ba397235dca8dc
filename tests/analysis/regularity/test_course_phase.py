"""Courses whose elements line up are a lattice."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, wall
from texloom.stages.analysis.regularity.course_phase import larger_bond, lattice_in_phase
from texloom.stages.analysis.regularity.lattice import valid_lightness
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.vocabulary.arrays import Image, Vectors

STEP, LENGTH = 24, 70  # px


def bricks(shift: float, rng: np.random.Generator, turned: bool = False) -> Image:
    """Bricks of many tones and uneven lengths, each course ``shift`` of a brick farther right than the last."""
    height, width = (300, 280) if turned else (280, 300)
    if turned:
        height, width = width, height
    tone = np.empty((height, width))
    for course in range(-(-height // STEP)):
        rows = slice(course * STEP, (course + 1) * STEP)
        start = -LENGTH + round((course * shift % 1) * LENGTH)
        for left in range(start, width, LENGTH):
            first, last = (max(0, side + int(rng.integers(-2, 3))) for side in (left, left + LENGTH))
            tone[rows, first:last] = rng.uniform(0.33, 0.43)
            tone[rows, max(0, first - 6) : first] = 0.75
        tone[rows.start : rows.start + 4] = 0.75
    tone += 0.02 * smooth_noise(tone.shape, 1.5, rng)
    return picture(tone.T if turned else tone)


def slabs(rng: np.random.Generator) -> Image:
    """Long stained slabs in running bond, two to three a course, with joints of a single px."""
    tone = np.empty((8 * STEP, 5 * LENGTH))
    for course in range(8):
        rows = slice(course * STEP, (course + 1) * STEP)
        for left in range(-2 * LENGTH + course % 2 * LENGTH, tone.shape[1], 2 * LENGTH):
            tone[rows, max(0, left) : max(0, left + 2 * LENGTH)] = rng.uniform(0.3, 0.6)
            tone[rows, max(0, left) : max(0, left + 1)] = 0.2
        tone[rows.start] = 0.2
    return picture(np.clip(tone + 0.15 * smooth_noise(tone.shape, 8, rng), 0, 1))


def english_bond(rng: np.random.Generator) -> Image:
    """Courses of stretchers, and of headers half as long, by turns."""
    tone = np.empty((12 * STEP, 4 * LENGTH + 30))
    for course in range(12):
        rows = slice(course * STEP, (course + 1) * STEP)
        length = LENGTH // (1 + course % 2)
        for left in range(-LENGTH + course % 2 * (length // 2), tone.shape[1], length):
            first = max(0, left + int(rng.integers(-1, 2)))
            tone[rows, first : left + length + 2] = rng.uniform(0.3, 0.6)
            tone[rows, first : max(0, left + 4)] = 0.75
        tone[rows.start : rows.start + 4] = 0.75
    return picture(tone + 0.05 * smooth_noise(tone.shape, 1.5, rng))


def found(image: Image, step: tuple[float, float]) -> Vectors | None:
    return lattice_in_phase(valid_lightness(image), np.array(step, np.float64), 10.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("shift", "turned"), [(0.5, False), (1 / 3, False), (0.5, True)])
def test_bonds_are_lattices(shift: float, turned: bool, seed: int) -> None:
    generators = found(bricks(shift, np.random.default_rng(seed), turned), (0.0, STEP) if turned else (STEP, 0.0))
    assert generators is not None
    along = 0 if turned else 1
    step = generators[0, along] / LENGTH
    assert min(abs(step - shift - round(step - shift)), abs(step + shift - round(step + shift))) < 0.08
    assert abs(generators[1, along]) == pytest.approx(LENGTH, abs=3)
    assert abs(np.linalg.det(reduced(generators))) == pytest.approx(STEP * LENGTH, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_slabs_whose_tones_differ_are_a_lattice_by_their_joints(seed: int) -> None:
    generators = found(slabs(np.random.default_rng(seed)), (STEP, 0.0))
    assert generators is not None
    assert abs(generators[0, 1]) == pytest.approx(LENGTH, abs=2)
    assert abs(generators[1, 1]) == pytest.approx(2 * LENGTH, abs=2)


@pytest.mark.parametrize("image", [np.full((60, 80), 0.3), np.full((30, 40), 0.3)])
def test_an_even_picture_has_none(image: np.ndarray) -> None:
    assert found(picture(image), (20.0, 0.0)) is None


@pytest.mark.parametrize("shape", [(240, 270), (100, 250), (120, 400)])
@pytest.mark.parametrize("seed", range(6))
def test_a_free_phase_has_none(seed: int, shape: tuple[int, int]) -> None:
    assert found(wall(shape, STEP, 0, np.random.default_rng(seed)), (STEP, 0.0)) is None


@pytest.mark.parametrize("seed", range(4))
def test_headers_and_stretchers_by_turns_are_a_lattice_of_two_courses(seed: int) -> None:
    image = english_bond(np.random.default_rng(seed))
    headers = np.array([[STEP, LENGTH / 4], [0, LENGTH / 2]], np.float32)
    for generators in (
        larger_bond(valid_lightness(image), headers, 10.0),
        found(image, (STEP, 0.0)),
    ):
        assert generators is not None
        assert reduced(generators) == pytest.approx(np.array([[2 * STEP, 0], [0, LENGTH]]), abs=2) or (
            abs(np.linalg.det(generators)) == pytest.approx(2 * STEP * LENGTH, rel=0.05)
        )


@pytest.mark.parametrize("seed", range(3))
def test_a_lattice_that_explains_all_joints_stays(seed: int) -> None:
    wall = bricks(0.5, np.random.default_rng(seed))
    whole = np.array([[STEP, LENGTH / 2], [0, LENGTH]], np.float32)
    assert larger_bond(valid_lightness(wall), whole, 10.0) is None
    stacked = np.array([[STEP, 0], [0, LENGTH]], np.float32)
    assert larger_bond(valid_lightness(bricks(0.0, np.random.default_rng(seed))), stacked, 10.0) is None
