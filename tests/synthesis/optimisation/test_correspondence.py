from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.synthetic import identity
from tests.wraps import WRAPS
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.correspondence import from_pixels, rescale, to_pixels
from texloom.stages.synthesis.optimisation.vote import vote_pixels
from texloom.stages.vocabulary import scratch
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

SIZES = [3, 4, 5, 10]
"""patch sides, odd and even"""


@pytest.mark.parametrize("size", SIZES)
def test_identity_reads_out_as_identity(size: int) -> None:
    match = np.indices((12, 9), np.int32)
    np.testing.assert_array_equal(to_pixels(match, size, wrap=NOWHERE), identity((12 + size - 1, 9 + size - 1)))


@pytest.mark.parametrize("size", SIZES)
def test_identity_reads_out_as_identity_around_a_torus(size: int) -> None:
    """An exemplar that is a torus of (12, 11) pixels with its margin."""
    pixels = to_pixels(np.indices((12, 11), np.int32), size, wrap=TORUS)
    assert pixels.shape == (12, 11, 2)
    np.testing.assert_array_equal(pixels % (12, 11), identity((12, 11)))


@pytest.mark.parametrize("size", SIZES)
def test_pixels_are_those_of_the_patch_about_them(size: int, rng: np.random.Generator) -> None:
    """A vote in which only the patch counts in whose middle a pixel lies."""
    places = (9, 8)
    match = np.stack([rng.integers(0, n, (12, 11)) for n in places]).astype(np.int32)
    exemplar = rng.integers(0, 1000, (places[0] + size - 1, places[1] + size - 1, 1)).astype(np.float32)
    middle = np.zeros(size, np.int32)
    middle[size // 2] = 1
    voted = vote_pixels(match, exemplar, middle, TORUS)
    pixels = to_pixels(match, size, wrap=TORUS)
    np.testing.assert_array_equal(exemplar[pixels[..., 0], pixels[..., 1]], voted)

    inside = to_pixels(match, size, wrap=NOWHERE)
    assert inside.shape == (12 + size - 1, 11 + size - 1, 2)
    assert (inside < (places[0] + size - 1, places[1] + size - 1)).all()
    before, after = size // 2, size - 1 - size // 2
    values = exemplar[inside[..., 0], inside[..., 1]][before : -after or None, before : -after or None]
    np.testing.assert_array_equal(values, exemplar[match[0] + size // 2, match[1] + size // 2])


@pytest.mark.parametrize("size", SIZES)
def test_border_pixels_come_from_the_nearest_patch(size: int, rng: np.random.Generator) -> None:
    match = np.stack([rng.integers(0, 20, (12, 11)), rng.integers(0, 20, (12, 11))]).astype(np.int32)
    pixels = to_pixels(match, size, wrap=NOWHERE)
    assert pixels[0, 0].tolist() == match[:, 0, 0].tolist()
    assert pixels[-1, -1].tolist() == (match[:, -1, -1] + size - 1).tolist()
    assert pixels[0, -1].tolist() == [match[0, 0, -1], match[1, 0, -1] + size - 1]


@pytest.mark.parametrize("size", SIZES)
def test_reading_out_and_in_again_is_the_identity(size: int, rng: np.random.Generator) -> None:
    """At full size and without a margin."""
    match = np.stack([rng.integers(0, n, (12, 11)) for n in (9, 8)]).astype(np.int32)
    pixels = to_pixels(match, size, wrap=NOWHERE)
    full = pixels.shape[:2]
    np.testing.assert_array_equal(from_pixels(pixels, full, (12, 11), (9, 8), size, 1.0), match)


@pytest.mark.parametrize("size", SIZES)
def test_reading_in_from_a_torus(size: int) -> None:
    """A shift of (2, 3): patches whose middle lies inside the picture have it."""
    pixels = identity((12, 11)) + np.array([2, 3], np.uint32)
    match = from_pixels(pixels, (12, 11), (12, 11), (40, 40), size, 1.0)
    np.testing.assert_array_equal(match - np.indices((12, 11)), np.full((2, 12, 11), [[[2]], [[3]]]))


@pytest.mark.parametrize(("factor", "shift"), [(0.5, (4, 6)), (0.25, (8, 4)), (1.0, (5, 1))])
def test_reading_in_scales_the_displacement(factor: float, shift: tuple[int, int]) -> None:
    pixels = identity((64, 48)) + np.array(shift, np.uint32)
    patches = (round(64 * factor) - 4, round(48 * factor) - 4)
    match = from_pixels(pixels, (64, 48), patches, (100, 100), 5, factor)
    expected = np.multiply(shift, factor)[:, None, None] * np.ones((2, *patches))
    np.testing.assert_array_equal(match - np.indices(patches), expected)


def test_reading_in_with_a_margin_moves_the_patches_out(rng: np.random.Generator) -> None:
    """Patches over the margin go on as the picture does at its border, as far as the exemplar reaches."""
    pixels = identity((20, 24)) + np.uint32(7)
    margin, size = 4, 5
    full = (20 + 2 * margin, 24 + 2 * margin)
    patches = (full[0] - size + 1, full[1] - size + 1)
    match = from_pixels(pixels, full, patches, (60, 60), size, 1.0)
    # the patch at (i, j) covers picture pixels from (i - margin, j - margin) on
    np.testing.assert_array_equal(match, np.indices(patches) - margin + 7)
    # read out, the picture inside the margin is what was read in
    np.testing.assert_array_equal(to_pixels(match, size, NOWHERE)[margin:-margin, margin:-margin], pixels)


@given(
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.tuples(st.integers(1, 20), st.integers(1, 20)),
    st.tuples(st.integers(1, 15), st.integers(1, 15)),
    st.floats(0.3, 4),
    st.integers(0, 2**32),
)
def test_rescaled_matches_exist(
    down: tuple[int, int], patches: tuple[int, int], places: tuple[int, int], factor: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    match = np.stack([rng.integers(0, 15, down), rng.integers(0, 15, down)]).astype(np.int32)
    finer = rescale(match, patches, places, factor)
    assert finer.shape == (2, *patches)
    assert finer.flags.c_contiguous
    assert (finer >= 0).all()
    assert (finer < np.array(places)[:, None, None]).all()


def test_rescaling_by_one_changes_nothing(rng: np.random.Generator) -> None:
    match = np.stack([rng.integers(0, n, (12, 11)) for n in (9, 8)]).astype(np.int32)
    np.testing.assert_array_equal(rescale(match, (12, 11), (9, 8), 1.0), match)


@pytest.mark.parametrize("factor", [1.25, 1.5, 2.0])
def test_rescaling_keeps_the_identity(factor: float) -> None:
    finer = (round(16 * factor), round(12 * factor))
    match = rescale(np.indices((16, 12), np.int32), finer, finer, factor)
    np.testing.assert_array_equal(match, np.indices(finer))


def test_rescaling_keeps_pieces_together() -> None:
    """Two halves with displacements of their own stay two halves, with displacements twice as long."""
    match = np.indices((10, 10), np.int32)
    match[0] += 3
    match[1, :, 5:] += 7
    finer = rescale(match, (20, 20), (100, 100), 2.0) - np.indices((20, 20))
    assert (finer[0] == 6).all()
    assert (finer[1, :, :10] == 0).all()
    assert (finer[1, :, 10:] == 14).all()


@pytest.mark.parametrize(("coarse", "fine"), [((2, 2), (3, 5)), ((7, 4), (9, 11)), ((9, 11), (7, 4))])
def test_rescaling_takes_the_patch_under_the_middle(coarse: tuple[int, int], fine: tuple[int, int]) -> None:
    """Displacements that name the patch they come from."""
    names = np.indices(coarse) * 1000
    match = (np.indices(coarse) + names).astype(np.int32)
    shifts = rescale(match, fine, (20000, 20000), 1.0) - np.indices(fine)
    for axis in (0, 1):
        middle = ((np.arange(fine[axis]) + 0.5) * coarse[axis] / fine[axis]).astype(int)
        lines = shifts[axis].T if axis == 0 else shifts[axis]
        np.testing.assert_array_equal(lines, np.tile(middle * 1000, (lines.shape[0], 1)))


@pytest.mark.parametrize("wrap", WRAPS)
def test_strips_make_no_difference(wrap: Wraps, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    places = (60, 70)
    pixels = np.stack([rng.integers(0, side, (37, 23)) for side in places], axis=2).astype(np.uint32)
    results = []
    for rows in (5, 1000):
        monkeypatch.setattr(scratch, "_BAND", rows)
        coarse = correspondence.from_pixels(pixels, (41, 27), (20, 13), (30, 35), 4, 0.5)
        fine = correspondence.rescale(coarse, (38, 24), places, 1.9)
        results.append([coarse, fine, correspondence.to_pixels(fine, 4, wrap)])
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)
