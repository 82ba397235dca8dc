from __future__ import annotations

import numpy as np
import pydantic
import pytest

from tests.synthetic import continued, picture, smooth_noise, tiled
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, find_stage
from texloom.stages.synthesis._seams.boundaries import Boundaries, square_means, zone_mask
from texloom.stages.synthesis.patch_based import PatchBased, PatchBasedParams, patch_based

PATCH, ZONE = 24, 4
GEOMETRY = {"patch": PATCH, "zone": ZONE}


def texture(image: Image, seed: int = 1, **params: object) -> PatchBased:
    given = PatchBasedParams(**{"size": (90, 110), **GEOMETRY, **params})  # type: ignore[arg-type]
    return patch_based(image, given, np.random.default_rng(seed))


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
    assert result.tileable is wrap
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


@pytest.mark.parametrize(("drop", "cell"), [(0, (16, 20)), (7, (17, 21))])
def test_a_periodic_texture_is_continued_exactly(
    drop: int, cell: tuple[int, int], rng: np.random.Generator
) -> None:
    exemplar, _ = tiled(rng.random((*cell, 3)), drop, (72, 90))
    result = texture(exemplar, size=(150, 170), tolerance=0, slack=0)
    pattern = exemplar.pixels[: cell[0], : cell[1]]
    np.testing.assert_allclose(result.image.pixels, continued(pattern, drop, result.match), atol=1e-5)


def test_tileable_continues_across_borders(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((16, 20, 3)), 0, (72, 90))
    result = texture(exemplar, size=(96, 120), tileable=True, tolerance=0, slack=0).image.pixels
    np.testing.assert_allclose(result, np.roll(result, (16, 20), (0, 1)), atol=1e-5)


@pytest.mark.parametrize("size", [(16, 16), (17, 40), (40, 17), (97, 101), (25, 49)])
@pytest.mark.parametrize("wrap", [False, True])
def test_every_size_is_filled(image: Image, size: tuple[int, int], wrap: bool) -> None:
    result = texture(image, size=size, tileable=wrap)
    assert result.image.pixels.shape[:2] == result.match.shape[:2] == size
    assert result.image.pixels.min() >= image.pixels.min() - 1e-6
    assert result.image.pixels.max() <= image.pixels.max() + 1e-6
    assert (result.match < [image.height, image.width]).all()
    # what wraps is no rougher at the border than inside
    if wrap and min(size) > 48:
        steps = np.abs(np.diff(result.image.pixels, axis=0, append=result.image.pixels[:1])).mean(axis=(1, 2))
        assert steps[-1] < 1.5 * steps[:-1].max()


def test_maps_ride_along(image: Image) -> None:
    height = smooth_noise((64, 80), 3.0, np.random.default_rng(4))[..., None].astype(np.float32)
    both = Image(np.concatenate([image.pixels, height], axis=2), (*image.channels, "height"))
    plain, rich = texture(image), texture(both, weights={"height": 0})
    np.testing.assert_array_equal(rich.image.pixels[..., :3], plain.image.pixels)
    np.testing.assert_array_equal(rich.match, plain.match)
    assert rich.image.channels == ("R", "G", "B", "height")


def test_grey_pictures(rng: np.random.Generator) -> None:
    grey = picture(smooth_noise((64, 64), 2.0, rng))
    assert texture(grey).image.channels == ("Y",)


def test_tolerance_brings_variety(image: Image) -> None:
    """With none the best patch goes everywhere, here the one that stood there; with some others do too."""

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


def test_same_seed_same_bits(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for threads in ("1", "4", "4"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        results.append(texture(image, tileable=True))
    for other in results[1:]:
        np.testing.assert_array_equal(other.image.pixels, results[0].image.pixels)
        np.testing.assert_array_equal(other.match, results[0].match)
    assert (texture(image, seed=2).match != texture(image, seed=1).match).any()


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"patch": 65, "size": (90, 90)}, "patch: 65 px does not fit into an exemplar of 64x80 px"),
        ({"patch": 20, "zone": 11}, "zone: 11 px is more than half a patch, 20 px"),
    ],
)
def test_bad_requests(image: Image, params: dict[str, object], words: str) -> None:
    check = find_stage("synthesis.patch_based").check
    assert check is not None
    check(PatchBasedParams(), {})
    with pytest.raises(InputError, match=words):
        check(PatchBasedParams(**params), {"image": image})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words):
        texture(image, **params)


def test_small_exemplars(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="8 px does not fit into an exemplar of 7x30 px"):
        texture(picture(rng.random((7, 30, 3))), patch=None, zone=None)
    texture(picture(rng.random((8, 8, 3))), patch=None, zone=None)
    texture(picture(np.full((20, 20, 3), 0.0)), patch=None, zone=None)


@pytest.mark.parametrize(
    "params", [{"size": (8, 20)}, {"patch": 4}, {"zone": 0}, {"tolerance": -1}, {"variance": 0}]
)
def test_params_have_bounds(params: dict[str, object]) -> None:
    with pytest.raises(pydantic.ValidationError):
        PatchBasedParams(**params)  # type: ignore[arg-type]


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
