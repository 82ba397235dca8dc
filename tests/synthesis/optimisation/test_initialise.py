from __future__ import annotations

from typing import Any

import numpy as np
import pydantic
import pytest

from tests.runs import run_with_progress
from tests.synthetic import blobs, continued, masked, picture, smooth_noise, tiled, wall
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.optimisation.initialise import Initialised, InitialiseParams, initialise
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size


def start(
    image: Image,
    seed: int = 1,
    structure: np.ndarray | None = None,
    generators: np.ndarray | None = None,
    **params: Any,
) -> Initialised:
    params = {"size": (150, 170), **params}
    return initialise(image, InitialiseParams(**params), np.random.default_rng(seed), structure, generators)


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((96, 120, 3), 2.0, rng))


@pytest.mark.parametrize(
    ("shape", "cell", "drop"),
    [
        ((128, 140), (20, 26), 0),
        ((128, 140), (21, 27), 8),
        ((128, 140), (25, 30), 15),
        ((300, 320), (31, 37), 11),  # blocks of large exemplars are compared at half size
        ((270, 260), (30, 36), 18),
        ((300, 320), (29, 37), 0),
        ((300, 100), (23, 17), 5),
    ],
)
def test_blocks_continue_a_lattice_exactly(
    shape: tuple[int, int], cell: tuple[int, int], drop: int, rng: np.random.Generator
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, generators = tiled(pattern, drop, shape)
    result = start(exemplar, generators=generators, size=(331, 290))
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    moves = (result.match.astype(int) - np.indices((331, 290)).transpose(1, 2, 0)).reshape(-1, 2)
    assert len(np.unique(moves, axis=0)) > 3  # and yet it is not one block


def test_blocks_follow_a_lattice_between_pixels(image: Image) -> None:
    """Displacements stay within a pixel of whole cells, however many; the picture asks for nothing."""
    generators = np.float32([[17.4, 3.3], [-4.2, 21.7]])
    flat = picture(np.full((96, 120, 3), 0.5))
    match = start(flat, generators=generators, size=(400, 400), margin=0).match.astype(int)
    moves = (match - match[0, 0] - np.indices((400, 400)).transpose(1, 2, 0)).reshape(-1, 2)
    cells = moves @ np.linalg.inv(generators.astype(float))
    assert np.abs((cells - np.rint(cells)) @ generators).max() <= 0.5 + 1e-3
    assert len(np.unique(np.rint(cells), axis=0)) > 20


@pytest.mark.parametrize("degrees", [0.0, 90.0, 12.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_courses_keep_their_phase(degrees: float, seed: int) -> None:
    """And blocks come from any place along them."""
    exemplar = wall((160, 170), 20, degrees, np.random.default_rng(seed))
    angle = np.radians(degrees)
    period = 20 * np.array([np.cos(angle), np.sin(angle)])
    match = start(exemplar, seed, generators=np.float32([period]), size=(300, 300)).match.astype(int)
    moves = match - np.indices((300, 300)).transpose(1, 2, 0)
    drift = (moves - moves[0, 0]) @ period / (period @ period)
    off = np.abs(drift - np.rint(drift))
    assert off.max() <= 0.25 + 0.1
    assert off.mean() < 0.06
    along = moves @ np.array([-np.sin(angle), np.cos(angle)])
    assert len(np.unique(np.rint(along))) > 10


def test_without_a_lattice_blocks_come_from_anywhere(image: Image) -> None:
    lattice = np.float32([[20, 0], [0, 20]])
    blocks = start(image, method="blocks").match
    np.testing.assert_array_equal(start(image).match, blocks)
    np.testing.assert_array_equal(start(image, generators=np.zeros((0, 2), np.float32)).match, blocks)
    np.testing.assert_array_equal(start(image, method="blocks", generators=lattice).match, blocks)
    assert (start(image, generators=lattice).match != blocks).any()


def test_a_block_is_one_piece(image: Image) -> None:
    """By default a third of the shorter side; its overlaps with later ones may be cut."""
    for block in (None, 30):
        side = block or 32
        core = side - side // 2
        match = start(image, method="blocks", block=block).match.astype(int)
        moves = match - np.indices((150, 170)).transpose(1, 2, 0)
        for row in range(0, 150, side):
            for column in range(0, 170, side):
                piece = moves[row : row + core, column : column + core]
                assert (piece == piece[0, 0]).all()


@pytest.mark.parametrize("method", ["lattice", "blocks", "pixels"])
@pytest.mark.parametrize("shape", [(10, 10), (10, 300), (96, 120), (257, 259)])
@pytest.mark.parametrize("size", [(16, 16), (31, 103)])
def test_every_match_lies_in_the_exemplar(
    method: str, shape: tuple[int, int], size: tuple[int, int], rng: np.random.Generator
) -> None:
    exemplar = picture(rng.random((*shape, 3)))
    generators = np.float32([[11, 2], [3, 14]])
    result = start(exemplar, generators=generators, method=method, size=size)
    assert result.match.shape == (*size, 2)
    assert result.match.dtype == np.uint32
    assert (result.match < shape).all()
    row, column = result.match[..., 0], result.match[..., 1]
    np.testing.assert_array_equal(result.image.pixels, exemplar.pixels[row, column])


def test_pixels_are_drawn_evenly(image: Image) -> None:
    match = start(image, method="pixels", size=(400, 400)).match.reshape(-1, 2)
    for axis, side in enumerate((96, 120)):
        counts = np.bincount(match[:, axis], minlength=side) / (len(match) / side)
        assert counts.size == side
        assert 0.85 < counts.min() <= counts.max() < 1.15
    assert abs(np.corrcoef(match.T.astype(float))[0, 1]) < 0.02


@pytest.mark.parametrize("method", ["lattice", "blocks", "pixels"])
def test_the_seed_decides(image: Image, method: str) -> None:
    generators = np.float32([[20, 0], [0, 20]])
    first, again, other = (start(image, seed, generators=generators, method=method).match for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_threads_do_not_matter(image: Image) -> None:
    import cv2

    threads = cv2.getNumThreads()
    try:
        results = []
        for count in (1, 2):
            cv2.setNumThreads(count)
            results.append(start(image, size=(300, 300)).match)
    finally:
        cv2.setNumThreads(threads)
    np.testing.assert_array_equal(*results)


def seams(result: Initialised, side: int) -> float:
    """Mean difference across the borders of blocks."""
    pixels = result.image.pixels
    rows = np.arange(side, pixels.shape[0], side)
    columns = np.arange(side, pixels.shape[1], side)
    down = np.abs(pixels[rows] - pixels[rows - 1]).mean()
    return float(down + np.abs(pixels[:, columns] - pixels[:, columns - 1]).mean())


def test_blocks_continue_their_neighbours(image: Image) -> None:
    aligned = [seams(start(image, seed, method="blocks"), 24) for seed in range(4)]
    loose = [seams(start(image, seed, method="blocks", margin=0, tries=1), 24) for seed in range(4)]
    assert max(aligned) < 0.9 * min(loose)


def test_cuts_pass_between_objects(rng: np.random.Generator) -> None:
    """Tiles of random colours with grey joints: hardly any is put together from two."""
    cell, joint = np.array([20, 24]), 4
    shape = np.array([240, 264])
    row, column = np.indices(shape)
    tiles = rng.random((*(shape // cell), 3))[row // cell[0], column // cell[1]]
    grey = (row % cell[0] < joint) | (column % cell[1] < joint)
    image = picture(np.where(grey[..., None], 0.3, tiles))

    def torn(**params: Any) -> int:
        """Neighbours of two colours, neither of them the joints': the exemplar has none."""
        colors = start(image, generators=np.diag(cell).astype(np.float32), size=(200, 220), **params).image.pixels
        colored = np.abs(colors - np.float32(0.3)).max(axis=2) > 1e-6
        down = (colors[1:] != colors[:-1]).any(axis=2) & colored[1:] & colored[:-1]
        across = (colors[:, 1:] != colors[:, :-1]).any(axis=2) & colored[:, 1:] & colored[:, :-1]
        return int(down.sum() + across.sum())

    assert torn() < 0.1 * torn(margin=0)


@pytest.mark.parametrize(("times", "size"), [(2.0, (192, 240)), (0.5, (48, 60))])
def test_a_result_of_several_times_the_exemplar(image: Image, times: float, size: tuple[int, int]) -> None:
    result = start(image, size=None, times=times, method="pixels")
    assert result.match.shape[:2] == size
    params = InitialiseParams(size=None, times=times)
    assert find_stage("synthesis.initialise").outlines(params, {"image": image})["match"].shape[:2] == size
    assert start(image, size=(50, 60), times=times, method="pixels").match.shape[:2] == (50, 60)


def test_blocks_are_searched_everywhere(rng: np.random.Generator) -> None:
    """Bands of which an exemplar holds few: what continues them is far from most places."""
    band = 70
    tone = 0.5 + 0.4 * np.sin(np.arange(210) * 2 * np.pi / band)[:, None] + 0.1 * smooth_noise((210, 240), 1.5, rng)
    match = start(picture(np.repeat(np.clip(tone, 0, 1)[..., None], 3, axis=2)), size=(300, 330)).match
    drift = (match[..., 0].astype(int) - np.arange(300)[:, None]) * 2 * np.pi / band
    assert np.abs(np.exp(1j * drift).mean()) > 0.97


def test_contours_are_continued_where_colour_tells_nothing() -> None:
    """Diagonal stripes in the structure alone: all blocks keep their phase."""
    down, across = np.indices((128, 128))
    structure = (down + across) % 12 < 4
    result = start(picture(np.full((128, 128, 3), 0.4)), structure=structure, method="blocks")
    phase = (result.match.sum(axis=2).astype(int) - np.indices((150, 170)).sum(axis=0)) % 12
    assert (phase == phase[0, 0]).all()


def test_the_whole_exemplar_is_used(image: Image) -> None:
    match = start(image, method="blocks", size=(400, 400)).match.reshape(-1, 2)
    used = np.zeros((96, 120), bool)
    used[tuple(match.T)] = True
    assert used.mean() > 0.85


def test_all_channels_are_copied(rng: np.random.Generator) -> None:
    pixels = rng.random((64, 64, 5), np.float32)
    result = start(Image(pixels, ("R", "G", "B", "A", "height")))
    assert result.image.channels == ("R", "G", "B", "A", "height")
    np.testing.assert_array_equal(result.image.pixels, pixels[result.match[..., 0], result.match[..., 1]])


def test_progress_rises_to_the_end(image: Image) -> None:
    done = [progress.done for progress in run_with_progress(lambda: start(image))[1]]
    assert len(done) == 5
    assert done == sorted(done)
    assert done[-1] == 1


@pytest.mark.parametrize(
    "params",
    [{"size": (0, 100)}, {"size": (100, -1)}, {"size": (15, 100)}, {"size": (50000, 50000)},
     {"size": (32769, 100)}, {"size": (100,)}, {"size": (100.5, 100)},
     {"block": 0}, {"tries": 0}, {"margin": -1}, {"method": "tiles"}],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(params: dict[str, Any]) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        InitialiseParams(**params)
    assert {str(error["loc"][0]) for error in caught.value.errors()} == set(params)


@pytest.mark.parametrize("shape", [(9, 9), (1, 1), (1000, 9)])
def test_too_small_an_exemplar_is_refused_before_anything_runs(shape: tuple[int, int]) -> None:
    check = find_stage("synthesis.initialise").check
    assert check is not None
    check(InitialiseParams(), {})
    with pytest.raises(InputError, match=f"image: {format_size(shape)} is too small") as caught:
        check(InitialiseParams(), {"image": picture(np.zeros((*shape, 3)))})
    assert "\n" not in str(caught.value)


def test_blocks_beside_a_large_mask_come_from_all_sides_of_it(rng: np.random.Generator) -> None:
    usable = np.ones((144, 144), bool)
    usable[38:106, 40:104] = False  # blocks of 48 px, a third of the shorter side, fit nowhere beside it
    made = start(masked(picture(smooth_noise((144, 144, 3), 2.0, rng)), usable, 0.0), size=(288, 288))
    uses = np.zeros(usable.shape, np.int64)
    np.add.at(uses, tuple(made.match.reshape(-1, 2).T), 1)
    assert not uses[~usable].any()
    assert (uses[usable] > 0).mean() > 0.8
    relative = uses[usable] / uses[usable].mean()
    assert relative.std() < 1.2  # 3.1 from blocks of 48 px, most of them from one place


@pytest.mark.parametrize("method", ["lattice", "blocks", "pixels"])
def test_masked_pixels_are_not_used(method: str, rng: np.random.Generator) -> None:
    """And their values make no difference."""
    plain, generators = tiled(blobs((24, 32, 3), rng, 2.0), 8, (144, 160))
    usable = np.ones((144, 160), bool)
    usable[50:80, 40:60] = usable[:, :6] = False
    results = [
        start(masked(plain, usable, value), generators=generators, size=(200, 180), method=method)
        for value in (0.0, 30.0)
    ]
    assert usable[tuple(np.moveaxis(results[0].match, 2, 0))].all()
    assert results[0].image.channels == ("R", "G", "B")
    np.testing.assert_array_equal(results[0].match, results[1].match)
