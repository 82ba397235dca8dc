import numpy as np
import pytest

from tests.kernels.compaction import naive
from tests.kernels.core.naive import bilinear
from tests.synthetic import smooth_noise
from texloom.stages.kernels.compaction.oriented import (
    AngleSearch,
    OrientedTexture,
    add_votes,
    choose_oriented_places,
    matched_distances,
    oriented_seam_sum,
    oriented_windows,
    refine_angles,
    sample_sources,
)
from texloom.stages.kernels.compaction.solver import Objective

CHANNELS, SIZE = 2, 5


@pytest.fixture
def planes(rng: np.random.Generator) -> np.ndarray:
    layers = [smooth_noise((30, 36), sigma, rng) for sigma in (1.5, 2.5)]
    return np.rint(1600 * np.stack(layers, axis=2)).astype(np.int16)


@pytest.fixture
def angles(rng: np.random.Generator) -> np.ndarray:
    return (2 * np.pi * smooth_noise((30, 36), 8.0, rng)).astype(np.float32)


def flat(planes: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(planes.reshape(planes.shape[0], -1))


def windows(planes: np.ndarray, places: np.ndarray, angle: np.ndarray) -> np.ndarray:
    out = np.zeros((len(places), SIZE**2 * CHANNELS), np.int16)
    for span in ((0, len(places) // 2), (len(places) // 2, len(places))):
        oriented_windows(flat(planes), CHANNELS, places.astype(np.int32), angle, SIZE, out, *span)
    return out


def test_windows_are_the_slow_ones(planes: np.ndarray, rng: np.random.Generator) -> None:
    places = rng.integers(0, (30, 36), (40, 2))
    angle = rng.uniform(-7, 7, 40).astype(np.float32)
    found = windows(planes, places, angle)
    for window, place, a in zip(found, places, angle, strict=True):
        slow = naive.oriented_window(planes, *place, float(a), SIZE)
        assert np.abs(window.reshape(SIZE, SIZE, CHANNELS) - slow).max() <= 1  # at halves, rounding may differ


def test_every_value_of_a_neighbourhood_votes_for_its_pixel(rng: np.random.Generator) -> None:
    down, across = 4, 6
    given = rng.integers(-(2**15), 2**15, (50, SIZE, SIZE, CHANNELS)).astype(np.int16)
    match = rng.integers(0, down * across, 50)
    sums, votes = (
        np.zeros((down + SIZE - 1, across + SIZE - 1, CHANNELS)),
        np.zeros((down + SIZE - 1, across + SIZE - 1)),
    )
    for one, place in zip(given, match, strict=True):
        row, column = divmod(int(place), across)
        sums[row : row + SIZE, column : column + SIZE] += one
        votes[row : row + SIZE, column : column + SIZE] += 1
    found, counted = np.zeros((sums.shape[0], sums.shape[1] * CHANNELS), np.int64), np.zeros(votes.shape, np.int64)
    add_votes(given.reshape(50, -1), match, SIZE, found, counted)
    np.testing.assert_array_equal(found.reshape(sums.shape), sums)
    np.testing.assert_array_equal(counted, votes)


def test_distances_of_matches(rng: np.random.Generator) -> None:
    one, other = (rng.integers(-(2**15), 2**15, (count, 18)).astype(np.int16) for count in (9, 5))
    match, found = rng.integers(0, 5, 9), np.full(9, -1.0)
    matched_distances(one, other, match, found, 2, 9)
    slow = [((a.astype(float) - other[number]) ** 2).sum() for a, number in zip(one, match, strict=True)]
    np.testing.assert_array_equal(found, [-1, -1, *slow[2:]])


def test_right_angles_rotate_the_pixels(planes: np.ndarray) -> None:
    place = np.array([[12, 17]])
    plain = planes[10:15, 15:20]
    for quarter in range(4):
        found = windows(planes, place, np.float32([quarter * np.pi / 2])).reshape(SIZE, SIZE, CHANNELS)
        np.testing.assert_array_equal(found, np.rot90(plain, quarter))


def sampled(texture: OrientedTexture, source: np.ndarray) -> np.ndarray:
    """The values at places between the pixels, by rows."""
    values = np.zeros((source.shape[1], source.shape[2] * CHANNELS), np.int16)
    for row in range(source.shape[1]):
        sample_sources(texture, source, values, row, row + 1)
    return values


def test_sources_between_pixels_are_interpolated(planes: np.ndarray, rng: np.random.Generator) -> None:
    source = rng.uniform(0, np.array([29, 35])[:, None, None], (2, 4, 5)).astype(np.float32)
    texture = OrientedTexture(flat(planes), CHANNELS, np.zeros((30, 36), np.float32))
    slow = np.array([[bilinear(planes, *source[:, y, x]) for x in range(5)] for y in range(4)])
    assert np.abs(sampled(texture, source).reshape(4, 5, CHANNELS) - slow).max() <= 0.51


def test_seams_are_the_slow_ones(planes: np.ndarray, angles: np.ndarray, rng: np.random.Generator) -> None:
    source = rng.uniform(0, np.array([29, 35])[:, None, None], (2, 4, 5)).astype(np.float32)
    slow = 0.0
    for y, x in np.ndindex(4, 5):
        for dy, dx in ((0, 1), (1, 0)):
            if y + dy < 4 and x + dx < 5:
                slow += naive.oriented_seam(planes, angles, source[:, y, x], source[:, y + dy, x + dx], dy, dx)
    texture = OrientedTexture(flat(planes), CHANNELS, angles)
    assert oriented_seam_sum(texture, source, sampled(texture, source)) == pytest.approx(slow, rel=1e-2)
    flat_texture = OrientedTexture(flat(planes), CHANNELS, np.zeros_like(angles))
    whole = np.ascontiguousarray(np.indices((30, 36))[:, 3:9, 4:9].astype(np.float32))
    assert oriented_seam_sum(flat_texture, whole, sampled(flat_texture, whole)) == 0


def test_a_pixel_takes_the_cheapest_candidate(
    planes: np.ndarray, angles: np.ndarray, rng: np.random.Generator
) -> None:
    """One pixel: its own source and what is proposed; weights decide between colour and nothing."""
    source = np.array([12, 9], np.float32).reshape(2, 1, 1)
    proposed = rng.integers(0, np.array([30, 36])[:, None, None], (6, 2, 1, 1)).astype(np.float32)
    wanted = planes[20, 20].astype(np.float32).reshape(1, 1, CHANNELS)
    texture, new = OrientedTexture(flat(planes), CHANNELS, angles), source.copy()
    values = sampled(texture, new)
    objective = Objective(wanted, np.ones((1, 1), np.float32), np.float32(0), False)
    choose_oriented_places(texture, objective, proposed, new, values)
    candidates = [source[:, 0, 0], *proposed[:, :, 0, 0]]
    far = [((planes[tuple(place.astype(int))] - wanted[0, 0]) ** 2).sum() for place in candidates]
    np.testing.assert_array_equal(new[:, 0, 0], candidates[int(np.argmin(far))])
    np.testing.assert_array_equal(values, sampled(texture, new))


def test_a_neighbour_is_continued_in_its_frame_between_pixels(planes: np.ndarray, angles: np.ndarray) -> None:
    """Two pixels; the second wants exactly what lies right of the first one's source, in that one's frame."""
    first = np.array([14.25, 15.5])
    continued = naive.oriented_neighbour(angles, first, 0, 1)
    source = np.array([[[14.25, 3]], [[15.5, 3]]], np.float32)
    wanted = np.stack([bilinear(planes, *place) for place in (first, continued)]).astype(np.float32)[None]
    none = np.full((1, 2, 1, 2), -1, np.float32)
    texture = OrientedTexture(flat(planes), CHANNELS, angles)
    objective = Objective(wanted, np.ones((1, 2), np.float32), np.float32(0.25), False)
    choose_oriented_places(texture, objective, none, source, sampled(texture, source))
    np.testing.assert_allclose(source[:, 0, 1], continued, atol=1e-5)
    np.testing.assert_array_equal(source[:, 0, 0], first)


def test_the_best_match_is_sought_around_the_known_one(planes: np.ndarray) -> None:
    """The neighbourhood lies two pixels from its match; its angle is found only where that far is searched."""
    place, true = np.array([[15, 18]], np.int32), np.float32([0.5])
    compaction = np.full((SIZE + 4, (SIZE + 4) * CHANNELS), 4000, np.int16)
    compaction[2:-2, 2 * CHANNELS : -2 * CHANNELS] = windows(planes, place, true).reshape(SIZE, -1)
    found = []
    for within in (1, 2):
        out = np.zeros(1, np.float32)
        shared = (flat(planes), CHANNELS, compaction, AngleSearch(np.pi / 2, 36, 3, within), place)
        refine_angles(*shared, np.zeros((1, 2), np.int32), np.float32([0.0]), SIZE, out, 0, 1)
        found.append(abs(float(out[0] - true[0])))
    assert found[1] < np.radians(6) < found[0]


@pytest.mark.parametrize("true", [-0.9, 0.0, 0.6])
def test_the_right_angle_is_found(planes: np.ndarray, true: float) -> None:
    """The compaction is the neighbourhood itself, rotated; three rounds of 36 leave steps of about 2.5 degrees."""
    place = np.array([[15, 18]], np.int32)
    compaction = windows(planes, place, np.float32([true])).reshape(SIZE, SIZE * CHANNELS)
    out = np.zeros(1, np.float32)
    match, mean = np.zeros((1, 2), np.int32), np.float32([0.2])
    refine_angles(
        flat(planes), CHANNELS, np.ascontiguousarray(compaction), AngleSearch(np.pi / 2, 36, 3, 1), place, match,
        mean, SIZE, out, 0, 1,
    )  # fmt: skip
    # of the three best angles the one nearest to the mean is taken, up to two steps away
    assert abs(float(out[0]) - true) < np.radians(6)
