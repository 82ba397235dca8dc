from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, tiled
from texloom.stages.synthesis.stitching.boundaries import Boundaries, square_means, zone_mask
from texloom.stages.synthesis.stitching.exemplar import Stitched
from texloom.stages.synthesis.stitching.patch_based import PatchBasedParams, patch_based
from texloom.stages.vocabulary.arrays import Image

PATCH, ZONE = 24, 4


def texture(image: Image, **params: Any) -> Stitched:
    params = {"size": (90, 110), "patch": PATCH, "zone": ZONE, **params}
    return patch_based(image, PatchBasedParams(**params), np.random.default_rng(1))


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((64, 80, 3), 2.0, rng))


def blended(length: int, wrap: bool) -> np.ndarray:
    """Along one axis, whether neighbours overlap there; steps must divide ``length`` where it wraps."""
    place = np.arange(length)
    return (place % (PATCH - ZONE) < ZONE) & (wrap | (place >= ZONE))


@pytest.mark.parametrize("wrap", [False, True])
def test_match_tells_where_pixels_come_from(image: Image, wrap: bool) -> None:
    """Outside the zones pixels are copies; inside they lie between the patches that meet."""
    result = texture(image, size=(100, 120), tileable=wrap)
    copied = image.pixels[result.match[..., 0], result.match[..., 1]]
    plain = ~(blended(100, wrap)[:, None] | blended(120, wrap))
    np.testing.assert_array_equal(result.image.pixels[plain], copied[plain])
    assert (result.image.pixels[~plain] != copied[~plain]).any(axis=1).mean() > 0.5
    assert result.image.wraps.both is wrap
    # and within the square between zones one patch is copied whole
    offset = result.match.astype(int) - np.indices((100, 120)).transpose(1, 2, 0)
    core = offset[2 * PATCH - ZONE : 3 * (PATCH - ZONE), PATCH : 2 * (PATCH - ZONE)]
    assert (core == core[0, 0]).all()


def test_zones_blend_linearly(rng: np.random.Generator) -> None:
    """Two patches of one row, each of one colour that a second channel names; the zone is the ramp between them."""
    image = picture(smooth_noise((40, 60, 3), 2.0, rng))
    result = texture(image, size=(24, 40), tolerance=0)
    row = np.arange(24)
    sources = [result.match[0, column].astype(int) - [0, column] for column in (0, 30)]
    for k in range(ZONE):
        column = PATCH - ZONE + k
        one, other = (image.pixels[source[0] + row, source[1] + column] for source in sources)
        weight = np.float32((k + 0.5) / ZONE)
        np.testing.assert_allclose(result.image.pixels[:, column], one + weight * (other - one), rtol=1e-6)


def test_tolerance_brings_variety(image: Image) -> None:
    """Without it the best patch is always taken, here the exemplar's continuation."""

    def pieces(tolerance: float) -> int:
        match = texture(image, size=(200, 200), tolerance=tolerance).match.astype(int)
        return len(np.unique((match - np.indices((200, 200)).transpose(1, 2, 0)).reshape(-1, 2), axis=0))

    assert pieces(0.3) > pieces(0)


def test_index_finds_the_nearest(rng: np.random.Generator) -> None:
    """All components and no slack: exactly the places that the definition names."""
    features = rng.normal(size=(30, 34, 2)).astype(np.float32)
    mask = zone_mask((9, 11), 2, (True, False), (False, True))  # too narrow for squares wider than a pixel
    index = Boundaries.of(features, np.ones((22, 24), bool), mask, 2, 1.0)
    window = rng.normal(size=(9, 11, 2)).astype(np.float32)
    brute = {
        (y, x): float(np.sqrt(((features[y : y + 9, x : x + 11] - window)[mask] ** 2).sum(axis=1).mean()))
        for y, x in np.ndindex(22, 24)
    }
    best = sorted(brute, key=brute.__getitem__)
    # what no component holds is no part of the distance, so the window is one of the exemplar's
    own = features[5:14, 7:18]
    assert index.nearest(own, 1, 0.0).tolist() == [[5, 7]]
    distances = index.distances(window, np.array(best))
    np.testing.assert_allclose(distances, [brute[place] for place in best], rtol=1e-5)
    own_brute = sorted(brute, key=lambda at: ((features[at[0] :, at[1] :][:9, :11] - own)[mask] ** 2).sum())
    assert index.nearest(own, 8, 0.0).tolist() == [list(place) for place in own_brute[:8]]


def test_means_of_squares(rng: np.random.Generator) -> None:
    planes = rng.random((7, 9, 2), dtype=np.float32)
    means = square_means(planes, 3)
    assert means.shape == (5, 7, 2)
    for y, x in np.ndindex(5, 7):
        np.testing.assert_allclose(means[y, x], planes[y : y + 3, x : x + 3].mean(axis=(0, 1)), rtol=1e-6)


def test_large_exemplars_are_indexed_with_gaps_that_are_closed(rng: np.random.Generator) -> None:
    """A periodic texture is continued exactly though only every other place is in the index."""
    exemplar, _ = tiled(rng.random((31, 33, 3)), 0, (190, 190))
    result = texture(exemplar, size=(64, 64), tolerance=0, slack=0)
    moves = (result.match.astype(int) - result.match[0, 0] - np.indices((64, 64)).transpose(1, 2, 0)).reshape(-1, 2)
    np.testing.assert_array_equal(moves % [31, 33], 0)


@pytest.mark.parametrize(("zone", "blend"), [(10, 4), (9, 3), (6, 1), (4, 40)])
def test_neighbours_are_blended_in_a_band_alone(image: Image, zone: int, blend: int) -> None:
    """In the middle of every zone, at most as wide as it."""
    result = texture(image, zone=zone, blend=blend)
    away = (result.image.pixels != image.pixels[result.match[..., 0], result.match[..., 1]]).any(axis=2)
    step, band = PATCH - zone, min(blend, zone)
    rows, columns = (
        (np.abs(np.arange(n) % step + 0.5 - zone / 2) < band / 2) & (np.arange(n) >= step) for n in (90, 110)
    )
    bands = rows[:, None] | columns
    assert not away[~bands].any()
    if band > 1:
        assert away[bands].mean() > 0.5
    else:
        assert not away.any()
