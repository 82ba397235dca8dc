from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.synthetic import LATTICES, difference, picture, points, smooth_noise, stamped, tiled
from texloom.stages.analysis.regularity.lattice import (
    Lattice,
    LatticeParams,
    detail,
    lattice,
    self_correlation,
    significance,
)
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.common.regularity.lattice_cells import reduced
from texloom.stages.vocabulary.arrays import Image


def density_of(image: Image) -> np.ndarray:
    return offset_statistics(image, OffsetStatisticsParams()).density


def measured(image: Image, density: np.ndarray | None = None) -> Lattice:
    return lattice(image, density_of(image) if density is None else density, LatticeParams())


def density_at(generators: np.ndarray, image: Image) -> np.ndarray:
    """A density that is known: a Gaussian of 2 px at every point of a lattice."""
    import cv2

    reach = np.array([image.height, image.width]) // 2
    shape = tuple(int(side) for side in 2 * reach + 1)
    density = np.zeros(shape, np.float32)
    places = np.rint(points(generators, shape, reach)).astype(int)  # type: ignore[arg-type]
    places = places[((places >= 0) & (places < shape)).all(axis=1)]
    density[tuple(places.T)] = 1
    density[tuple(reach)] = 0
    density = cv2.GaussianBlur(density, (13, 13), 2)
    return density / density.max()


@pytest.mark.parametrize("jitter", [0.0, 0.05])
@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("seed", [0, 4])
def test_known_lattices_are_found(name: str, jitter: float, seed: int) -> None:
    generators = LATTICES[name]
    result = measured(stamped(generators, np.random.default_rng(seed), jitter=jitter))
    assert difference(result.generators, generators) < 1
    np.testing.assert_array_equal(result.best, result.generators)
    assert result.confidence > 0.4
    assert 0 < result.score <= 1


@pytest.mark.parametrize(("cell", "drop"), [((40, 48), 0), ((30, 56), 28), ((37, 41), 11)])
def test_exact_repetition_is_found_exactly(cell: tuple[int, int], drop: int, rng: np.random.Generator) -> None:
    image, generators = tiled(smooth_noise((*cell, 3), 2.0, rng), drop, (240, 280))
    result = measured(image)
    assert difference(result.generators, generators) < 0.5
    assert result.confidence > 0.95


def equal_things(rng: np.random.Generator) -> np.ndarray:
    """At random places."""
    thing = smooth_noise((30, 30, 3), 1.5, rng)
    pixels = np.full((240, 280, 3), 0.5)
    for row, column in rng.integers((0, 0), (210, 250), (40, 2)):
        pixels[row : row + 30, column : column + 30] = thing
    return pixels


IRREGULAR: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "white": lambda rng: rng.random((240, 280, 3)),
    "clouds": lambda rng: smooth_noise((240, 280, 3), 3.0, rng),
    "gradient": lambda rng: np.outer(np.linspace(0, 1, 240), np.linspace(0.2, 1, 280)),
    "constant": lambda rng: np.full((240, 280, 3), 0.3),
    "black": lambda rng: np.zeros((240, 280, 1)),
    "equal things": equal_things,
}


@pytest.mark.parametrize("name", IRREGULAR)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_irregular_pictures_have_none(name: str, seed: int) -> None:
    result = measured(picture(IRREGULAR[name](np.random.default_rng(seed))))
    assert result.generators.shape == (0, 2)
    assert result.generators.dtype == np.float32
    assert result.confidence < 0.4


@pytest.mark.parametrize(
    "steps", [(1, 1, 0, 1), (2, 0, 0, 1), (1, 1, -1, 1), (3, 0, 0, 1), (5, 0, 2, 1), (2, 0, 0, 3)]
)
def test_a_density_with_too_few_points_gives_the_whole_lattice(
    steps: tuple[int, int, int, int], rng: np.random.Generator
) -> None:
    """As when only every second brick looks the same."""
    generators = np.array([[27.0, 4.0], [-5.0, 32.0]])
    sparse = np.reshape(steps, (2, 2)) @ generators
    image = stamped(generators, rng)
    assert difference(measured(image, density_at(sparse, image)).generators, generators) < 1


def test_no_lattice_runs_along_a_joint(rng: np.random.Generator) -> None:
    """Plain bricks with wide joints look alike after any small step along their rows; features say two bricks."""
    height, width = 30, 72
    row, column = np.indices((300, 288))
    inside = (column - row // height * (width // 2)) % width
    joints = np.where(row % height < 6, 0.5, 0.0) + np.where((inside < 4) & (row % height >= 6), 0.2, 0.0)
    image = picture(0.2 + joints + 0.1 * smooth_noise((300, 288), 4.0, rng))
    sparse = np.array([[2 * height, 0], [0, 2 * width]], float)
    result = measured(image, density_at(sparse, image))
    np.testing.assert_array_less(difference(result.generators, np.array([[height, width / 2], [0, width]])), 1.5)


def test_turning_the_picture_turns_the_lattice(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["sheared"], rng)
    turned = picture(image.pixels.transpose(1, 0, 2))
    density = density_of(image)
    straight = measured(image, density).generators
    crossed = measured(turned, np.ascontiguousarray(density.T)).generators
    assert difference(crossed[:, ::-1], straight) < 0.05


def test_a_lattice_that_is_not_trusted_is_still_told(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["hexagonal"], rng)
    result = lattice(image, density_of(image), LatticeParams(confidence=1.0))
    assert result.generators.shape == (0, 2)
    steps = np.rint(result.best @ np.linalg.inv(LATTICES["hexagonal"]))
    np.testing.assert_allclose(steps @ LATTICES["hexagonal"], result.best, atol=1)


def test_generators_are_not_shorter_than_asked(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    result = lattice(image, density_of(image), LatticeParams(min_length=50))
    assert np.hypot(*result.best.T).min() >= 50


def test_a_density_of_nothing_has_no_lattice(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    result = measured(image, np.zeros((289, 321), np.float32))
    assert result.generators.shape == result.best.shape == (0, 2)
    assert (result.confidence, result.score) == (0, 0)


STEPS = st.integers(-4, 4)


@given(st.sampled_from(sorted(LATTICES)), STEPS, STEPS, STEPS)
def test_reduction_finds_the_shortest_pair_of_any(name: str, i: int, j: int, k: int) -> None:
    """Whatever generators a lattice is given by."""
    whole = np.array([[1, i], [0, 1]]) @ np.array([[1, 0], [j, 1]]) @ np.array([[-1, k], [0, 1]])
    a, b = pair = reduced(whole @ LATTICES[name])
    assert difference(pair, LATTICES[name]) < 1e-9
    assert np.hypot(*a) <= np.hypot(*b) + 1e-9
    assert 2 * abs(a @ b) <= a @ a + 1e-6
    around = np.array([(i, j) for i in range(-4, 5) for j in range(-4, 5) if j]) @ pair
    assert np.hypot(*around.T).min() >= np.hypot(*b) - 1e-9
    assert all(tuple(np.rint(vector * 1e6)) > (0, 0) for vector in pair)


def test_reduction_of_a_lattice_that_is_reduced() -> None:
    np.testing.assert_array_equal(reduced(np.array([[0, 12], [10, 0]])), [[10, 0], [0, 12]])
    np.testing.assert_array_equal(reduced(np.array([[-10, 0], [0, -12]])), [[10, 0], [0, 12]])


def clear(tone: np.ndarray, generators: np.ndarray) -> float:
    return significance(self_correlation(detail(tone.astype(np.float32))), generators)


@pytest.mark.parametrize("name", LATTICES)
def test_a_lattice_under_noise_is_significant(name: str) -> None:
    """Though the picture is hardly like itself a cell away; and only where the generators are right."""
    generators = LATTICES[name]
    rng = np.random.default_rng(2)
    tone = stamped(generators, rng).pixels.mean(axis=2)
    noise = smooth_noise(tone.shape, 1.5, rng)
    noisy = 0.5 + 0.1 * ((tone - tone.mean()) / tone.std() + 1.5 * (noise - noise.mean()) / noise.std())
    image = picture(np.clip(noisy, 0, 1))
    result = measured(image, density_at(generators, image))
    assert result.confidence < 0.4
    assert result.significance > LatticeParams().significance
    np.testing.assert_array_equal(result.generators, result.best)
    assert difference(result.generators, generators) < 1
    assert clear(noisy, generators * 1.13) < 0.5 * result.significance
    strict = lattice(image, density_at(generators, image), LatticeParams(significance=99))
    assert strict.generators.shape == (0, 2)


@pytest.mark.parametrize("seed", range(8))
def test_no_lattice_of_noise_is_significant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tone = smooth_noise((200, 220), 3.0, rng)
    generators = rng.uniform(15, 40) * np.array([[1.0, rng.uniform(-0.3, 0.3)], [rng.uniform(-0.3, 0.3), 1.0]])
    assert clear(tone, generators) < 3


def test_what_repeats_along_a_line_is_no_lattice() -> None:
    """Stripes are as like themselves between the points of a lattice as there."""
    rng = np.random.default_rng(1)
    stripes = np.sin(np.arange(240) * 2 * np.pi / 20)[:, None] + 0.3 * smooth_noise((240, 240), 2.0, rng)
    assert clear(stripes, np.diag([20.0, 30.0])) < 1


def test_few_points_are_not_significant() -> None:
    cell = smooth_noise((70, 80, 3), 2.0, np.random.default_rng(1))
    few, enough = (tiled(cell, 0, (side, side))[0].pixels.mean(axis=2) for side in (170, 200))
    assert clear(few, np.diag([70.0, 80.0])) == -1
    assert clear(enough, np.diag([70.0, 80.0])) > 5
    # or all on a line
    assert clear(enough, np.diag([20.0, 160.0])) == -1
    assert clear(np.zeros((90, 90)), np.diag([12.0, 12.0])) == 0
