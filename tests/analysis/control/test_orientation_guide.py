from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.control.orientation_field import OrientationFieldParams, orientation_field
from texloom.stages.analysis.control.orientation_guide import OrientationGuideParams, orientation_guide
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image

SHAPE, SIZE = (112, 96), (80, 88)


def hatched(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Lines along rows in the upper half and along columns in the lower one, with noise."""
    row, column = np.indices(shape)
    along = np.where(row < shape[0] // 2, row, column)
    return picture(np.clip(0.5 + 0.4 * np.sin(along * 2 * np.pi / 6) + 0.05 * rng.normal(size=shape), 0, 1))


def test_perpendicular_orientations_are_opposite_and_a_half_turn_changes_nothing() -> None:
    image = picture(np.random.default_rng(0).random(SHAPE))
    angle = np.linspace(0, np.pi, SHAPE[0], dtype=np.float32)[:, None].repeat(SHAPE[1], axis=1)
    made = orientation_guide(image, angle, angle[:40, :50], OrientationGuideParams())
    np.testing.assert_allclose(made.exemplar[0], made.exemplar[-1], atol=1e-4)
    np.testing.assert_array_equal(made.target, made.exemplar[:40, :50])
    flat, upright = (
        orientation_guide(image, np.full(SHAPE, value, np.float32), angle, OrientationGuideParams()).exemplar[0, 0]
        for value in (0.3, 0.3 + np.pi / 2)
    )
    assert np.linalg.norm(flat - upright) == pytest.approx(made.strength, rel=1e-5)


def test_a_texture_runs_along_strokes(rng: np.random.Generator) -> None:
    """Columns in the left half, rows in the right one."""
    image = hatched(SHAPE, rng)
    wanted = np.zeros(SIZE, np.float32)
    wanted[:, : SIZE[1] // 2] = np.pi / 2
    angle = orientation_field(image, OrientationFieldParams()).angle
    made = orientation_guide(image, angle, wanted, OrientationGuideParams())
    guides = {"exemplar_guide": made.exemplar, "target_guide": made.target}
    start = initialise(image, InitialiseParams(size=None), np.random.default_rng(1), **guides).match
    result = optimise(image, start, OptimiseParams(preset="fast"), np.random.default_rng(2), **guides)
    upright = result.match[..., 0] >= SHAPE[0] // 2
    assert upright[:, : SIZE[1] // 2 - 6].mean() > 0.95
    assert upright[:, SIZE[1] // 2 + 6 :].mean() < 0.05
