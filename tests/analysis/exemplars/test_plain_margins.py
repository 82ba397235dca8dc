"""Plain margins and labels along the rim are found, and what belongs to a texture is not."""

from __future__ import annotations

import logging

import cv2
import numpy as np
import pytest
import skimage.data

from texloom.stages.analysis.exemplars.plain_margins import plain_margins
from texloom.stages.analysis.exemplars.tone import ToneParams, tone
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels

GRAVEL = np.repeat(skimage.data.gravel()[:240, :300, None], 3, axis=2)


def found(codes: np.ndarray, quality: int | None = None) -> np.ndarray:
    if quality is not None:
        coded = cv2.imencode(".jpg", codes, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        codes = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    mask = plain_margins(Image.of(np.ascontiguousarray(codes)))
    return np.zeros(codes.shape[:2], bool) if mask is None else mask


def labelled(codes: np.ndarray, ground: tuple[int, int, int] = (250, 200, 0)) -> np.ndarray:
    codes = codes.copy()
    height = len(codes)
    cv2.rectangle(codes, (0, height - 18), (109, height - 1), ground, -1)
    cv2.putText(codes, "source: a book", (3, height - 5), 0, 0.38, (0, 0, 0), 1, cv2.LINE_AA)
    return codes


@pytest.mark.parametrize("quality", [None, 92])
@pytest.mark.parametrize("value", [0, 255])
def test_margins_of_all_sides(value: int, quality: int | None) -> None:
    framed = np.pad(GRAVEL, ((7, 11), (0, 30), (0, 0)), constant_values=value)
    mask = found(framed, quality)
    assert not mask[10:240, 4:296].any()
    assert mask[:7].all()
    assert mask[-11:].all()
    assert mask[:, -30:].all()


@pytest.mark.parametrize("quality", [None, 92])
@pytest.mark.parametrize("turns", range(4))
def test_labels_at_every_corner(turns: int, quality: int | None) -> None:
    mask = np.rot90(found(np.ascontiguousarray(np.rot90(labelled(GRAVEL), turns)), quality), -turns)
    assert mask[-18:, :110].all()
    assert mask.sum() < 1.3 * 18 * 110


def test_a_banner_with_writing() -> None:
    codes = GRAVEL.copy()
    codes[212:] = 0
    cv2.putText(codes, "www.example.org  12 mm", (40, 232), 0, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    mask = found(codes)
    assert mask[212:].all()
    assert not mask[:209].any()


def test_of_a_large_picture() -> None:
    large = cv2.resize(GRAVEL, None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
    cv2.rectangle(large, (1400, 1380), (1799, 1439), (255, 255, 255), -1)
    cv2.putText(large, "source: a book", (1420, 1420), 0, 1.2, (0, 0, 0), 3, cv2.LINE_AA)
    large = np.pad(large, ((0, 0), (3, 0), (0, 0)))
    mask = found(large)
    assert mask[:, :3].all()
    assert mask[1380:, 1403:].all()
    assert mask.mean() < 0.015


def tiled(ground: int) -> np.ndarray:
    """Tiles of gravel with joints of 10 px."""
    tiles = np.full((250, 250, 3), ground, np.uint8)
    for top in range(10, 250, 60):
        for left in range(10, 250, 60):
            tiles[top : top + 50, left : left + 50] = GRAVEL[:50, :50]
    return tiles


def test_a_frame_of_the_colour_of_thin_joints() -> None:
    mask = found(np.pad(tiled(255)[10:, 10:], ((30, 0), (0, 0), (0, 0)), constant_values=255))
    assert mask[:30].all()
    assert not mask[33:].any()


def test_what_belongs_to_a_texture_is_not() -> None:
    tiles = tiled(200)
    beams = np.repeat(GRAVEL[:, :, :1] // 2, 3, axis=2)
    beams[:40] = beams[100:130] = 255  # as broad as others, or nearly
    bricks = np.full((216, 216, 3), (100, 140, 200), np.uint8)
    for course in range(9):
        for left in range(-20 * (course % 2), 216, 40):
            bricks[24 * course + 3 : 24 * course + 24, max(0, left + 2) : left + 39] = GRAVEL[:1, 7 * course] // 2
    gradient = np.repeat(np.linspace(0, 255, 240).astype(np.uint8)[:, None, None], 300, axis=1).repeat(3, axis=2)
    for texture in (GRAVEL, tiles, bricks, beams, gradient, np.full((64, 64, 3), 90, np.uint8)):
        assert not found(texture).any()
    assert not found(labelled(tiles, (200, 200, 200))).any()  # of the joints' colour


def test_a_plain_corner_without_writing_is_not() -> None:
    codes = GRAVEL.copy()
    codes[:40, :60] = (180, 40, 40)
    assert not found(codes).any()


def test_tone_excludes_and_tells_them(caplog: pytest.LogCaptureFixture) -> None:
    image = Image.of(np.ascontiguousarray(labelled(GRAVEL)))
    with caplog.at_level(logging.WARNING):
        even = tone(image, ToneParams()).image
    assert "% of the exemplar are a plain margin or a label" in caplog.text
    valid = valid_pixels(even)
    assert valid is not None
    assert not valid[-18:, :110].any()
    caplog.clear()
    assert valid_pixels(tone(image, ToneParams(margins="use")).image) is None
    assert valid_pixels(tone(image.wrapping(True), ToneParams()).image) is None
    assert not caplog.text
