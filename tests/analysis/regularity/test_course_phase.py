"""Courses whose elements line up are a lattice."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, wall
from texloom.stages.analysis.regularity.course_phase import lattice_in_phase
from texloom.stages.analysis.regularity.lattice import detail, self_correlation, valid_lightness
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


def found(image: Image, step: tuple[float, float]) -> Vectors | None:
    correlation = self_correlation(detail(valid_lightness(image)))
    return lattice_in_phase(correlation, np.array(step, np.float64), 10.0)


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


@pytest.mark.parametrize("seed", range(6))
def test_a_free_phase_has_none(seed: int) -> None:
    assert found(wall((240, 270), STEP, 0, np.random.default_rng(seed)), (STEP, 0.0)) is None
