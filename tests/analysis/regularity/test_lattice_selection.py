from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import difference, masked, picture, smooth_noise, stamped, tiled, wall
from texloom.stages.analysis.regularity.lattice import Lattice
from texloom.stages.analysis.regularity.lattice_selection import (
    LatticeSelectionParams,
    lattice_selection,
    most_confident,
)
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.shown import periods_of_directions
from texloom.stages.common.grids import working_size
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.progress import listening

SQUARE, DOUBLE = (np.diag(sides).astype(np.float32) for sides in ((20.0, 20.0), (20.0, 40.0)))
NONE = np.zeros((0, 2), np.float32)

Given = tuple[np.ndarray, float, float]


def measured(best: np.ndarray, confidence: float, significance: float) -> Lattice:
    return Lattice(NONE, best, confidence, significance, 1.0)


@pytest.mark.parametrize(
    ("first", "second", "chosen"),
    [
        ((SQUARE, 0.6, 9.0), (DOUBLE, 0.5, 9.0), "features"),
        ((SQUARE, 0.5, 9.0), (DOUBLE, 0.6, 9.0), "autocorrelation"),
        ((DOUBLE, 0.6, 9.0), (SQUARE, 0.59, 9.0), "autocorrelation"),
        ((SQUARE, 0.59, 9.0), (DOUBLE, 0.6, 9.0), "features"),
        ((NONE, 0.0, 0.0), (SQUARE, 0.6, 9.0), "autocorrelation"),
        ((NONE, 0.0, 0.0), (NONE, 0.0, 0.0), "none"),
        # neither is sure, so the significant one, if there is one
        ((SQUARE, 0.3, 5.0), (DOUBLE, 0.2, 5.0), "none"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.2, 7.0), "autocorrelation"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.5, 2.5), "autocorrelation"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.5, 1.0), "features"),
        # of too few points to tell: only features that match are believed
        ((SQUARE, 0.5, -1.0), (DOUBLE, 0.1, -1.0), "features"),
        ((DOUBLE, 0.1, -1.0), (SQUARE, 0.5, -1.0), "none"),
        # of enough points, but no better than between them
        ((SQUARE, 0.5, 0.0), (DOUBLE, 0.1, 0.0), "none"),
        ((SQUARE, 0.4, 0.0), (DOUBLE, 0.5, 1.0), "none"),
    ],
)
def test_the_surer_lattice_is_taken(first: Given, second: Given, chosen: str) -> None:
    result = most_confident(
        {"features": measured(*first), "autocorrelation": measured(*second)}, LatticeSelectionParams()
    )
    assert result.chosen == chosen
    expected = {"features": first[0], "autocorrelation": second[0], "none": NONE}[chosen]
    np.testing.assert_array_equal(result.generators, expected)
    assert len(result.best) == (0 if not len(first[0]) + len(second[0]) else 2)
    if len(result.best):
        source = first if result.best is first[0] else second
        assert (result.confidence, result.significance) == source[1:]


def test_autocorrelation_finds_what_features_do_not(rng: np.random.Generator) -> None:
    exemplar, generators = tiled(smooth_noise((24, 30, 3), 4.0, rng), 0, (160, 170))
    nothing = np.zeros((161, 171), np.float32)
    result = lattice_selection(exemplar, nothing, LatticeSelectionParams())
    assert result.chosen == "autocorrelation"
    assert difference(result.generators, generators) < 0.5


def test_generators_hold_across_the_whole_exemplar(rng: np.random.Generator) -> None:
    spacing, shape = (31.83, 27.37), (256, 240)
    rows, columns = (
        np.exp(8 * np.cos(2 * np.pi * np.arange(side) / step) - 8)
        for side, step in zip(shape, spacing, strict=True)
    )
    studs = picture(0.2 + 0.5 * np.outer(rows, columns) * rng.uniform(0.5, 1, shape) + 0.1 * rng.random(shape))
    density = offset_statistics(studs, OffsetStatisticsParams()).density
    generators = lattice_selection(studs, density, LatticeSelectionParams()).generators
    cells = max(shape) / min(spacing)
    assert difference(generators, np.diag(spacing)) * cells < 0.5


def bricks(rng: np.random.Generator, shape: tuple[int, int] = (240, 260)) -> tuple[Image, np.ndarray]:
    """Bricks in a running bond, each of a random tone, with joints of a tone between theirs."""
    height, width = 24, 36
    row, column = np.indices(shape)
    course = row // height
    across = column + course % 2 * (width // 2)
    tones = rng.random((32, 32))[course, across // width]
    joint = (row % height < 3) | (across % width < 3)
    return picture(np.where(joint, 0.5, tones)), np.array([[height, width / 2], [0.0, width]])


def test_contours_repeat_where_lightness_does_not(rng: np.random.Generator) -> None:
    exemplar, generators = bricks(rng)
    density = offset_statistics(exemplar, OffsetStatisticsParams()).density
    result = lattice_selection(exemplar, density, LatticeSelectionParams())
    assert result.chosen == "gradients"
    steps = result.generators @ np.linalg.inv(generators)
    np.testing.assert_allclose(steps, np.rint(steps), atol=0.05)
    assert abs(np.linalg.det(steps)) < 7


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_contours_that_are_significant_need_less_confidence(seed: int) -> None:
    """As of worn or uneven elements."""
    rng = np.random.default_rng(seed)
    clean, generators = bricks(rng)
    worn = picture((clean.pixels[..., 0] + rng.normal(0, 0.1, clean.shape[:2])).clip(0, 1))
    density = offset_statistics(worn, OffsetStatisticsParams()).density
    result = lattice_selection(worn, density, LatticeSelectionParams())
    assert (result.chosen, result.confidence < 0.4) == ("gradients", True)
    assert difference(result.generators, generators) < 0.5


def test_masked_pixels_do_not_change_the_gradients(rng: np.random.Generator) -> None:
    exemplar, _ = bricks(rng)
    usable = np.ones((240, 260), bool)
    usable[60:110, 80:140] = False
    results = [
        lattice_selection(
            masked(exemplar, usable, value), np.zeros((241, 261), np.float32), LatticeSelectionParams()
        )
        for value in (0.0, 30.0)
    ]
    assert results[0].chosen == "gradients"
    np.testing.assert_array_equal(results[0].generators, results[1].generators)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fine_lattice_that_drifts_is_found(seed: int) -> None:
    """Its cells are in step with those nearby only."""
    rng = np.random.default_rng(seed)
    side, period = 400, 20
    moves = np.stack([smooth_noise((side, side), 60, rng) for _ in range(2)])
    row, column = np.rint(np.indices((side, side)) + 30 * moves).astype(int) % period
    cell = smooth_noise((period, period), 1.5, rng)
    exemplar = picture(0.3 + 0.3 * cell[row, column] + 0.1 * smooth_noise((side, side), 2, rng))
    result = lattice_selection(exemplar, np.zeros((side + 1, side + 1), np.float32), LatticeSelectionParams())
    assert result.chosen == "short offsets"
    assert difference(result.generators, np.diag([period, period])) < 2


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_grains_do_not_hide_joints(seed: int) -> None:
    y, x = np.indices((640, 800))
    down, across = y % 300, x % 380
    joints = (down < 14) | (across < 14) | ((np.abs(down - 110) < 7) & (across < 150))
    joints |= ((np.abs(across - 150) < 7) & (down < 220)) | ((np.abs(down - 220) < 7) & (across >= 150))
    grains = np.random.default_rng(seed).normal(size=joints.shape)
    exemplar = picture(np.clip(0.55 - 0.3 * joints + 0.4 * grains, 0, 1))
    density = offset_statistics(exemplar, OffsetStatisticsParams()).density
    result = lattice_selection(exemplar, density, LatticeSelectionParams())
    assert difference(result.generators, np.diag([300.0, 380.0])) < 2


def test_colours_of_every_third_row_are_kept(rng: np.random.Generator) -> None:
    """Contours repeat in every row of squares."""
    side = 24
    row, column = np.indices((260, 280))
    tones = rng.random((16, 16))
    tones[::3] = 0.9
    joint = (row % side < 3) | (column % side < 3)
    exemplar = picture(np.where(joint, 0.5, tones[row // side, column // side]))
    result = lattice_selection(exemplar, np.zeros((261, 281), np.float32), LatticeSelectionParams())
    assert result.chosen == "gradients"
    assert difference(result.generators, np.diag([3 * side, side])) < 1


def test_courses_are_one_generator(rng: np.random.Generator) -> None:
    exemplar = wall((240, 270), 24, 0, rng)
    density = offset_statistics(exemplar, OffsetStatisticsParams()).density
    result = lattice_selection(exemplar, density, LatticeSelectionParams())
    assert result.chosen == "courses"
    np.testing.assert_allclose(result.generators, [[24, 0]], atol=0.5)
    unwanted = lattice_selection(exemplar, density, LatticeSelectionParams(courses=False))
    assert (unwanted.chosen, len(unwanted.generators)) == ("none", 0)


@pytest.mark.parametrize("upright", [True, False])
def test_lines_at_uneven_distances_are_one_generator(upright: bool, rng: np.random.Generator) -> None:
    """Joints of planks, of which the last but one is 150 px from the first."""
    plane = 0.4 + 0.1 * smooth_noise((200, 220), 2.0, rng)
    for joint in (20, 47, 83, 105, 138, 170, 217):
        plane[:, joint : joint + 3] = 0.05
    exemplar, nothing = picture(plane if upright else plane.T), np.zeros((201, 201), np.float32)
    result = lattice_selection(exemplar, nothing, LatticeSelectionParams(lines=True))
    assert result.chosen == "lines"
    np.testing.assert_allclose(result.generators, [[0, 150] if upright else [150, 0]], atol=1)
    assert lattice_selection(exemplar, nothing, LatticeSelectionParams()).chosen == "none"


@pytest.mark.parametrize("upright", [True, False])
def test_lines_of_large_exemplars_are_exact_to_a_pixel(
    upright: bool, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(working_size, "MOST_PIXELS", 40_000)
    plane = 0.4 + 0.1 * smooth_noise((400, 441), 4.0, rng)
    for joint in (60, 95, 150, 210, 361, 396):
        plane[:, joint : joint + 6] = 0.05
    exemplar, nothing = picture(plane if upright else plane.T), np.zeros((201, 201), np.float32)
    result = lattice_selection(exemplar, nothing, LatticeSelectionParams(lines=True, courses=False))
    assert result.chosen == "lines"
    np.testing.assert_array_equal(result.generators, [[0, 301] if upright else [301, 0]])


def test_grain_is_a_pattern_of_lines(rng: np.random.Generator) -> None:
    """Bands that waver, of which those of the first 50 px follow the last ones."""
    bands = 0.3 + 0.3 * smooth_noise((150, 1), 4.0, rng)
    row, column = np.indices((200, 220))
    plane = np.concatenate([bands, bands[:50]])[np.clip(row + (2 * np.sin(column / 20)).astype(int), 0, 199), 0]
    exemplar, nothing = picture(plane + 0.04 * rng.random(plane.shape)), np.zeros((201, 221), np.float32)
    result = lattice_selection(exemplar, nothing, LatticeSelectionParams(lines=True, courses=False))
    assert result.chosen == "lines"
    np.testing.assert_allclose(result.generators, [[150, 0]], atol=2)


def test_a_single_line_is_no_pattern(rng: np.random.Generator) -> None:
    plane = 0.4 + 0.1 * smooth_noise((200, 220), 2.0, rng)
    plane[:, 100:110] = 0.05
    nothing = np.zeros((201, 221), np.float32)
    assert lattice_selection(picture(plane), nothing, LatticeSelectionParams(lines=True)).chosen == "none"


def shown(image: Image) -> float:
    density = offset_statistics(image, OffsetStatisticsParams()).density
    return lattice_selection(image, density, LatticeSelectionParams()).shown


def test_periods_are_counted(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    """Those in the direction in which there are fewest."""
    tiles, _ = tiled(smooth_noise((24, 30, 3), 3.0, rng), 0, (96, 150))
    assert shown(tiles) == pytest.approx(4, abs=0.1)
    assert shown(wall((240, 270), 24, 0, rng)) == pytest.approx(10, abs=0.2)
    assert not caplog.records


@pytest.mark.parametrize("seed", [0, 1])
def test_structure_that_shows_less_than_twice_is_a_warning(seed: int, caplog: pytest.LogCaptureFixture) -> None:
    """One round motif in the middle, and many of the same."""
    rng = np.random.default_rng(seed)
    many = picture(smooth_noise((256, 256), 3.0, rng))
    assert shown(many) > 4
    assert not caplog.records
    row, column = np.indices((256, 256)) - 128
    motif = 0.4 + 0.3 * np.sin(np.hypot(row, column) / 3) * (np.hypot(row, column) < 80)
    assert 0 < shown(picture(motif + 0.02 * rng.random((256, 256)))) < 2
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "shows its structure about" in caplog.text


def zigzag(shape: tuple[int, int], period: int, rng: np.random.Generator) -> Image:
    """Planks 24 px wide in a herringbone whose rows are half a period wide, with a short joint each 24 px along."""
    row, column = np.indices(shape)
    turned = (column // (period // 2)) % 2 == 1
    across, along = np.where(turned, row + column, row - column), np.where(turned, row - column, row + column)
    number = across // 34
    is_joint = (across % 34 < 4) | ((along % 34 < 4) & (number % 2 == 0))
    tone = 0.3 + 0.05 * rng.random(200)[number % 200]
    return picture(np.where(is_joint, 0.02, tone) + 0.01 * rng.random(shape))


@pytest.mark.parametrize(("period", "expected"), [(300, 1.0), (150, 2.0), (120, 2.5)])
def test_periods_are_of_directions_that_change(period: int, expected: float, rng: np.random.Generator) -> None:
    """The planks' width repeats in both rows of a herringbone, also where it shows one pair of rows."""
    generators = np.array([[17.0, 17.0], [17.0, -17.0]], np.float32)
    lightness = lab_from_linear(zigzag((220, 300), period, rng).color)[..., 0]
    assert periods_of_directions(lightness, generators) == pytest.approx(expected, abs=0.4)
    weave = tiled(smooth_noise((24, 30, 3), 3.0, rng), 0, (120, 150))[0]
    lightness = lab_from_linear(weave.color)[..., 0]
    assert periods_of_directions(lightness, np.array([[24, 0], [0, 30]], np.float32)) == np.inf


def test_one_pair_of_rows_of_a_herringbone_is_a_warning(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    assert 1 <= shown(zigzag((220, 300), 300, rng)) < 2
    assert "shows its structure about" in caplog.text


def stones(number: int, rng: np.random.Generator) -> Image:
    """Stones of different tones that fill a square, with joints between them."""
    side = 256
    grid = int(np.ceil(np.sqrt(number)))
    centres = np.stack(np.divmod(np.arange(number), grid), axis=1) + 0.5 + rng.uniform(-0.25, 0.25, (number, 2))
    pixels = np.moveaxis(np.indices((side, side)), 0, 2)[:, :, None] * (grid / side)
    distances = np.hypot(*np.moveaxis(pixels - centres, 3, 0))
    near = np.sort(distances, axis=2)
    tone = rng.uniform(0.2, 0.8, number)[distances.argmin(axis=2)]
    return picture(
        np.where(near[..., 1] - near[..., 0] < 6 * grid / side, 0.02, tone) + 0.01 * rng.random((side, side))
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_fewer_than_four_elements_are_a_warning(seed: int, caplog: pytest.LogCaptureFixture) -> None:
    nothing = np.zeros((257, 257), np.float32)
    many, few = (stones(number, np.random.default_rng(seed)) for number in (25, 3))
    assert lattice_selection(many, nothing, LatticeSelectionParams()).cells > 8
    assert not caplog.records
    assert 2 < lattice_selection(few, nothing, LatticeSelectionParams()).cells < 4
    assert "elements, fewer than four" in caplog.text


def test_cells_are_counted(rng: np.random.Generator) -> None:
    tiles, _ = tiled(smooth_noise((50, 60, 3), 3.0, rng), 0, (150, 150))
    result = lattice_selection(tiles, np.zeros((151, 151), np.float32), LatticeSelectionParams())
    assert result.cells == pytest.approx(7.5, abs=0.2)


def test_an_exemplar_without_variation_is_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    assert shown(picture(np.full((64, 64), 0.4))) == 0
    assert not caplog.records


def test_a_tiny_exemplar_has_no_lattice() -> None:
    result = lattice_selection(picture(np.zeros((3, 5))), np.zeros((3, 5), np.float32), LatticeSelectionParams())
    assert len(result.generators) == 0


def test_noise_has_none(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((160, 170, 3)), 0, (160, 170))
    result = lattice_selection(exemplar, np.zeros((161, 171), np.float32), LatticeSelectionParams())
    assert (result.chosen, len(result.generators)) == ("none", 0)


def ornament(rng: np.random.Generator, shape: tuple[int, int] = (160, 180)) -> Image:
    """A single figure that is symmetric about an upright axis, as of a damask."""
    half = smooth_noise((shape[0], shape[1] // 2), 9.0, rng) > 0.5
    figure = np.concatenate([half, half[:, ::-1]], axis=1)
    return picture(0.2 + 0.4 * figure + 0.02 * rng.normal(size=shape))


def test_a_single_ornament_is_shown_once(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    nothing = np.zeros((161, 181), np.float32)
    result = lattice_selection(ornament(rng), nothing, LatticeSelectionParams())
    assert result.chosen == "none"
    assert result.shown == 1.0
    assert "fewer than two" in caplog.text


@pytest.mark.parametrize("sigma", [2.0, 6.0])
def test_random_textures_and_stripes_are_no_ornaments(sigma: float, rng: np.random.Generator) -> None:
    nothing = np.zeros((161, 181), np.float32)
    random = picture(smooth_noise((160, 180), sigma, rng))
    stripes = picture(smooth_noise((160, 1), sigma, rng).repeat(180, 1) + 0.02 * rng.normal(size=(160, 180)))
    for image in (random, stripes):
        result = lattice_selection(image, nothing, LatticeSelectionParams())
        assert (result.chosen, result.shown != 1.0) == ("none", True)


@pytest.mark.parametrize("turn", [False, True])
def test_generators_of_large_exemplars_are_as_exact(
    turn: bool, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    true = np.array([[40.3, 7.2], [-9.1, 50.6]])
    image = stamped(true[:, ::-1] if turn else true, rng, (360, 420))
    true = true[:, ::-1] if turn else true
    monkeypatch.setattr(working_size, "MOST_PIXELS", 20_000)
    density = offset_statistics(image, OffsetStatisticsParams()).density
    assert density.shape == (121, 141)
    found = lattice_selection(image, density, LatticeSelectionParams())
    assert difference(found.generators, true) < 0.03
    assert found.cells == pytest.approx(360 * 420 / abs(np.linalg.det(true)), rel=0.01)


@pytest.mark.parametrize("repeats", [True, False])
@pytest.mark.parametrize("most_pixels", [20_000, 200_000])
def test_the_search_reports_its_progress(
    repeats: bool, most_pixels: int, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(working_size, "MOST_PIXELS", most_pixels)
    image = stamped(np.array([[40.0, 0.0], [0.0, 50.0]]), rng) if repeats else picture(rng.random((330, 340)))
    density = offset_statistics(image, OffsetStatisticsParams()).density
    done: list[float] = []
    with listening(lambda progress: done.append(progress.done)):
        lattice_selection(image, density, LatticeSelectionParams())
    assert len(done) > 5
    assert done == sorted(done)
    assert done[-1] == 1.0


def test_a_period_that_is_known_is_taken(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = picture(smooth_noise((100, 120), 2, rng))
    density = np.zeros((100, 120), np.float32)
    known = np.array([[50, 0]], np.float32)
    selected = lattice_selection(image, density, LatticeSelectionParams(), known=known)
    np.testing.assert_array_equal(selected.generators, known)
    assert (selected.chosen, selected.shown) == ("known", pytest.approx(2))
    assert "about 2.0 periods, fewer than four" in caplog.text
    assert not len(lattice_selection(image, density, LatticeSelectionParams(), known=known[:0]).generators)
