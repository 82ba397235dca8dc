"""Inverse texture synthesis, from features to the compaction."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.tsvq import Tsvq, TsvqParams, cut, largest_distance, tsvq
from texloom.stages.arrays import Image
from texloom.stages.color import lab_from_linear
from texloom.stages.common.control import resize_control
from texloom.stages.declare import InputError
from texloom.stages.progress import Progress, listening
from texloom.stages.synthesis.compact import Compacted, CompactLevel, CompactParams, compact
from texloom.stages.synthesis.control_features import ControlFeaturesParams, control_features
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import Level, Matching, Tree

SHAPE, SIZE = (90, 120), (52, 48)


@pytest.fixture
def control(rng: np.random.Generator) -> Image:
    """From left to right, a quarter as fine as the texture."""
    return picture(np.broadcast_to(np.linspace(0, 1, 30), (22, 30)).copy())


@pytest.fixture
def texture(rng: np.random.Generator) -> Image:
    """Blobs that turn from green to red, and a map that rides along."""
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
    given = CompactParams(**{"size": SIZE, **params})
    more = {} if checkpoints is None else {"checkpoints": checkpoints}
    random = np.random.default_rng(seed)
    return compact(texture, features, tree.nodes, tree.leaf, candidates, given, random, control, **more)


def assert_same(one: Compacted, other: Compacted) -> None:
    np.testing.assert_array_equal(one.source, other.source)
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    assert one.energy == other.energy


def assert_copied(result: Compacted, texture: Image) -> None:
    row, column = result.source[..., 0], result.source[..., 1]
    np.testing.assert_array_equal(result.image.pixels, texture.pixels[row, column])


@pytest.mark.parametrize(
    ("solver", "tileable"), [("improved", False), ("basic", False), ("improved", True), ("basic", True)]
)
def test_every_pixel_is_copied_from_where_it_says(
    texture: Image, control: Image, solver: str, tileable: bool
) -> None:
    result = run(texture, control, solver=solver, tileable=tileable)
    assert result.tileable == tileable
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
    "given",
    [{}, {"seams": 0.0}, {"seams": 2.0}, {"alpha": 1.0, "seams": 0.5}, {"tileable": True, "proportion": 0.5}],
    ids=str,
)
def test_energy_never_rises_within_a_level(texture: Image, control: Image, given: dict[str, Any]) -> None:
    result = run(texture, control, tolerance=0, **given)
    assert {row["level"] for row in result.energy} == {1, 2}
    for before, after in pairwise(result.energy):
        if before["level"] == after["level"]:
            assert after["energy"] <= before["energy"] * (1 + 1e-9)
        assert after["energy"] == pytest.approx(after["inverse"] + after["forward"] + after["seams"])
    assert result.energy[-1]["energy"] < 0.8 * result.energy[0]["energy"]


def test_all_that_the_texture_has_is_kept(texture: Image, control: Image) -> None:
    """Colours of both ends of the control map, which no crop of this size holds."""
    result = run(texture, control, size=(40, 40))
    held = np.histogram(result.source[..., 1], 4, (0, 120))[0] / result.source[..., 1].size
    assert held.min() > 0.08


def test_a_torus_fits_across_its_borders(texture: Image) -> None:
    """Steps across the border are as small as those within."""
    size = (40, 40)
    open_, closed = (run(texture, None, size=size, seams=2.0, tileable=tileable) for tileable in (False, True))
    assert_copied(closed, texture)

    def steps(result: Compacted) -> tuple[float, float]:
        lab = lab_from_linear(result.image.color)
        across = np.concatenate([lab[:, 0] - lab[:, -1], lab[0] - lab[-1]])
        within = np.concatenate([np.diff(lab, axis=0).reshape(-1, 3), np.diff(lab, axis=1).reshape(-1, 3)])
        return tuple(float(np.sqrt((part**2).sum(axis=1)).mean()) for part in (across, within))  # type: ignore[return-value]

    assert steps(open_)[0] > 2.5 * steps(open_)[1]
    assert steps(closed)[0] < 1.7 * steps(closed)[1]


def test_a_torus_is_the_same_from_wherever_it_is_seen(texture: Image) -> None:
    """Energy and votes do not change when the compaction is shifted."""
    features, tree, candidates = prepared(texture, None)
    level = Level(features, 5, 2, Tree(tree.nodes, tree.leaf, candidates), TsvqParams(), KCoherenceParams())
    source = np.stack(np.meshgrid(np.arange(10, 40), np.arange(20, 56), indexing="ij")).astype(np.int32)
    source[:, 12:, 9:] = source[:, :18, :27].copy()
    found = []
    for shift in ((0, 0), (7, 31)):
        matching = Matching(level, np.ascontiguousarray(np.roll(source, shift, (1, 2))), 0.01, 0.6, wrap=True)
        matching.match_inverse(matching.propose_by_search())
        matching.match_forward_by_search()
        means, weights = (np.roll(plane, (-shift[0], -shift[1]), (0, 1)) for plane in matching.mean_votes())
        found.append((matching.energy(), means.shape, weights.sum()))
    assert found[0][1] == found[1][1] == (30, 36, features.shape[2])
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-4)
    np.testing.assert_allclose(found[0][2], found[1][2], rtol=1e-5)


def test_each_term_alone_does_what_it_is_for(texture: Image, control: Image) -> None:
    """Forward alone loses what the texture has, inverse alone leaves what the texture has not (Figure 6)."""
    found = {
        terms: run(texture, control, terms=terms, seams=0.0, start="random")
        for terms in ("both", "forward", "inverse")
    }
    features, _, _ = prepared(texture, control)
    exact = ExactEnergy(features, 5, 2000)
    terms = {}
    for name, result in found.items():
        assert_copied(result, texture)
        terms[name] = exact.of(features[result.source[..., 0], result.source[..., 1]])
    assert terms["forward"].inverse > 1.5 * terms["both"].inverse
    assert terms["forward"].forward < terms["both"].forward < terms["inverse"].forward
    assert found["forward"].energy[-1]["inverse"] == 0
    assert found["inverse"].energy[-1]["forward"] == 0


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
    found = []
    for threads in "13":
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        found.append(run(texture, control, tileable=True, proportion=0.5))
    assert_same(*found)
    assert (run(texture, control, seed=6, tileable=True, proportion=0.5).source != found[0].source).any()


class Kept:
    """Keeps checkpoints in memory."""

    def __init__(self) -> None:
        self.states: dict[int, Any] = {}

    def latest(self, state: type[Any]) -> tuple[int, Any] | None:
        return max(self.states.items()) if self.states else None

    def save(self, level: int, state: Any) -> None:
        assert isinstance(state, CompactLevel)
        self.states[level] = state


def test_goes_on_from_a_checkpoint(texture: Image, control: Image) -> None:
    kept = Kept()
    whole = run(texture, control, checkpoints=kept)
    assert set(kept.states) == {1}
    seen: list[Progress] = []
    with listening(seen.append):
        assert_same(run(texture, control, seed=99, checkpoints=kept), whole)
    assert {progress.scale for progress in seen} == {2}


def test_progress_rises_to_the_end(texture: Image, control: Image) -> None:
    seen: list[Progress] = []
    with listening(seen.append):
        result = run(texture, control)
    assert len(seen) == len(result.energy)
    assert [progress.done for progress in seen] == sorted(progress.done for progress in seen)
    assert seen[-1].done == 1
    assert [progress.energy for progress in seen] == [row["energy"] for row in result.energy]
    assert seen[-1].preview is not None
    np.testing.assert_array_equal(seen[-1].preview().pixels, result.image.pixels)


def test_automatic_size_is_a_quarter_of_the_clusters(texture: Image) -> None:
    _, tree, _ = prepared(texture, None)
    height, width = run(texture, None, size="auto", iterations=1).image.pixels.shape[:2]
    assert height * width == pytest.approx(0.25 * tree.clusters, rel=0.05)
    assert height / width == pytest.approx(SHAPE[0] / SHAPE[1], rel=0.05)


def test_size_as_a_share_of_the_pixels(texture: Image) -> None:
    result = run(texture, None, size=0.15, iterations=1)
    assert result.sides == [40, 40]  # sqrt(0.15 * 90 * 120) is 40.2
    assert run(texture, None, size=0.99, iterations=1).sides == [90, 90]


def test_any_number_of_clusters_from_one_tree(texture: Image) -> None:
    """Fewer clusters, more distortion; a centre is a member of its cluster."""
    _, tree, _ = prepared(texture, None)
    before = np.inf
    for wanted in (1, 7, 60, 400, tree.clusters):
        owner = cut(tree.nodes, wanted)
        kept = np.unique(owner[tree.leaf])
        assert 0.8 * wanted - 1 <= kept.size <= wanted
        distortion = tree.distortion[kept].sum()
        assert distortion < before
        before = distortion
        row, column = tree.nodes[kept, 2], tree.nodes[kept, 3]
        np.testing.assert_array_equal(owner[tree.leaf[row, column]], kept)


def test_largest_distance_is_that_of_two_vectors_far_apart() -> None:
    random = np.random.default_rng(4)
    vectors = random.normal(0, 60, (300, 32)).round().astype(np.int16)
    far = np.sqrt(((vectors[:, None].astype(float) - vectors) ** 2).sum(axis=2)).max()
    assert 0.8 * far <= largest_distance(vectors) <= far * (1 + 1e-6)
    vectors[7] = [900, *[0] * 31]
    assert largest_distance(vectors) == pytest.approx(
        np.sqrt(((vectors.astype(float) - vectors[7]) ** 2).sum(axis=1)).max()
    )


def test_a_tree_of_two_textures_parts_them_first() -> None:
    planes = np.zeros((40, 60, 3), np.float32)
    planes[:, 30:, 0] = 80
    planes[::2, :30, 1] = 10
    tree = tsvq(planes, TsvqParams(neighbourhood=3))
    side = cut(tree.nodes, 2)[tree.leaf]
    assert len(np.unique(side)) == 2
    assert len(np.unique(side[:, :27])) == 1
    assert len(np.unique(side[:, 31:])) == 1


def test_similar_places_look_alike() -> None:
    """Stripes of 6 px: the nearest place is whole periods away."""
    planes = np.zeros((40, 48, 3), np.float32)
    planes[..., 0] = 50 + 40 * np.sin(np.arange(48) * 2 * np.pi / 6)
    tree = tsvq(planes, TsvqParams(neighbourhood=5, error=0.01))
    candidates = k_coherence(planes, tree.nodes, tree.leaf, KCoherenceParams(k=3)).candidates
    across = candidates.shape[1]
    own = np.arange(candidates[..., 0].size).reshape(candidates.shape[:2])
    np.testing.assert_array_equal(candidates[..., 0], own)
    for entry in (1, 2):
        found = candidates[..., entry]
        assert (found >= 0).all()
        assert ((found % across - own % across) % 6 == 0).all()


@pytest.mark.parametrize(
    ("params", "said"),
    [
        ({"size": (91, 50)}, "compact: size=91x50 px is larger than the texture of 90x120 px"),
        ({"size": (4, 50)}, "compact: size=4x50 px does not hold a neighbourhood of 5 px"),
    ],
)
def test_sizes_that_cannot_be(texture: Image, params: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as caught:
        run(texture, None, **params)
    assert str(caught.value) == said


@pytest.mark.parametrize("kind", ["constant", "nan", "aspect", "constant control", "nan control"])
def test_pairs_that_cannot_be(texture: Image, control: Image, kind: str) -> None:
    if kind == "constant":
        texture = Image(np.full_like(texture.pixels, 0.5), texture.channels)
    elif kind == "constant control":
        control = Image(np.zeros_like(control.pixels), control.channels)
    elif kind == "aspect":
        control = Image(np.ascontiguousarray(control.pixels[:15]), control.channels)
    else:
        spoiled = control if "control" in kind else texture
        spoiled.pixels[3, 4, 0] = np.nan
    with pytest.raises(InputError, match=r"control|texture") as caught:
        control_features(texture, ControlFeaturesParams(), control)
    assert "\n" not in str(caught.value)


def test_a_texture_without_room_for_a_neighbourhood() -> None:
    with pytest.raises(InputError, match="neighbourhood=7 px does not fit in a texture of 6x9 px"):
        tsvq(np.zeros((6, 9, 3), np.float32), TsvqParams())


def test_more_channels_than_can_be_compared_are_refused_before_the_clustering() -> None:
    frames = np.zeros((20, 20, 53), np.float32)
    with pytest.raises(InputError) as caught:
        tsvq(frames, TsvqParams(neighbourhood=7))
    assert str(caught.value) == (
        "tsvq: 53 channels in neighbourhoods of 7 px are too many; at most 52 channels can be compared"
    )
