"""An edit of a compaction appears in the texture, and nowhere else."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import TsvqParams, tsvq
from texloom.stages.common.features.control import from_painted, painted_values
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features
from texloom.stages.synthesis.inverse.compact import Compacted, CompactParams, compact
from texloom.stages.synthesis.inverse.propagate_edit import PropagateEdit, PropagateEditParams, propagate_edit
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


@dataclasses.dataclass(frozen=True)
class Case:
    """A texture with its analysis and compaction."""

    texture: Image
    known: dict[str, Any]
    small: Compacted

    def edited(self, edited: Image, **params: Any) -> PropagateEdit:
        return propagate_edit(
            self.texture, **self.known, source=self.small.source, compaction=self.small.image, edited=edited,
            params=PropagateEditParams(**params),
        )  # fmt: skip


@pytest.fixture(params=[False, True], ids=["plane", "torus"])
def case(request: pytest.FixtureRequest, rng: np.random.Generator) -> Case:
    """Red squares on grey noise, rough where they are red; every other row of squares is green."""
    texture = np.full((80, 96, 4), 0.3, np.float32)
    texture[..., :3] += rng.uniform(-0.03, 0.03, (80, 96, 1))
    texture[..., 3] = 0.2
    for row in range(0, 80, 16):
        for column in range(0, 96, 16):
            square = np.s_[row + 4 : row + 12, column + 4 : column + 12]
            texture[square] = (0.6, 0.05, 0.05, 0.9) if row % 32 == 0 else (0.05, 0.5, 0.05, 0.5)
    image = Image(texture, ("R", "G", "B", "roughness"))
    features = control_features(image, ControlFeaturesParams()).planes
    tree = tsvq(features, TsvqParams(neighbourhood=5))
    known = {"features": features, "nodes": tree.nodes, "leaf": tree.leaf}
    known["candidates"] = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=4)).candidates
    params = CompactParams(size=(40, 40), tileable=request.param, block=20)
    small = compact(image, **known, params=params, rng=np.random.default_rng(3))
    return Case(image, known, small)


def red(image: Image) -> np.ndarray:
    return np.asarray(image.pixels[..., 0] > 0.5)


def in_blue(image: Image) -> Image:
    """Red becomes blue; colour only."""
    pixels = image.pixels[..., :3].copy()
    pixels[red(image)] = (0.05, 0.05, 0.6)
    return Image(pixels, ("R", "G", "B"))


def test_an_edit_changes_every_instance_and_nothing_else(case: Case) -> None:
    made = case.edited(in_blue(case.small.image))
    assert made.notes == [] or "maps stay" in made.notes[0]
    wanted = red(case.texture)
    assert (made.mask == wanted).mean() > 0.99
    np.testing.assert_array_equal(made.image.pixels[~made.mask], case.texture.pixels[~made.mask])
    both = made.mask & wanted
    np.testing.assert_allclose(made.image.pixels[both][:, :3], [(0.05, 0.05, 0.6)] * both.sum(), atol=0.15)
    np.testing.assert_array_equal(made.image.pixels[..., 3], case.texture.pixels[..., 3])  # like nothing there is


def test_what_is_painted_over_by_another_material_takes_its_maps(case: Case) -> None:
    """Red squares are painted green, as others are."""
    pixels = case.small.image.pixels[..., :3].copy()
    pixels[red(case.small.image)] = (0.05, 0.5, 0.05)
    made = case.edited(Image(pixels, ("R", "G", "B")))
    inner = np.zeros((80, 96), bool)
    for row in range(0, 80, 32):
        for column in range(0, 96, 16):
            inner[row + 6 : row + 10, column + 6 : column + 10] = True
    assert np.median(made.image.pixels[inner][:, 3]) == pytest.approx(0.5, abs=0.02)
    kept = case.edited(Image(pixels, ("R", "G", "B")), maps=False).image
    np.testing.assert_array_equal(kept.pixels[..., 3], case.texture.pixels[..., 3])


def test_coarse_colours_tell_apart_what_looks_alike(case: Case) -> None:
    """Red squares of the left half are painted blue; the compaction is a part of the texture from both halves."""
    source = np.stack(np.mgrid[:40, 28:68], axis=2).astype(np.uint32)
    image = Image(np.ascontiguousarray(case.texture.pixels[:40, 28:68]), case.texture.channels)
    part = dataclasses.replace(case, small=dataclasses.replace(case.small, source=source, image=image))
    edited = image.pixels[..., :3].copy()
    edited[red(image) & (source[..., 1] < 48)] = (0.05, 0.05, 0.6)
    guide = np.zeros((80, 96, 3), np.float32)
    guide[:, 48:, 0] = 40.0
    known = case.known | {"features": np.concatenate([case.known["features"], guide], axis=2)}
    made = [
        each.edited(Image(edited, ("R", "G", "B"))).mask for each in (part, dataclasses.replace(part, known=known))
    ]
    there = red(case.texture)
    assert made[1][:, :40][there[:, :40]].mean() > 0.95
    assert made[1][:, 56:].mean() < 0.5 * made[0][:, 56:].mean()


def test_rounding_to_8_bits_is_no_edit(case: Case) -> None:
    values = np.rint(255 * painted_values(case.small.image)) / 255
    made = case.edited(from_painted(values.astype(np.float32), case.small.image.channels))
    np.testing.assert_array_equal(made.image.pixels, case.texture.pixels)
    np.testing.assert_array_equal(made.compaction.pixels, case.small.image.pixels)
    assert made.share == 0
    assert "No pixel" in made.notes[0]


def test_same_bits_for_any_number_of_threads(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = run_with_threads(lambda: case.edited(in_blue(case.small.image)).image.pixels, monkeypatch)
    np.testing.assert_array_equal(one, other)


def test_another_size_is_refused(case: Case) -> None:
    with pytest.raises(InputError, match=r"^edited: 20 x 20 px; the compaction has 40 x 40 px$"):
        case.edited(picture(np.zeros((20, 20, 3))))
