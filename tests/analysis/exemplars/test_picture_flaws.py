"""Enlarged and strongly compressed pictures are recognised, and others are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import skimage.data

from texloom.stages.analysis.exemplars.picture_flaws import flaws_of
from texloom.stages.vocabulary.arrays import Image

CLEAN = {name: getattr(skimage.data, name)() for name in ("brick", "grass", "gravel")}


def kinds(grey: np.ndarray) -> list[str]:
    return [flaw.split(":")[0].split(" of ")[0] for flaw in flaws_of(Image.of(grey))]


def compressed(grey: np.ndarray, quality: int) -> np.ndarray:
    coded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE))


ENLARGED = ["the exemplar has no detail"]
BLOCKS = ["the exemplar shows the blocks"]


@pytest.mark.parametrize("name", CLEAN)
def test_clean_pictures_are_not_reported(name: str) -> None:
    picture = CLEAN[name]
    assert not kinds(picture)
    assert not kinds(compressed(picture, 90))
    assert not kinds(cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))


@pytest.mark.parametrize("name", ["grass", "gravel"])  # the bricks are soft themselves
@pytest.mark.parametrize("factor", [1.5, 2, 3])
def test_enlarged_pictures_are(name: str, factor: float) -> None:
    enlarged = cv2.resize(CLEAN[name][:300, :300], None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    assert kinds(enlarged) == ENLARGED
    if factor != 2:
        assert kinds(compressed(enlarged, 92)) == ENLARGED


@pytest.mark.parametrize("name", CLEAN)
def test_blocks_are_recognised_wherever_they_begin(name: str) -> None:
    blocks = compressed(CLEAN[name], 10)
    assert BLOCKS == kinds(blocks) == kinds(blocks[3:, 5:])


def test_what_cannot_be_measured_is_not_reported(rng: np.random.Generator) -> None:
    assert not kinds(np.full((300, 300), 90, np.uint8))
    assert not kinds(rng.integers(0, 256, (100, 100), np.uint8))
    tiles = np.kron(rng.integers(0, 256, (40, 40), np.uint8), np.ones((8, 8), np.uint8))
    assert kinds(tiles) == BLOCKS  # cannot be told from compression
    holes = compressed(CLEAN["grass"], 10)[..., None].repeat(4, axis=2)
    holes[200:250, 200:250, 3], holes[0, 0, 3] = 0, 255
    assert not flaws_of(Image.of(holes))
