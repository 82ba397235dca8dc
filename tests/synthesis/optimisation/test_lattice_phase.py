from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import identity
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase, min_spacing
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

GENERATORS = np.float32([[12, 5], [-3, 16]])


def phase(
    start: np.ndarray | None = None, wrap: Wraps = NOWHERE, generators: np.ndarray = GENERATORS
) -> LatticePhase:
    return LatticePhase(generators, identity((60, 70)) if start is None else start, wrap)


def test_whole_cells_apart_is_the_same_place() -> None:
    circles = phase().of_exemplar(60, 70, 1.0)
    assert circles.shape == (60, 70, 4)
    np.testing.assert_allclose(circles[12:, 5:], circles[:-12, :-5], atol=1e-5)
    np.testing.assert_allclose(circles[:-3, 16:], circles[3:, :-16], atol=1e-5)


def test_half_a_cell_apart_is_opposite() -> None:
    circles = phase(generators=np.float32([[12, 0], [0, 16]])).of_exemplar(60, 70, 1.0)
    np.testing.assert_allclose(circles[6:, :, [0, 2]], -circles[:-6, :, [0, 2]], atol=1e-5)
    np.testing.assert_allclose(circles[6:, :, [1, 3]], circles[:-6, :, [1, 3]], atol=1e-5)
    np.testing.assert_allclose(circles[:, 8:, [1, 3]], -circles[:, :-8, [1, 3]], atol=1e-5)


def test_courses_have_one_circle() -> None:
    """Positions along them do not matter."""
    own = phase(generators=np.float32([[12, 5]]))
    circles = own.of_exemplar(60, 70, 1.0)
    assert circles.shape == (60, 70, 2)
    np.testing.assert_allclose(circles[12:, 5:], circles[:-12, :-5], atol=1e-5)
    np.testing.assert_allclose(circles[5:, :-12], circles[:-5, 12:], atol=1e-5)
    assert own.of_target(range(50), 40, 0.6, (7, 7)).shape == (50, 40, 2)


def test_a_torus_has_whole_courses() -> None:
    circles = phase(wrap=TORUS, generators=np.float32([[13, 2]])).of_target(range(60), 70, 1.0, (0, 0))
    for axis in (0, 1):
        ends = np.abs(circles.take([0], axis) - circles.take([-1], axis))
        assert ends.max() <= np.abs(np.diff(circles, axis=axis)).max() + 1e-4


def test_the_spacing_of_lines_and_courses() -> None:
    assert min_spacing(np.float32([[10, 0], [0, 20]])) == 10
    assert min_spacing(np.float32([[3, 4]])) == 5


def test_values_lie_on_circles() -> None:
    circles = phase().of_target(range(50), 40, 0.6, (7, 7))
    np.testing.assert_allclose(circles[..., 0] ** 2 + circles[..., 2] ** 2, 1, rtol=1e-5)
    np.testing.assert_allclose(circles[..., 1] ** 2 + circles[..., 3] ** 2, 1, rtol=1e-5)


@pytest.mark.parametrize("shift", [(0, 0), (7, 2), (30, 11)])
def test_the_target_goes_on_from_the_start(shift: tuple[int, int]) -> None:
    """A start that shows the exemplar from ``shift`` on has its phase from there on, and before it in a margin."""
    both = phase(identity((40, 40)) + np.array(shift, np.uint32))
    exemplar = both.of_exemplar(100, 100, 1.0)
    down, across = shift
    np.testing.assert_allclose(
        both.of_target(range(40), 40, 1.0, (0, 0)), exemplar[down:, across:][:40, :40], atol=1e-4
    )
    ahead = both.of_target(range(46), 46, 1.0, (6, 6))
    np.testing.assert_allclose(ahead[6:, 6:], exemplar[down:, across:][:40, :40], atol=1e-4)


def test_whole_cells_in_the_start_change_nothing() -> None:
    """Blocks displaced by lattice steps are in step with each other."""
    plain, blocks = identity((60, 70)) + np.uint32(20), identity((60, 70)) + np.uint32(20)
    blocks[:30] += np.array([12, 5], np.uint32)
    blocks[:, :20] += np.array([12, 5], np.uint32)
    blocks[:, 40:] += np.array([9, 21], np.uint32)
    np.testing.assert_allclose(
        phase(blocks).of_target(range(60), 70, 1.0, (0, 0)),
        phase(plain).of_target(range(60), 70, 1.0, (0, 0)),
        atol=1e-4,
    )


def test_a_start_out_of_step_has_its_mean_phase(rng: np.random.Generator) -> None:
    start = (identity((60, 70)).astype(int) + 10 + rng.integers(-2, 3, (60, 70, 2))).astype(np.uint32)
    moved = identity((60, 70)) + np.uint32(10)
    irregular, expected = (phase(match).of_target(range(60), 70, 1.0, (0, 0)) for match in (start, moved))
    assert np.abs(irregular - expected).max() < 0.05


@pytest.mark.parametrize("factor", [0.25, 0.4, 1.0])
def test_scales_agree_at_pixel_centres(factor: float) -> None:
    """A coarse pixel has the phase of the place under its centre."""
    upright = phase(generators=np.float32([[40, 0], [0, 50]]))
    circles = upright.of_exemplar(20, 20, factor)
    centre = (np.arange(20) + 0.5) / factor - 0.5
    np.testing.assert_allclose(circles[:, 0, 0], np.cos(2 * np.pi * centre / 40), atol=1e-5)
    np.testing.assert_allclose(circles[0, :, 3], np.sin(2 * np.pi * centre / 50), atol=1e-5)


@pytest.mark.parametrize("shape", [(60, 70), (61, 83), (40, 33)])
def test_a_torus_holds_whole_cells(shape: tuple[int, int]) -> None:
    """Twice around is the same place, and cells are stretched by hardly more than half a cell in all."""
    both = phase(identity(shape), wrap=TORUS)
    twice = both.of_target(range(2 * shape[0]), 2 * shape[1], 1.0, (0, 0))
    np.testing.assert_allclose(twice[shape[0] :], twice[: shape[0]], atol=1e-4)
    np.testing.assert_allclose(twice[:, shape[1] :], twice[:, : shape[1]], atol=1e-4)
    cells = (both.target - both.exemplar) * np.array(shape)[:, None]
    assert np.abs(cells).max() <= 0.65


def test_a_torus_smaller_than_a_cell_keeps_the_lattice_as_it_is() -> None:
    both = phase(identity((20, 20)), wrap=TORUS, generators=np.float32([[100, 0], [0, 100]]))
    np.testing.assert_array_equal(both.target, both.exemplar)


@pytest.mark.parametrize("stretch", [(1.0, 1.0), (1.03, 0.98), (0.985, 1.0)])
def test_the_lattice_of_a_given_texture_may_be_stretched(
    stretch: tuple[float, float], rng: np.random.Generator
) -> None:
    """Whatever the sources of the pixels that are not given."""
    shape = (120, 110)
    start = np.rint(identity(shape) * np.array(stretch) + 20).astype(np.uint32)
    given = np.ones(shape, bool)
    given[30:80, 30:80] = False
    start[~given] = rng.integers(0, 100, (2500, 2))
    made = LatticePhase(GENERATORS, start, NOWHERE, given)
    change = (made.target - np.diag(stretch) @ made.exemplar) * np.array(shape)[:, None]
    assert np.abs(change).max() < 0.08
    positions = np.stack([np.full(110, 50), np.arange(110)], axis=1)
    drift = positions @ made.target + made.origin - (positions * np.array(stretch) + 20) @ made.exemplar
    assert np.abs(drift - np.rint(drift)).max() < 0.08
