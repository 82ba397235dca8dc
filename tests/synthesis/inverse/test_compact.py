"""Inverse texture synthesis, from features to the compaction."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from tests.runs import MemoryCheckpoints, run_with_progress, run_with_threads
from tests.synthetic import jump, picture, smooth_noise
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import Tsvq, TsvqParams, tsvq
from texloom.stages.common.features.control import resize_control
from texloom.stages.synthesis.control_maps.coarse_level import CoarseLevelParams, coarse_level
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features
from texloom.stages.synthesis.inverse.best_crop import BestCropParams, best_crop
from texloom.stages.synthesis.inverse.compact import Compacted, CompactLevel, CompactParams, compact
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import Matching, TextureLevel, Tree
from texloom.stages.synthesis.inverse.summary import outlines
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError

SHAPE, SIZE = (90, 120), (52, 48)


@pytest.fixture
def control() -> Image:
    """A ramp from left to right, a quarter as fine as the texture."""
    return picture(np.broadcast_to(np.linspace(0, 1, 30), (22, 30)).copy())


@pytest.fixture
def texture(rng: np.random.Generator) -> Image:
    """Blobs from green to red, and a map."""
    across = np.linspace(0, 1, SHAPE[1])
    blobs = np.clip(4 * smooth_noise(SHAPE, 2.5, rng) - 1.5, 0.02, 1)
    colour = [blobs * across, blobs * (1 - across), 0.2 * blobs, smooth_noise(SHAPE, 4, rng)]
    return Image(np.stack(colour, axis=2).astype(np.float32), ("R", "G", "B", "wetness"))


def prepared(texture: Image, control: Image | None, error: float = 0.05) -> tuple[np.ndarray, Tsvq, np.ndarray]:
    features = control_features(texture, ControlFeaturesParams(), control).planes
    tree = tsvq(features, TsvqParams(neighbourhood=5, error=error))
    return features, tree, k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=4)).candidates


def run(texture: Image, control: Image | None, seed: int = 5, checkpoints: Any = None, **params: Any) -> Compacted:
    features, tree, candidates = prepared(texture, control, params.pop("error", 0.05))
    more = {} if checkpoints is None else {"checkpoints": checkpoints}
    more |= {name: params.pop(name) for name in ("coarse", "guide") if name in params}
    return compact(
        texture, features, tree.nodes, tree.leaf, candidates, CompactParams(**{"size": SIZE, **params}),
        np.random.default_rng(seed), control, **more,
    )  # fmt: skip


def assert_same(one: Compacted, other: Compacted) -> None:
    np.testing.assert_array_equal(one.source, other.source)
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    assert one.energy == other.energy


def assert_copied(result: Compacted, texture: Image) -> None:
    row, column = result.source[..., 0], result.source[..., 1]
    np.testing.assert_array_equal(result.image.pixels, texture.pixels[row, column])


@pytest.mark.parametrize("solver", ["improved", "basic"])
@pytest.mark.parametrize("tileable", [False, True])
def test_every_pixel_is_copied_from_where_it_says(
    texture: Image, control: Image, solver: str, tileable: bool
) -> None:
    result = run(texture, control, solver=solver, tileable=tileable)
    assert result.image.wraps.both is tileable
    assert result.image.pixels.shape == (*SIZE, 4)
    assert result.image.channels == texture.channels
    assert_copied(result, texture)
    row, column = result.source[..., 0], result.source[..., 1]
    assert result.control is not None
    expected = resize_control(control, texture.height, texture.width).pixels[row, column]
    np.testing.assert_array_equal(result.control.pixels, expected)
    # the map rises by 1 over 120 px; between its pixels the values as painted are interpolated, not linear light
    np.testing.assert_allclose(result.control.pixels[..., 0], (column + 0.5) / 120, atol=0.03)


@pytest.mark.parametrize(
    "params",
    [{}, {"seams": 0.0}, {"seams": 2.0}, {"alpha": 1.0, "seams": 0.5}, {"tileable": True, "proportion": 0.5}],
    ids=str,
)
def test_energy_never_rises_within_a_level(texture: Image, control: Image, params: dict[str, Any]) -> None:
    result = run(texture, control, tolerance=0, **params)
    assert {row["level"] for row in result.energy} == {1, 2}
    for before, after in pairwise(result.energy):
        if before["level"] == after["level"]:
            assert after["energy"] <= before["energy"] * (1 + 1e-9)
        assert after["energy"] == pytest.approx(after["inverse"] + after["forward"] + after["seams"])
    assert result.energy[-1]["energy"] < 0.8 * result.energy[0]["energy"]


def test_all_parts_of_the_texture_are_represented(texture: Image, control: Image) -> None:
    """Colours of both ends of the control map, which no crop of this size holds."""
    result = run(texture, control, size=(40, 40))
    shares = np.histogram(result.source[..., 1], 4, (0, 120))[0] / result.source[..., 1].size
    assert shares.min() > 0.08


def test_a_torus_fits_across_its_borders(texture: Image) -> None:
    jumps = [
        jump(lab_from_linear(run(texture, None, size=(40, 40), seams=2.0, tileable=tileable).image.color))
        for tileable in (False, True)
    ]
    assert jumps[0] > 2.5
    assert jumps[1] < 1.7


def test_energy_and_votes_of_a_torus_do_not_change_when_it_is_shifted(texture: Image) -> None:
    features, tree, candidates = prepared(texture, None)
    level = TextureLevel(features, 5, 2, Tree(tree.nodes, tree.leaf, candidates), TsvqParams(), KCoherenceParams())
    source = np.stack(np.meshgrid(np.arange(10, 40), np.arange(20, 56), indexing="ij")).astype(np.int32)
    source[:, 12:, 9:] = source[:, :18, :27].copy()
    energies, total_weights = [], []
    for shift in ((0, 0), (7, 31)):
        matching = Matching(level, np.ascontiguousarray(np.roll(source, shift, (1, 2))), 0.01, 0.6, wrap=True)
        matching.match_inverse(matching.propose_by_search())
        matching.match_forward_by_search()
        means, weights = matching.mean_votes()
        assert means.shape == (30, 36, features.shape[2])
        energies.append(matching.energy())
        total_weights.append(weights.sum())
    np.testing.assert_allclose(*energies, rtol=1e-4)
    np.testing.assert_allclose(*total_weights, rtol=1e-5)


def test_each_term_alone_lowers_its_own_part(texture: Image, control: Image) -> None:
    """Forward alone loses what the texture has, inverse alone leaves what the texture has not (Figure 6)."""
    features, _, _ = prepared(texture, control)
    exact = ExactEnergy(features, 5, 2000)
    terms = {}
    for name, omitted in (("both", None), ("forward", "inverse"), ("inverse", "forward")):
        result = run(texture, control, terms=name, seams=0.0, start="random")
        assert_copied(result, texture)
        terms[name] = exact.of(features[result.source[..., 0], result.source[..., 1]])
        assert omitted is None or result.energy[-1][omitted] == 0
    assert terms["forward"].inverse > 1.5 * terms["both"].inverse
    assert terms["forward"].forward < terms["both"].forward < terms["inverse"].forward


@pytest.mark.parametrize("tileable", [False, True])
def test_no_crop_is_better(rng: np.random.Generator, tileable: bool) -> None:
    """Noise with one place of blots: every arrangement of blocks has seams, and a crop has none."""
    planes = rng.uniform(0.2, 0.6, (*SHAPE, 3)).astype(np.float32)
    planes[60:80, 80:110] = smooth_noise((20, 30), 2, rng)[..., None]
    noise = Image(planes, ("R", "G", "B"))
    features, _, _ = prepared(noise, None)
    exact = ExactEnergy(features, 5, 2048)
    result = run(noise, None, size=(40, 40), tileable=tileable, seams=2.2)
    source = best_crop(noise, features, BestCropParams(size=(40, 40), neighbourhood=5)).source
    extra = ((0, 4 * tileable), (0, 4 * tileable), (0, 0))
    made, crop = (
        exact.inverse_of(np.pad(features[places[..., 0], places[..., 1]], pad, mode="wrap"))
        for places, pad in ((result.source, extra), (source, ((0, 0),) * 3))
    )
    assert made <= 1.01 * crop


def test_use_is_how_often_the_texture_has_what_a_pixel_shows(rng: np.random.Generator) -> None:
    """Dark noise in four fifths of a texture, light noise in the rest; half of the compaction each."""
    planes = rng.uniform(0.02, 0.05, (*SHAPE, 3)).astype(np.float32)
    planes[:, 96:] = rng.uniform(0.5, 0.6, (90, 24, 3))
    result = run(Image(planes, ("R", "G", "B")), None, size=(40, 40), tileable=True)
    is_light = result.image.pixels[..., 0] > 0.3
    assert result.use.mean() == pytest.approx(1, abs=1e-3)
    assert result.use[is_light].sum() / result.use.sum() == pytest.approx(0.2, abs=0.06)


def test_a_texture_is_its_own_best_compaction(texture: Image) -> None:
    """Where every neighbourhood is a cluster of its own."""
    texture = Image(np.ascontiguousarray(texture.pixels[:, :90]), texture.channels)
    result = run(texture, None, size=(90, 90), coarsest=1000, block=128, spacing=1, error=1e-4)
    assert result.control is None
    np.testing.assert_array_equal(result.image.pixels, texture.pixels)
    assert result.energy[-1]["energy"] == 0


def test_same_bits_for_any_number_of_threads(
    texture: Image, control: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = run_with_threads(lambda: run(texture, control, tileable=True, proportion=0.5), monkeypatch)
    assert_same(*results)
    one, other = (run(texture, control, seed=seed, start="cover").source for seed in (5, 6))
    assert (one != other).any()


def test_continues_from_a_checkpoint(texture: Image, control: Image) -> None:
    checkpoints = MemoryCheckpoints(CompactLevel)
    whole = run(texture, control, checkpoints=checkpoints)
    assert set(checkpoints.saved) == {1}
    resumed, seen = run_with_progress(lambda: run(texture, control, seed=99, checkpoints=checkpoints))
    assert_same(resumed, whole)
    assert {progress.scale for progress in seen if progress.scale} == {2}


def test_progress_rises_to_the_end(texture: Image, control: Image) -> None:
    result, seen = run_with_progress(lambda: run(texture, control))
    seen = [progress for progress in seen if progress.scale]  # without the clusters
    assert [progress.done for progress in seen] == sorted(progress.done for progress in seen)
    assert seen[-1].done == 1
    assert {row["energy"] for row in result.energy} <= {progress.energy for progress in seen}
    last = [progress for progress in seen if progress.energy == result.energy[-1]["energy"]][-1]
    assert last.preview is not None
    np.testing.assert_array_equal(last.preview().pixels, result.image.pixels)


def test_automatic_size_is_a_quarter_of_the_clusters(texture: Image) -> None:
    _, tree, _ = prepared(texture, None)
    height, width = run(texture, None, size="auto", iterations=1).image.pixels.shape[:2]
    assert height * width == pytest.approx(0.25 * tree.clusters, rel=0.05)
    assert height / width == pytest.approx(SHAPE[0] / SHAPE[1], rel=0.05)


def test_size_as_a_share_of_the_pixels(texture: Image) -> None:
    result = run(texture, None, size=0.15, iterations=1)
    assert result.sides == [40, 40]  # sqrt(0.15 * 90 * 120) is 40.2
    told = outlines(CompactParams(size=0.15), {"texture": texture})["image"]
    assert (told.height, told.width, told.channels) == (40, 40, result.image.channels)
    assert run(texture, None, size=0.99, iterations=1).sides == [90, 90]


def test_a_coarse_level_counts_in_the_share_and_its_colours_are_copied(texture: Image) -> None:
    level = coarse_level(texture, CoarseLevelParams(coarser=4))
    made = run(texture, None, size=0.15, iterations=1, coarse=level.image, guide=level.guide)
    assert made.sides == [32, 32]  # sqrt(0.15 * 90 * 120 - 22 * 30) is 31
    told = outlines(CompactParams(size=0.15), {"texture": texture, "coarse": level.image})["image"]
    assert (told.height, told.width) == (32, 32)
    assert made.guide is not None
    np.testing.assert_array_equal(made.guide, level.guide[made.source[..., 0], made.source[..., 1]])


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((91, 50), "^compact: size: 50 x 91 px is larger than the texture of 120 x 90 px$"),
        ((4, 50), "^compact: size: 50 x 4 px does not hold a neighbourhood of 5 px$"),
    ],
)
def test_wrong_sizes_are_refused(texture: Image, size: tuple[int, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(texture, None, size=size)
