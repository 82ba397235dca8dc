"""Parts of pictures: their pixels, sizes, wraps and digests, and flows that take them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import texloom
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.media.part import Part, parse_part
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL


def noise(rng: np.random.Generator, height: int = 48, width: int = 64) -> Image:
    return Image.of(rng.random((height, width, 3)).astype(np.float32))


def test_texts_of_parts() -> None:
    assert parse_part({}) == Part()
    assert parse_part({"crop": "40x30+8+4", "reduce": ".5"}) == Part((30, 40), (4, 8), 0.5)
    assert parse_part({"crop": "40x30"}).box(60, 80) == (15, 20, 30, 40)
    for name, text in (("crop", "0x5"), ("crop", "5x5+1"), ("crop", "9"), ("reduce", "0"), ("reduce", "1.5")):
        with pytest.raises(InputError, match=rf"^--{name}: must be"):
            parse_part({name: text})


def test_a_part_has_the_pixels_of_its_box_and_wraps_no_more(rng: np.random.Generator) -> None:
    image = noise(rng).wrapping(True)
    taken = Part((30, 40), (4, 8)).of(image)
    np.testing.assert_array_equal(taken.pixels, image.pixels[4:34, 8:48])
    assert not taken.wraps
    with pytest.raises(InputError, match=r"^--crop 64x40[+]1[+]0: is not inside 64 x 48 px"):
        Part((40, 64), (0, 1)).of(image)


def test_a_reduced_picture_wraps_as_before(rng: np.random.Generator) -> None:
    image, half = noise(rng).wrapping(True), Part(reduce=0.5)
    reduced = half.of(image)
    assert reduced.wraps.both
    assert reduced.pixels.shape == (24, 32, 3)
    moved = half.of(image.with_pixels(np.roll(image.pixels, (10, 20), (0, 1))))
    np.testing.assert_allclose(np.roll(reduced.pixels, (5, 10), (0, 1)), moved.pixels, atol=1e-6)
    assert not half.of(image.wrapping(False)).wraps


def test_excluded_pixels_do_not_colour_others_and_normals_keep_their_length(rng: np.random.Generator) -> None:
    colors = np.full((32, 32, 3), 0.25, np.float32)
    usable = np.ones((32, 32, 1), np.float32)
    colors[:, 15:], usable[:, 15:] = 5, 0
    taken = Part(reduce=0.5).of(Image(np.concatenate([colors, usable], axis=2), ("R", "G", "B", "usable")))
    np.testing.assert_allclose(taken.pixels[:, :7, :3], 0.25, rtol=1e-4)
    vectors = rng.standard_normal((32, 32, 3)).astype(np.float32)
    vectors /= np.sqrt((vectors**2).sum(axis=2, keepdims=True))
    normals = Part(reduce=0.3).of(Image(vectors, NORMAL)).pixels
    np.testing.assert_allclose((normals**2).sum(axis=2), 1, atol=1e-5)
    labels = Part(reduce=0.3).of(Image.of(rng.choice([0.0, 0.5], (32, 32)).astype(np.float32)), is_label=True)
    assert set(np.unique(labels.pixels)) <= {0.0, 0.5}


def saved(path: Path, pixels: np.ndarray) -> Path:
    PIL.Image.fromarray(pixels).save(path)
    return path


def test_a_source_of_a_part_has_its_outline_and_a_digest_of_its_own(
    rng: np.random.Generator, tmp_path: Path
) -> None:
    whole = open_source("exemplar", str(saved(tmp_path / "a.png", rng.integers(0, 256, (48, 64, 3), np.uint8))))
    taken = whole.taken(Part((30, 40), (4, 8), 0.5))
    assert (taken.height, taken.width) == (15, 20) == taken.read().pixels.shape[:2]
    assert len({whole.digest, taken.digest, whole.taken(Part((30, 40), (4, 9), 0.5)).digest}) == 3
    assert whole.taken(Part()) is whole


def test_a_run_takes_a_part_with_the_masks_of_the_exemplars_size(rng: np.random.Generator, tmp_path: Path) -> None:
    exemplar = str(saved(tmp_path / "a.png", rng.integers(0, 256, (72, 96, 3), np.uint8)))
    mask = str(saved(tmp_path / "m.png", np.full((72, 96), 255, np.uint8)))
    given: dict[str, Any] = {"params": {"texture.block": 12}, "size": 40, "store": tmp_path / "store"}
    done = texloom.run("quilting", {"exemplar": exemplar}, crop="60x60+36+0", out=tmp_path / "out", **given)
    assert 40 < done["texture"].match.max() < 60
    states = {
        crop: texloom.plan("quilting", {"exemplar": exemplar}, crop=crop, **given)[0].state
        for crop in ("60x60+36+0", "60x60+30+0")
    }
    assert list(states.values()) == ["cached", "run"]
    with pytest.raises(InputError, match=r"crop 600x60.* is not inside 96 x 72 px"):
        texloom.plan("quilting", {"exemplar": exemplar}, crop="600x60", **given)
    flow = load_flow(
        find_flow("self_tuning"), Overrides({"mask": mask}, pictures=[exemplar], part={"crop": "60x50"})
    )
    shared = Run(flow, Store(tmp_path / "store")).shared
    assert [(shared.source(name).height, shared.source(name).width) for name in flow.parts] == [(50, 60)] * 2


def test_positions_in_the_whole_picture_refuse_a_part(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"reduce: steps\.\w+\.params\.geometry has positions in the whole"):
        texloom.plan("photo_to_texture", reduce=0.5, store=tmp_path)
