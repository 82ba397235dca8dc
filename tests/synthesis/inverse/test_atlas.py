"""Several textures in one picture, and in one compaction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import blobs, picture
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import TsvqParams, tsvq
from texloom.stages.common.similarity.neighbourhoods import inside_at, inside_of, whole
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features
from texloom.stages.synthesis.inverse.atlas import Atlas, AtlasParams, atlas
from texloom.stages.synthesis.inverse.compact import Compacted, CompactParams, compact
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SIZES = [(60, 70), (80, 50), (50, 90)]


def family(rng: np.random.Generator) -> list[Image | None]:
    """Blobs of three colours, and one that failed."""
    colours = 0.1 + 0.9 * np.eye(3)
    pictures = [picture(blobs(size, rng)[..., None] * colour) for colour, size in zip(colours, SIZES, strict=True)]
    return [*pictures, None]


def arranged(textures: list[Image | None], **more: Any) -> Atlas:
    items = [{"name": name, "seed": 1} for name in "abcd"[: len(textures)]]
    return atlas(textures, items, AtlasParams(), **more)


@pytest.fixture
def together(rng: np.random.Generator) -> Atlas:
    return arranged(family(rng))


def compacted(together: Atlas) -> Compacted:
    features = control_features(together.image, ControlFeaturesParams()).planes
    tree = tsvq(features, TsvqParams(neighbourhood=5), together.rectangles)
    candidates = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=3)).candidates
    known = whole(inside_of(together.rectangles, *features.shape[:2]), 5)
    np.testing.assert_array_equal(tree.leaf >= 0, known)
    np.testing.assert_array_equal(candidates[..., 0] >= 0, known)
    assert known.ravel()[candidates[candidates >= 0]].all()
    assert known[tree.nodes[:, 2], tree.nodes[:, 3]].all()
    return compact(
        together.image, features, tree.nodes, tree.leaf, candidates, CompactParams(size=(52, 52)),
        np.random.default_rng(2), rectangles=together.rectangles,
    )  # fmt: skip


def test_every_texture_lies_where_it_says(rng: np.random.Generator) -> None:
    textures = family(rng)
    together = arranged(textures)
    assert together.names == ["a", "b", "c"]
    assert together.control is None
    for texture, (row, column, height, width) in zip(textures, together.rectangles.tolist(), strict=False):
        assert texture is not None
        np.testing.assert_array_equal(
            together.image.pixels[row : row + height, column : column + width], texture.pixels
        )
    inside = inside_of(together.rectangles, together.image.height, together.image.width)
    assert inside.sum() == sum(height * width for height, width in SIZES)  # none over another


def test_joint_compaction_names_texture_and_pixel(rng: np.random.Generator) -> None:
    textures = family(rng)
    together = arranged(textures)
    result = compacted(together)
    assert result.origin is not None
    for number, texture in enumerate(textures[:3]):
        assert texture is not None
        _, row, column = result.origin[result.origin[..., 0] == number].T
        assert row.size > 0.1 * 52 * 52  # each has its share
        np.testing.assert_array_equal(
            result.image.pixels[result.origin[..., 0] == number], texture.pixels[row, column]
        )
    np.testing.assert_array_equal(
        result.image.pixels, together.image.pixels[result.source[..., 0], result.source[..., 1]]
    )
    for before, after in zip(result.energy, result.energy[1:], strict=False):
        assert before["level"] != after["level"] or after["energy"] <= before["energy"] * (1 + 1e-9)
    assert {row["level"] for row in result.energy} == {1, 2}


def test_same_bits_for_any_number_of_threads(together: Atlas, monkeypatch: pytest.MonkeyPatch) -> None:
    np.testing.assert_array_equal(*run_with_threads(lambda: compacted(together).source, monkeypatch))


def test_coarse_pixels_cover_nothing_else() -> None:
    inside = np.full((7, 8), True)
    inside[3, 5] = False
    coarse = inside_at(inside, 4, 4)
    expected = np.full((4, 4), True)
    expected[1:3, 2] = False  # rows 1.75 to 3.5 and 3.5 to 5.25, columns 4 to 6
    np.testing.assert_array_equal(coarse, expected)
    np.testing.assert_array_equal(inside_at(inside, 7, 8), inside)


def test_textures_that_do_not_fit_are_refused(rng: np.random.Generator) -> None:
    textures = family(rng)
    map_of = picture(np.zeros((15, 25)) + np.arange(25))
    with pytest.raises(InputError, match="atlas: there is no texture"):
        arranged([None])
    with pytest.raises(InputError, match="atlas: texture b has the channels Y, a has R G B"):
        arranged([textures[0], map_of])
    with pytest.raises(InputError, match="control a: 25 x 15 px has another aspect ratio than its texture"):
        arranged(textures[:1], controls=[map_of])
    with pytest.raises(InputError, match="atlas: b has no control map"):
        arranged([map_of, map_of], controls=[map_of, None])
