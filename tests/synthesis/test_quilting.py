from __future__ import annotations

import numpy as np
import pydantic
import pytest

from tests.synthetic import continued, jump, picture, smooth_noise, tiled
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.progress import Progress, listening
from texloom.stages.synthesis._seams.exemplar import lab_of
from texloom.stages.synthesis._seams.seam_map import SeamMap, slopes
from texloom.stages.synthesis.quilting import Quilted, QuiltingParams, quilting


def sewn(image: Image, seed: int = 1, **params: object) -> Quilted:
    given = QuiltingParams(**{"size": (96, 108), "seam_refinement": 0.0, **params})  # type: ignore[arg-type]
    return quilting(image, given, np.random.default_rng(seed))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((96, 120, 3), 2.0, rng))


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("shape", [(8, 8), (9, 100), (96, 120)])
@pytest.mark.parametrize("size", [(16, 16), (31, 83), (16, 130)])
def test_every_pixel_is_the_one_that_match_says(
    shape: tuple[int, int], size: tuple[int, int], tileable: bool, rng: np.random.Generator
) -> None:
    pixels = rng.random((*shape, 5), np.float32)
    exemplar = Image(pixels, ("R", "G", "B", "metallic", "height"))
    result = sewn(exemplar, size=size, tileable=tileable, tries=3, seam_refinement=0.1)
    assert result.match.shape == (*size, 2)
    assert result.match.dtype == np.uint32
    assert (result.match < shape).all()
    assert result.image.channels == exemplar.channels
    np.testing.assert_array_equal(result.image.pixels, pixels[result.match[..., 0], result.match[..., 1]])
    assert result.tileable == tileable


@pytest.mark.parametrize(("cell", "drop"), [((13, 17), 0), ((12, 16), 5), ((20, 9), 3)])
@pytest.mark.parametrize("tolerance", [0.0, 0.1])
def test_an_exact_tiling_goes_on_exactly(
    cell: tuple[int, int], drop: int, tolerance: float, rng: np.random.Generator
) -> None:
    pattern = rng.random((*cell, 3))
    exemplar, _ = tiled(pattern, drop, (96, 110))
    result = sewn(exemplar, tolerance=tolerance, block=40, seam_refinement=1)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, drop, result.match))
    moves = (result.match.astype(int) - np.indices((96, 108)).transpose(1, 2, 0)).reshape(-1, 2)
    assert len(np.unique(moves, axis=0)) > 3  # and yet it is not one block


def test_a_tileable_tiling_wraps_exactly(rng: np.random.Generator) -> None:
    """Where the result holds whole cells, it goes on across its borders."""
    pattern = rng.random((12, 15, 3))
    exemplar, _ = tiled(pattern, 0, (70, 80))
    result = sewn(exemplar, size=(96, 105), tileable=True, block=30, seam_refinement=1)
    np.testing.assert_array_equal(result.image.pixels, continued(pattern, 0, result.match))


def test_tileable_wraps(image: Image) -> None:
    wrapped = [jump(sewn(image, seed, tileable=True, seam_refinement=0.2).image.pixels) for seed in range(4)]
    loose = [jump(sewn(image, seed).image.pixels) for seed in range(4)]
    assert np.mean(wrapped) < 1.5
    assert max(wrapped) < 2
    assert min(loose) > 2.5


def seams(result: Quilted) -> float:
    """Mean jump where the source jumps."""
    moves = result.match.astype(int) - np.indices(result.match.shape[:2]).transpose(1, 2, 0)
    total, count = 0.0, 0
    for axis in (0, 1):
        cut = (np.diff(moves, axis=axis) != 0).any(axis=2)
        total += float(np.abs(np.diff(result.image.pixels, axis=axis))[cut].sum())
        count += int(cut.sum())
    return total / count


def test_wider_overlaps_are_cut_better(image: Image) -> None:
    narrow, wide = (
        [seams(sewn(image, seed, size=(150, 170), overlap=overlap, block=40)) for seed in range(3)]
        for overlap in (0.04, 0.25)
    )
    assert np.mean(wide) < 0.85 * np.mean(narrow)


def test_tolerance_varies_the_blocks(image: Image) -> None:
    """With much of it, neighbours suit each other less, if not the cheapest cut of several is taken."""
    strict = np.mean([seams(sewn(image, seed, tolerance=0, tries=1)) for seed in range(3)])
    loose = np.mean([seams(sewn(image, seed, tolerance=3, tries=1)) for seed in range(3)])
    assert strict < 0.9 * loose


def test_blocks_with_minimum_cuts_are_chosen(image: Image) -> None:
    one = np.mean([seams(sewn(image, seed, tolerance=3, tries=1)) for seed in range(2)])
    some = np.mean([seams(sewn(image, seed, tolerance=3, tries=16)) for seed in range(2)])
    assert some < 0.95 * one


def test_what_was_used_is_laid_less(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    def unused() -> float:
        """Share of the exemplar's pixels, mean of some seeds."""
        found = []
        for seed in range(4):
            seen = np.ones((image.height, image.width), bool)
            seen[tuple(np.moveaxis(sewn(image, seed, block=30, tolerance=3).match, 2, 0))] = False
            found.append(seen.mean())
        return float(np.mean(found))

    even = unused()
    monkeypatch.setattr("texloom.stages.synthesis.quilting._REUSE_WEIGHT", 0.0)
    assert even < 0.9 * unused()


def test_refinement_lowers_the_cost_of_visible_seams(image: Image) -> None:
    """All together cost less, and so does the costliest."""

    def seam_costs(seam_refinement: float, seed: int, tileable: bool) -> np.ndarray:
        match = sewn(image, seed, seam_refinement=seam_refinement, tileable=tileable).match
        features = lab_of(image)
        return SeamMap(features, slopes(features), match, tileable).costs

    for tileable in (False, True):
        before_refinement = [seam_costs(0, seed, tileable) for seed in range(2)]
        refined = [seam_costs(2, seed, tileable) for seed in range(2)]
        assert all(
            after.sum() < 0.9 * before.sum() for before, after in zip(before_refinement, refined, strict=True)
        )
        assert np.mean([one.max() for one in refined]) < 0.8 * np.mean([one.max() for one in before_refinement])


@pytest.mark.parametrize("block", [None, 17])
def test_blocks_have_their_size(image: Image, block: int | None) -> None:
    """The first block is whole but for its overlaps, and no piece is larger than a block."""
    side = block or 36
    match = sewn(image, block=block).match.astype(int)
    moves = match - np.indices(match.shape[:2]).transpose(1, 2, 0)
    own = side - round(side / 3) - 2
    assert (moves[:own, :own] == moves[0, 0]).all()
    row = (moves[0] == moves[0, 0]).all(axis=1)
    assert row[:own].all()
    assert not row[side:].all()


def test_the_seed_decides(image: Image) -> None:
    first, again, other = (sewn(image, seed, size=(64, 72), seam_refinement=0.5).match for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_threads_do_not_matter(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for count in ("1", "2", "3"):
        monkeypatch.setenv("TEXLOOM_THREADS", count)
        found.append(sewn(image, tileable=True, seam_refinement=0.5).match)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_a_flat_exemplar_is_no_trouble() -> None:
    flat = picture(np.full((30, 30), 0.5))
    assert (sewn(flat, size=(60, 70)).image.pixels == np.float32(0.5)).all()


def test_progress_rises_to_the_end(image: Image) -> None:
    seen: list[Progress] = []
    with listening(seen.append):
        sewn(image, size=(64, 72), seam_refinement=0.5)
    done = [progress.done for progress in seen]
    assert len(done) > 3
    assert done == sorted(done)
    assert done[-1] == 1


@pytest.mark.parametrize(
    "params",
    [
        {"size": (15, 100)},
        {"size": (50000, 50000)},
        {"block": 5},
        {"overlap": 0.0},
        {"overlap": 0.4},
        {"tolerance": -0.1},
        {"tolerance": float("nan")},
        {"seam_refinement": -1},
    ],
)
def test_absurd_requests_are_refused(params: dict[str, object]) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        QuiltingParams(**params)  # type: ignore[arg-type]
    assert {str(error["loc"][0]) for error in caught.value.errors()} == set(params)


@pytest.mark.parametrize(
    ("pixels", "params", "message"),
    [
        (np.zeros((7, 100)), {}, "image: 7x100 px is too small"),
        (np.zeros((40, 30)), {"block": 31}, "block: 31 px is more than the image has, 40x30 px"),
    ],
)
def test_bad_exemplars_are_refused_before_anything_runs(
    pixels: np.ndarray, params: dict[str, int], message: str
) -> None:
    check = find_stage("synthesis.quilting").check
    assert check is not None
    check(QuiltingParams(**params), {})  # type: ignore[arg-type]
    given = picture(pixels)
    for refuse in (
        lambda: check(QuiltingParams(**params), {"image": given}),  # type: ignore[arg-type]
        lambda: sewn(given, **params),
    ):
        with pytest.raises(InputError, match=message) as caught:
            refuse()
        assert "\n" not in str(caught.value)


def test_values_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="image: a value is not finite"):
        sewn(picture(np.full((40, 30), np.nan)))
