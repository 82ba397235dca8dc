"""Scores of small pictures as summaries of a large texture."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.similarity.tsvq import TsvqParams, tsvq
from texloom.stages.evaluation.summary_scores import SummaryScoresParams, summary_scores
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def texture(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((48, 60), 1.5, rng))


def places(top: int, left: int, height: int, width: int) -> np.ndarray:
    corner = np.array([top, left])
    return np.ascontiguousarray(np.moveaxis(np.indices((height, width)), 0, 2) + corner).astype(np.uint32)


def test_the_whole_texture_scores_one_and_its_mean_nothing(texture: Image) -> None:
    features = texture.pixels * 100
    mean = np.full((48, 60, 1), features.mean(), np.float32)
    scores = summary_scores(
        texture, features, SummaryScoresParams(), source=places(0, 0, 48, 60), epitome=mean, reconstruction=texture
    ).table
    lines = scores["measures"]
    assert list(lines) == ["compaction", "epitome", "reconstruction"]
    assert lines["compaction"]["value"] == lines["reconstruction"]["value"] == 0
    assert lines["compaction"]["score"] == lines["reconstruction"]["score"] == 1
    assert lines["epitome"]["value"] == pytest.approx(features.var(), rel=0.15)
    assert lines["epitome"]["score"] < 0.15
    assert scores["summary"]["likeness"] == 1
    json.dumps(scores, allow_nan=False)


def test_a_crop_has_nothing_foreign_and_noise_has(texture: Image, rng: np.random.Generator) -> None:
    scattered = np.stack([rng.integers(0, 48, (24, 24)), rng.integers(0, 60, (24, 24))], axis=2).astype(np.uint32)
    lines = summary_scores(
        texture, texture.pixels * 100, SummaryScoresParams(alpha=0.5), crop=places(7, 9, 24, 24), carved=scattered
    ).table["measures"]
    assert lines["crop"]["more"]["forward"] == 0
    assert lines["crop"]["more"]["inverse"] == lines["crop"]["value"]
    assert lines["seam_carving"]["more"]["forward"] > 0.2 * texture.pixels.var() * 100**2
    more = lines["seam_carving"]["more"]
    assert lines["seam_carving"]["value"] == pytest.approx(more["inverse"] + 0.5 * more["forward"], rel=1e-4)


def test_neighbourhoods_across_the_border_of_a_tileable_compaction_count(rng: np.random.Generator) -> None:
    """A texture that repeats every 20 px, of which one period has been cut."""
    texture = picture(np.tile(smooth_noise((20, 20), 1.5, rng), (3, 3)))

    def energy(tileable: bool) -> float:
        scores = summary_scores(
            texture,
            texture.pixels * 100,
            SummaryScoresParams(),
            source=places(3, 5, 20, 20),
            compaction=picture(np.zeros((20, 20))).wrapping(tileable),
        )
        value: float = scores.table["measures"]["compaction"]["value"]
        return value

    assert energy(tileable=True) == 0
    assert energy(tileable=False) > 1


def test_a_reconstruction_is_as_large_as_the_texture(texture: Image) -> None:
    with pytest.raises(InputError, match="reconstruction: 9 x 9 px; the texture has 60 x 48 px"):
        summary_scores(texture, texture.pixels, SummaryScoresParams(), reconstruction=picture(np.zeros((9, 9))))


def test_the_way_from_the_best_crop_to_separate_neighbourhoods(texture: Image) -> None:
    features = np.repeat(texture.pixels * 100, 3, axis=2)
    tree = tsvq(features, TsvqParams(neighbourhood=7))
    lines = summary_scores(
        texture, features, SummaryScoresParams(), nodes=tree.nodes, leaf=tree.leaf,
        source=places(0, 0, 24, 24), crop=places(7, 9, 24, 24),
    ).table["measures"]  # fmt: skip
    more = lines["way"]["more"]
    assert more["crop"] == lines["crop"]["more"]["inverse"]
    assert more["means"] <= more["patches"] < more["crop"]
    nearer = more["crop"] - lines["compaction"]["more"]["inverse"]
    assert lines["way"]["value"] == pytest.approx(nearer / (more["crop"] - more["patches"]), rel=1e-3)
