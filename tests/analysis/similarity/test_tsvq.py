"""Clusters of a texture's neighbourhoods, and candidates from them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.runs import run_with_progress
from tests.synthetic import smooth_noise
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import TsvqParams, cut, largest_distance, tsvq
from texloom.stages.vocabulary.declare import InputError


def test_any_number_of_clusters_from_one_tree(rng: np.random.Generator) -> None:
    """Fewer clusters, more distortion; a centre is a member of its cluster."""
    planes = (60 * smooth_noise((90, 120, 3), 2.5, rng)).astype(np.float32)
    tree = tsvq(planes, TsvqParams(neighbourhood=5, error=0.05))
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


def test_a_tree_of_two_textures_separates_them_first() -> None:
    planes = np.zeros((40, 60, 3), np.float32)
    planes[:, 30:, 0] = 80
    planes[::2, :30, 1] = 10
    tree = tsvq(planes, TsvqParams(neighbourhood=3))
    side = cut(tree.nodes, 2)[tree.leaf]
    assert len(np.unique(side)) == 2
    assert len(np.unique(side[:, :27])) == 1
    assert len(np.unique(side[:, 31:])) == 1


def test_candidates_of_stripes_are_whole_periods_away() -> None:
    planes = np.zeros((40, 48, 3), np.float32)
    planes[..., 0] = 50 + 40 * np.sin(np.arange(48) * 2 * np.pi / 6)
    tree = tsvq(planes, TsvqParams(neighbourhood=5, error=0.01))
    candidates = k_coherence(planes, tree.nodes, tree.leaf, KCoherenceParams(k=3)).candidates
    across = candidates.shape[1]
    own = np.arange(candidates[..., 0].size).reshape(*candidates.shape[:2], 1)
    np.testing.assert_array_equal(candidates[..., :1], own)
    assert (candidates >= 0).all()
    assert ((candidates % across - own % across) % 6 == 0).all()


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((6, 9, 3), "neighbourhood=7 px does not fit in a texture of 9 x 6 px"),
        ((20, 20, 53), "tsvq: 53 channels in neighbourhoods of 7 px are too many; at most 52 channels can be"),
    ],
)
def test_what_does_not_fit_is_refused(shape: tuple[int, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        tsvq(np.zeros(shape, np.float32), TsvqParams(neighbourhood=7))


def test_progress_goes_to_the_end(rng: np.random.Generator) -> None:
    planes = smooth_noise((40, 50, 3), 1.5, rng) * 50
    _, reports = run_with_progress(lambda: tsvq(planes.astype(np.float32), TsvqParams(neighbourhood=5)))
    done = [report.done for report in reports]
    assert len(done) > 3
    assert done == sorted(done)
    assert done[-1] == 1.0
