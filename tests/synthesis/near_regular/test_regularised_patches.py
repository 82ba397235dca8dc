from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_progress
from tests.synthetic import LATTICES, bent, difference, tiled, wall
from tests.tilings import hexagons, mixed_share, painted, running_bond
from tests.wraps import X, Y
from texloom.stages.analysis.regularity.deformed_lattice import (
    DeformedLattice,
    DeformedLatticeParams,
    deformed_lattice,
)
from texloom.stages.analysis.regularity.lattice import reduced
from texloom.stages.analysis.regularity.straighten import Straightened, straighten
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline
from texloom.stages.synthesis.near_regular.exemplar_textons import Blend, Textons, find_textons
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice
from texloom.stages.synthesis.near_regular.regularised_patches import (
    RegularisedPatches,
    RegularisedPatchesParams,
    regularised_patches,
)
from texloom.stages.synthesis.near_regular.texton_choice import TextonChoice
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, NoParams


@dataclass
class Analysed:
    """An exemplar with its lattice."""

    image: Image
    lattice: DeformedLattice
    straight: Straightened

    @classmethod
    def of(cls, image: Image, generators: np.ndarray) -> Analysed:
        lattice = deformed_lattice(image, DeformedLatticeParams(), generators.astype(np.float32))
        return cls(image, lattice, straighten(image, lattice.vertices, lattice.regular, NoParams()))

    def texture(self, **params: Any) -> RegularisedPatches:
        params = {"size": (110, 130), **params}
        lattice = self.lattice
        return regularised_patches(
            self.image, self.straight.source, lattice.generators, lattice.steps, lattice.vertices, lattice.regular,
            RegularisedPatchesParams(**params), np.random.default_rng(1), lattice.courses,
        )  # fmt: skip


def periodic(drop: int) -> Analysed:
    cell = np.random.default_rng(8).random((20, 26, 3))
    image, generators = tiled(cell, drop, (120, 150))
    return Analysed.of(image, generators)


@pytest.fixture(scope="module")
def curved() -> Analysed:
    generators = 0.6 * LATTICES["sheared"]
    image, _ = bent(generators, np.random.default_rng(5), height=2.0)
    return Analysed.of(image, generators)


@pytest.mark.parametrize("drop", [0, 7])
def test_a_periodic_texture_is_continued(drop: int) -> None:
    """All textons are equal, so whichever is chosen the result is the exemplar's one pattern."""
    exemplar = periodic(drop)
    assert exemplar.lattice.deviation < 0.02
    result = exemplar.texture()
    pixels = result.image.pixels
    for down, across in ((20, drop), (0, 26)):
        moved = pixels[down:, across:]
        np.testing.assert_allclose(moved, pixels[: 110 - down, : 130 - across], atol=0.02)
    copied = exemplar.image.pixels[result.match[..., 0], result.match[..., 1]]
    # match is the nearest pixel, up to half of one away
    assert np.median(np.abs(copied - pixels)) < 0.25


def test_courses_are_laid_with_a_free_phase() -> None:
    """Their borders are straight and even, and textons begin anywhere along them."""
    exemplar = wall((200, 220), 20, 0, np.random.default_rng(3))
    result = Analysed.of(exemplar, np.float32([[20, 0]])).texture(size=(160, 180), strength=0.0)
    moves = result.match.astype(int) - np.moveaxis(np.indices((160, 180)), 0, -1)
    drift = (moves[..., 0] - moves[0, 0, 0]) / 20
    assert np.abs(drift - np.rint(drift)).max() < 0.15
    assert len(np.unique(moves[..., 1])) > 10


def test_tileable_continues_across_borders() -> None:
    exemplar = periodic(7)
    result = exemplar.texture(size=(100, 130), tileable=True, strength=0)
    pixels = result.image.pixels
    assert result.image.wraps.both
    np.testing.assert_allclose(pixels, np.roll(pixels, (0, 26), (0, 1)), atol=0.02)
    if np.allclose(result.generators @ np.linalg.inv([[20, 7], [0, 26]]) % 1, 0, atol=1e-3):
        np.testing.assert_allclose(pixels, np.roll(pixels, (20, 7), (0, 1)), atol=0.02)


def test_the_deformation_wraps_too(curved: Analysed) -> None:
    """The step from the last row and column to the first is no larger than the others."""
    result = curved.texture(tileable=True)
    for plane in (result.displacement, result.image.pixels):
        for axis in (0, 1):
            steps = np.abs(plane - np.roll(plane, 1, axis)).mean(axis=(1 - axis, 2))
            assert steps[0] <= 1.1 * steps[1:].max()
    away = np.hypot(*np.moveaxis(result.displacement, 2, 0))
    assert 0.3 < away.mean() < 6


def test_a_result_may_continue_along_one_axis(curved: Analysed) -> None:
    for wrap in (X, Y):
        result = curved.texture(tileable=wrap)
        assert result.image.wraps == wrap
        size = result.image.pixels.shape[:2]
        assert result.match.shape[:2] == result.displacement.shape[:2] == size
        axis = int(wrap == X)
        steps = np.abs(result.displacement - np.roll(result.displacement, 1, axis)).mean(axis=(1 - axis, 2))
        assert steps[0] <= 1.1 * steps[1:].max()


def test_strength(curved: Analysed) -> None:
    none, half, full = (curved.texture(strength=strength) for strength in (0.0, 0.5, 1.0))
    assert not none.displacement.any()
    ratio = np.abs(half.displacement).mean() / np.abs(full.displacement).mean()
    assert 0.4 < ratio < 0.6
    assert difference(none.generators, 0.6 * LATTICES["sheared"]) < 0.5


def test_the_deformation_never_folds(curved: Analysed) -> None:
    places = np.moveaxis(np.indices((110, 130)), 0, -1) + curved.texture(strength=2).displacement
    down, across = np.diff(places, axis=0)[:, :-1], np.diff(places, axis=1)[:-1]
    assert (down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0]).min() > 0


def test_a_regular_result_has_the_exemplars_lattice(curved: Analysed) -> None:
    """Elements that were bent out of line are in line again: cells of the result resemble each other more."""

    def unlike(pixels: np.ndarray, generators: np.ndarray) -> float:
        down, across = np.rint(np.abs(generators).max(axis=0)).astype(int)
        steps = [np.rint(step).astype(int) for step in generators]
        moved = [np.roll(pixels, tuple(step), (0, 1)) for step in steps]
        return float(np.mean([np.abs(other - pixels)[down:-down, across:-across].mean() for other in moved]))

    regular = curved.texture(strength=0).image.pixels
    exemplar = curved.image.pixels
    assert unlike(regular, curved.lattice.generators) < 0.9 * unlike(exemplar, curved.lattice.generators)


@pytest.mark.parametrize(
    ("size", "tileable"), [((40, 50), False), ((37, 160), True), ((160, 37), False), ((97, 101), True)]
)
def test_every_size_is_filled(curved: Analysed, size: tuple[int, int], tileable: bool) -> None:
    result = curved.texture(size=size, tileable=tileable)
    assert result.image.pixels.shape[:2] == result.match.shape[:2] == result.displacement.shape[:2] == size
    assert result.image.pixels.min() >= curved.image.pixels.min() - 1e-6
    assert result.image.pixels.max() <= curved.image.pixels.max() + 1e-6
    assert (result.match < [curved.image.height, curved.image.width]).all()
    copied = curved.image.pixels[result.match[..., 0], result.match[..., 1]]
    assert np.abs(copied - result.image.pixels).mean() < 0.08  # nothing is left empty


def test_textons_fit_or_are_used_evenly(rng: np.random.Generator) -> None:
    """By the tolerance; none is laid beside itself without need."""
    costs = (rng.random((12, 12), dtype=np.float32), rng.random((12, 12), dtype=np.float32))
    levels = (np.ones(12, np.float32), np.ones(12, np.float32))
    cells = np.array([[20.0, 4.0], [-3.0, 25.0]])
    blend = Blend.of(CellOutline.rectangle(cells, (0.0, 0.0)), 0.2)
    textons = Textons(cells, np.zeros((12, 2)), np.zeros(2), ((1, 0), (0, 1)), costs, levels, blend)
    lattice = OutputLattice.of(cells, (300, 300), True)
    after = lattice.neighbours(((1, 0), (0, 1)))

    def laid(tolerance: float) -> tuple[np.ndarray, float, float]:
        chosen = TextonChoice(textons, lattice, tolerance, rng).run()
        pairs = [(chosen, chosen[after[:, axis]]) for axis in (0, 1)]
        cost = np.mean([costs[axis][pair].mean() for axis, pair in enumerate(pairs)])
        return np.bincount(chosen, minlength=12), float(cost), float(np.mean([(a == b).mean() for a, b in pairs]))

    even, loose, beside = laid(1.0)
    uneven, strict, _ = laid(0.0)
    assert even.max() < 1.3 * even.mean()
    assert even.std() < 0.5 * uneven.std()
    assert strict < 0.8 * loose
    assert strict < 0.35
    assert beside < 0.02


def test_cells_are_cut_where_they_are_alike() -> None:
    """Bright random squares on one dark grid: borders of textons run along the grid."""
    rng = np.random.default_rng(9)
    pixels = np.full((150, 180, 3), 0.02)
    for row in range(0, 150, 25):
        for column in range(0, 180, 30):
            pixels[row + 4 : row + 23, column + 4 : column + 28] = rng.random(3)
    lab = lab_from_linear(pixels.astype(np.float32))
    source = np.moveaxis(np.indices((150, 180)), 0, -1).astype(np.float32)
    textons = find_textons(lab, source, np.array([[25.0, 0.0], [0.0, 30.0]]), np.array([11.0, 17.0]), 0.1, rng)
    assert textons is not None
    assert difference(reduced(textons.generators), np.array([[25.0, 0.0], [0.0, 30.0]])) < 1e-9
    # those which weigh most change where the grid is
    owner = textons.blend.weights.argmax(axis=2)
    for axis, (side, joint) in enumerate(((25, 6), (30, 6))):
        jumps = np.argwhere(np.diff(owner, axis=axis) != 0)[:, axis] + 1
        place = ((jumps / owner.shape[axis]) * side + (11, 17)[axis]) % side
        assert len(jumps) >= owner.shape[1 - axis]
        assert (((place + 2) % side) < joint + 2).all()
    # all agree where they meet
    assert max(float(costs.max()) for costs in textons.costs) < 1
    assert len(textons.places) >= 16


def test_cells_of_many_maps(rng: np.random.Generator) -> None:
    """Twice the same planes: the same cells, at twice the cost. Cells are longer than they are compared at."""
    lab = lab_from_linear(tiled(rng.random((60, 70, 3)), 0, (150, 180))[0].pixels)
    lab += rng.normal(0, 5, lab.shape).astype(np.float32)
    source = np.moveaxis(np.indices((150, 180)), 0, -1).astype(np.float32)
    generators = np.array([[60.0, 0.0], [0.0, 70.0]])
    one, two = (
        find_textons(planes, source, generators, np.zeros(2), 0.1, rng)
        for planes in (lab, np.concatenate([lab, lab], axis=2))
    )
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(two.places, one.places)
    np.testing.assert_allclose(two.costs[0], 2 * one.costs[0], rtol=1e-6)
    assert one.costs[0].max() > 1


def test_a_tileable_result_must_hold_a_cell(curved: Analysed) -> None:
    with pytest.raises(InputError, match="smaller than a cell of the lattice, so it cannot tile"):
        curved.texture(size=(16, 16), tileable=True)


def test_progress_goes_from_the_start_to_the_end() -> None:
    _, reports = run_with_progress(periodic(0).texture)
    done = [report.done for report in reports]
    assert done == sorted(done)
    assert done[0] < 0.5
    assert done[-1] == 1.0


@pytest.mark.parametrize(
    ("label", "generators"),
    [hexagons((190, 200), 20.0), running_bond((180, 200), 20, 44)],
    ids=["hexagons", "running bond"],
)
def test_tiles_of_any_shape_stay_whole(label: np.ndarray, generators: np.ndarray, rng: np.random.Generator) -> None:
    result = Analysed.of(painted(label, rng), generators).texture(size=(220, 220), strength=0.0)
    assert mixed_share(label, result.match) < 0.03
    assert len(np.unique(label[result.match[..., 0].astype(int), result.match[..., 1].astype(int)])) > 20
