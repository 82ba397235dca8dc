from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import LATTICES, continued, picture, points, smooth_noise, tiled, wall
from tests.tilings import basket_weave, blocks, herringbone, hexagons, mixed_share, painted
from tests.wraps import X, Y
from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.common.grids.border_steps import border_steps
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline
from texloom.stages.synthesis.near_regular.course_cells import course_cells
from texloom.stages.synthesis.near_regular.lattice_tiles import Window
from texloom.stages.synthesis.near_regular.near_regular import NearRegular, NearRegularParams, near_regular
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps


def texture(image: Image, generators: np.ndarray, **params: Any) -> NearRegular:
    params = {"size": (150, 170), **params}
    vertices = points(generators, (image.height, image.width), np.array([3.0, 5.0])).astype(np.float32)
    rng = np.random.default_rng(1)
    return near_regular(image, generators.astype(np.float32), vertices, NearRegularParams(**params), rng)


def waves_at(positions: np.ndarray, generators: np.ndarray) -> np.ndarray:
    """A smooth function in -1..1 with the periods ``generators``."""
    first, second = np.moveaxis(2 * np.pi * positions @ np.linalg.inv(generators), -1, 0)
    return np.asarray((np.sin(first) + np.cos(second) + np.sin(first + second)) / 3)


def waves(generators: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    return waves_at(np.moveaxis(np.indices(shape), 0, -1), generators)


@pytest.fixture
def bricks(rng: np.random.Generator) -> tuple[Image, np.ndarray]:
    """Cells that are alike up to noise; five channels."""
    image, generators = tiled(smooth_noise((26, 30, 3), 2.0, rng), 15, (120, 140))
    pixels = np.concatenate([image.pixels, rng.random((120, 140, 2))], axis=2) + rng.normal(0, 0.01, (120, 140, 5))
    return Image(pixels.astype(np.float32), ("R", "G", "B", "metallic", "height")), generators


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("size", [(64, 96), (151, 203)])
def test_every_pixel_is_the_one_that_match_says(
    bricks: tuple[Image, np.ndarray], size: tuple[int, int], tileable: bool
) -> None:
    image, generators = bricks
    result = texture(image, generators, size=size, tileable=tileable, blend=0)
    assert result.match.shape == (*size, 2)
    assert (result.match < (image.height, image.width)).all()
    expected = image.pixels[result.match[..., 0], result.match[..., 1]]
    np.testing.assert_array_equal(result.image.pixels, expected)
    assert result.image.channels == image.channels
    assert result.image.wraps.both is tileable


def test_blending_changes_only_what_is_beside_cuts(bricks: tuple[Image, np.ndarray]) -> None:
    import cv2

    image, generators = bricks
    result = texture(image, generators, blend=1, size=(128, 128))
    copied = image.pixels[result.match[..., 0], result.match[..., 1]]
    moves = result.match.astype(int) - np.indices((128, 128)).transpose(1, 2, 0)
    cut = np.zeros((128, 128), np.uint8)
    for axis in (0, 1):
        jump = (np.diff(moves, axis=axis) != 0).any(axis=2)
        cut[tuple(np.argwhere(jump).T)] = 1
    away = cv2.dilate(cut, np.ones((9, 9), np.uint8)) == 0
    assert away.mean() > 0.05
    # Some cuts were laid over later, which leaves a few pixels beside them.
    assert (result.image.pixels[away] != copied[away]).mean() < 0.02
    assert (result.image.pixels != copied).any()


@pytest.mark.parametrize(
    ("cell", "drop", "size", "tileable"),
    [
        ((13, 17), 0, (150, 170), False),
        ((26, 30), 15, (150, 170), False),
        ((20, 19), 3, (150, 170), False),
        ((12, 16), 8, (96, 112), True),
    ],
)
def test_an_exact_tiling_is_continued_exactly(
    cell: tuple[int, int], drop: int, size: tuple[int, int], tileable: bool, rng: np.random.Generator
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, generators = tiled(pattern, drop, (96, 110))
    result = texture(exemplar, generators, size=size, tileable=tileable, blend=0)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    moves = (result.match.astype(int) - np.indices(size).transpose(1, 2, 0)).reshape(-1, 2)
    assert len(np.unique(moves, axis=0)) > 3  # more than one tile


@pytest.mark.parametrize("name", ["half_drop", "hexagonal", "sheared"])
def test_rotated_lattices_do_not_drift(name: str) -> None:
    """Far from where it began, the result is still in step, to the pixel by which tiles may move here."""
    generators = LATTICES[name] * 0.6
    size = (128, 400)
    exemplar = picture(0.5 + 0.4 * waves(generators, (140, 150)))
    result = texture(exemplar, generators, size=size, shift=1)
    candidates = waves(generators, (size[0] + 80, size[1] + 80))
    tone = result.image.pixels[..., 0] * 2.5 - 1.25
    start = tone[:60, :60]
    errors = {
        (i, j): float(((candidates[i : i + 60, j : j + 60] - start) ** 2).mean())
        for i in range(80)
        for j in range(80)
    }
    i, j = min(errors, key=lambda at: errors[at])
    expected = candidates[i : i + size[0], j : j + size[1]]
    assert np.sqrt(((tone - expected) ** 2)[:, -60:].mean()) < 0.3 * expected.std()  # a pixel out of step: 0.26


@pytest.mark.parametrize("name", ["rectangular", "sheared"])
def test_a_tileable_result_has_a_lattice_that_wraps(name: str) -> None:
    generators = LATTICES[name] * 0.6
    exemplar = picture(0.5 + 0.4 * waves(generators, (140, 150)))
    result = texture(exemplar, generators, size=(130, 210), tileable=True)
    turns = np.diag([130.0, 210.0]) @ np.linalg.inv(result.generators.astype(float))
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-3)
    tone = result.image.pixels[..., 0]
    for axis in (0, 1):
        across = np.abs(tone.take(0, axis) - tone.take(-1, axis)).mean()
        assert across < 1.5 * np.abs(np.diff(tone, axis=axis)).mean()


@pytest.mark.parametrize("wrap", [X, Y])
def test_a_result_may_continue_along_one_axis(wrap: Wraps) -> None:
    """With a cell and a half of the lattice along the other one, whose borders then do not fit."""
    generators = LATTICES["rectangular"] * 0.6
    exemplar = picture(0.5 + 0.4 * waves(generators, (140, 150)))
    height, width = (round(one) for one in np.diag(generators) * (3.5, 4.5))
    made = texture(exemplar, generators, size=(height, width), tileable=wrap).image
    assert made.wraps == wrap
    assert made.pixels.shape[:2] == (height, width)
    steps = border_steps(made)
    assert steps[wrap.across] < 1.6
    assert steps[wrap.down] > 2


def bent(generators: np.ndarray, shape: tuple[int, int]) -> tuple[Image, np.ndarray]:
    """Waves whose lattice bends by up to 3 px, and where each pixel of the straight picture lies in it."""

    def away(places: np.ndarray) -> np.ndarray:
        return 3 * np.stack([np.sin(places[..., 1] / 17), np.cos(places[..., 0] / 23)], axis=-1)

    grid = np.moveaxis(np.indices(shape), 0, -1).astype(float)
    back = grid
    for _ in range(30):
        back = grid - away(back)
    return picture(0.5 + 0.4 * waves_at(back, generators)), (grid + away(grid)).astype(np.float32)


def test_tiles_of_a_straightened_exemplar_fit() -> None:
    generators = LATTICES["half_drop"] * 0.6
    exemplar, source = bent(generators, (140, 150))
    regular = points(generators, (140, 150), np.array([3.0, 5.0]))
    moved = source[tuple(np.clip(np.rint(regular), 0, (139, 149)).astype(int).T)]
    params = NearRegularParams(size=(90, 110), blend=0)
    frame = generators.astype(np.float32)
    deviations = []
    for vertices, positions in ((moved, None), (regular.astype(np.float32), source)):
        result = near_regular(exemplar, frame, vertices, params, np.random.default_rng(3), positions)
        tone = result.image.pixels[..., 0] * 2.5 - 1.25
        whole = waves(generators, (160, 180))
        errors = [((whole[i : i + 90, j : j + 110] - tone) ** 2).mean() for i in range(40) for j in range(40)]
        deviations.append(float(np.sqrt(min(errors)) / whole.std()))
        # the pixels at match are similar
        steep = np.abs(np.gradient(exemplar.pixels[..., 0])).max()
        copied = exemplar.pixels[result.match[..., 0], result.match[..., 1]]
        assert np.abs(result.image.pixels - copied).max() <= (0 if positions is None else 1.5 * steep)
    assert deviations[1] < 0.15
    assert deviations[1] < 0.6 * deviations[0]


def test_no_tile_reaches_beyond_what_is_straightened(rng: np.random.Generator) -> None:
    """A straightened exemplar shows its border again where it would show what lies beyond."""
    pattern = smooth_noise((20, 24, 3), 2.0, rng)
    exemplar, generators = tiled(pattern, 0, (120, 144))
    source = np.moveaxis(np.indices((120, 144)), 0, -1).astype(np.float32) + np.array([0, 30], np.float32)
    vertices = points(generators, (120, 144), np.zeros(2)).astype(np.float32)

    def straightened(source: np.ndarray) -> NearRegular:
        params = NearRegularParams(size=(64, 72), blend=0)
        return near_regular(exemplar, generators, vertices, params, np.random.default_rng(1), source)

    result = straightened(source)
    assert (result.match[..., 1] >= 30).all()
    assert (result.match[..., 1] < 143).all()
    np.testing.assert_allclose(
        result.image.pixels, exemplar.pixels[result.match[..., 0], result.match[..., 1]], atol=1e-6
    )
    with pytest.raises(InputError, match="no whole cell"):
        straightened(source + np.array([0, 200], np.float32))
    with pytest.raises(ValueError, match="source"):
        straightened(source[:-1])


def test_tiles_are_used_about_equally_and_not_side_by_side(rng: np.random.Generator) -> None:
    """Each cell has its own tint."""
    cell, (rows, columns) = 20, (6, 7)
    tint = np.repeat(np.repeat(np.arange(42.0).reshape(6, 7), cell, 0), cell, 1)
    pattern, _ = tiled(smooth_noise((cell, cell, 1), 2.0, rng), 0, (rows * cell, columns * cell))
    exemplar = picture(0.3 + 0.3 * pattern.pixels[..., :1] + 1e-4 * tint[..., None])
    result = texture(exemplar, np.array([[cell, 0.0], [0.0, cell]]), size=(240, 240))
    match = result.match.astype(int)
    kind = match[..., 0] // cell * columns + match[..., 1] // cell
    shares = np.bincount(kind.ravel(), minlength=42) / kind.size
    assert result.tiles >= 16
    assert (shares > 0).sum() >= result.tiles
    assert shares.max() < 0.12
    moves = match - np.indices((240, 240)).transpose(1, 2, 0)
    same = [
        (moves[40 : 40 + 160, 40 : 40 + 160] == moves[40 + i : 200 + i, 40 + j : 200 + j] + (i, j))
        .all(axis=2)
        .mean()
        for i, j in ((cell, 0), (0, cell))
    ]
    assert max(same) < 0.1


@pytest.mark.parametrize("tileable", [False, True])
def test_courses_are_laid_with_a_free_phase(tileable: bool, rng: np.random.Generator) -> None:
    """Borders between courses stay straight and even, and tiles begin anywhere along them."""
    period, size = 20, (200, 240)
    exemplar = wall((200, 220), period, 0, rng)
    lattice = deformed_lattice(exemplar, DeformedLatticeParams(), np.float32([[period, 0]]))
    params = NearRegularParams(size=size, tileable=tileable, blend=0)
    result = near_regular(
        exemplar, lattice.generators, lattice.regular, params, np.random.default_rng(1), courses=lattice.courses
    )
    match = result.match.astype(int)
    moves = match - np.moveaxis(np.indices(size), 0, -1)
    drift = (moves[..., 0] - moves[0, 0, 0]) / period
    assert np.abs(drift - np.rint(drift)).max() < 0.1
    assert len(np.unique(moves[..., 1])) > 10
    dark = result.image.pixels[..., 0].mean(axis=1) < 0.25
    assert dark.sum() == pytest.approx(0.12 * size[0], abs=0.06 * size[0])
    assert result.tiles > 6


def test_windows_cover_the_plane() -> None:
    """Without overlap each pixel is in one tile."""
    generators = np.array([[20.0, 7.0], [-5.0, 24.0]])
    window = Window.of(CellOutline.rectangle(generators, (0.0, 0.0)), 0.0)
    assert abs(len(window.offsets) - abs(np.linalg.det(generators))) < 10
    count = np.zeros((120, 120), int)
    for step in np.moveaxis(np.indices((12, 12)), 0, -1).reshape(-1, 2) - 6:
        at = window.offsets + np.rint(step @ generators + 60).astype(int)
        at = at[((at >= 0) & (at < 120)).all(axis=1)]
        count[tuple(at.T)] += 1
    assert (count[40:80, 40:80] == 1).mean() > 0.95


def test_a_single_complete_tile_is_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    generators = np.array([[24.0, 0.0], [0.0, 24.0]])
    for side, warned in ((48, True), (120, False)):
        caplog.clear()
        made = texture(picture(waves(generators, (side, side))), generators, size=(64, 64))
        assert (made.tiles < 2) == warned
        assert ["fewer than two" in record.getMessage() for record in caplog.records] == [True] * warned


def test_exemplars_without_lattice_or_whole_cell_are_refused() -> None:
    image, none = picture(np.zeros((40, 40))), np.zeros((0, 2), np.float32)
    with pytest.raises(InputError, match="the exemplar shows no lattice"):
        near_regular(image, none, none, NearRegularParams(), np.random.default_rng(1))
    with pytest.raises(InputError, match="40 x 40 px show no whole cell of the lattice"):
        texture(image, np.array([[50.0, 0.0], [0.0, 50.0]]))
    with pytest.raises(InputError, match="size: 20 x 20 px is smaller than a"):
        texture(picture(np.zeros((90, 90))), np.array([[18.0, 0.0], [0.0, 18.0]]), size=(20, 20), tileable=True)


def test_the_lattice_is_that_of_the_exemplar(bricks: tuple[Image, np.ndarray]) -> None:
    np.testing.assert_allclose(texture(*bricks).generators, bricks[1])


@pytest.mark.parametrize(
    ("label", "generators"),
    [hexagons((190, 200), 20.0), herringbone((200, 200), 14), basket_weave((190, 190), 10)],
    ids=["hexagons", "herringbone", "basket weave"],
)
def test_tiles_of_any_shape_stay_whole(label: np.ndarray, generators: np.ndarray, rng: np.random.Generator) -> None:
    """Though their colours differ, and joints do not follow the lattice's generators."""
    exemplar = painted(label, rng)
    result = texture(exemplar, generators, size=(260, 260))
    assert mixed_share(label, result.match) < 0.03
    shown = label[result.match[..., 0].astype(int), result.match[..., 1].astype(int)]
    assert (shown == 0).mean() == pytest.approx((label == 0).mean(), rel=0.1)
    assert len(np.unique(shown)) > 20


@pytest.mark.parametrize("tileable", [False, True])
def test_blocks_keep_their_length_in_courses_of_any_phase(tileable: bool, rng: np.random.Generator) -> None:
    """The lattice's analysis knows their height alone."""
    label = blocks((210, 260), 26, 60, rng)
    exemplar = painted(label, rng)
    lattice = deformed_lattice(exemplar, DeformedLatticeParams(), np.float32([[26, 0]]))
    params = NearRegularParams(size=(208, 300), tileable=tileable)
    result = near_regular(
        exemplar, lattice.generators, lattice.regular, params, np.random.default_rng(1), courses=lattice.courses
    )
    np.testing.assert_allclose(np.abs(result.generators), [[26, 0], [0, 60]], atol=1.5)
    assert mixed_share(label, result.match) < 0.05
    rows = result.image.pixels[..., 0]
    joints = [np.flatnonzero(np.diff((rows[row] > 0.75).astype(int)) == 1) for row in range(4, 208)]
    starts = [line[line > 5][0] for line in joints if 3 <= len(line) <= 7 and (line > 5).any()]
    assert np.ptp(np.array(starts) % 60) > 10  # courses do not line up
    gaps = np.concatenate([np.diff(line) for line in joints if 3 <= len(line) <= 7])
    assert np.median(gaps) == pytest.approx(60, abs=2)


def test_rubble_in_courses_is_laid_with_a_free_phase(rng: np.random.Generator) -> None:
    """Stones of any length have none in common."""
    ends = np.cumsum(rng.integers(20, 90, (9, 30)), axis=1)
    row, column = np.indices((210, 260))
    label = row // 26 * 100 + (column[..., None] >= ends[row // 26]).sum(axis=2) + 1
    frame = np.array([[26.0, 0.0], [0.0, 52.0]])
    outline = CellOutline.rectangle(frame, (0.0, 0.0))
    features = rng.uniform(0, 80, (int(label.max()) + 1, 3)).astype(np.float32)[label]
    assert course_cells(features, np.ones(label.shape, bool), np.zeros(2), outline) is None
