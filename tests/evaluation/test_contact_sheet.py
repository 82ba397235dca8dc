"""Small pictures and the sheet of them."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.evaluation.contact_sheet import ContactSheetParams, contact_sheet
from texloom.stages.evaluation.thumbnail import ThumbnailParams, thumbnail
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def plain(value: float, height: int = 20, width: int = 30) -> Image:
    return Image(np.full((height, width, 3), value, np.float32), ("R", "G", "B"))


def items(count: int) -> list[dict[str, object]]:
    return [{"name": str(index), "seed": index} for index in range(count)]


def test_a_small_picture_has_the_mean_of_the_large_one(rng: np.random.Generator) -> None:
    image = Image(rng.random((64, 48, 4), np.float32), ("R", "G", "B", "height"))
    small = thumbnail(image, ThumbnailParams(side=32)).image
    assert small.pixels.shape == (32, 24, 3)
    blocks = image.pixels[..., :3].reshape(32, 2, 24, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small.pixels, blocks, atol=1e-6)
    large = thumbnail(image, ThumbnailParams(side=32, enlarge=True)).image
    assert large.pixels.shape == (64, 48, 3)
    np.testing.assert_allclose(large.pixels[1:-1:2, 1:-1:2].mean(), small.pixels.mean(), atol=0.01)
    grey = Image(rng.random((10, 12, 1), np.float32), ("Y",))
    same = thumbnail(grey, ThumbnailParams()).image
    np.testing.assert_array_equal(same.pixels, grey.color)


def test_pictures_stand_in_the_order_of_the_items() -> None:
    images = [plain(0.1), plain(0.2, 16, 24), None, plain(0.4), plain(0.5)]
    sheet = contact_sheet(images, items(5), ContactSheetParams(columns=3)).image
    assert sheet.pixels.shape == (2 * (20 + 18 + 8) + 8, 3 * (30 + 8) + 8, 3)
    assert np.ptp(sheet.pixels[8:28, 8:38]) == 0
    assert sheet.pixels[8, 8, 0] == np.float32(0.1)
    assert (sheet.pixels[8:24, 46:70] == np.float32(0.2)).all()
    assert (sheet.pixels[8:28, 84:114] == sheet.pixels[0, 0]).all()
    assert (sheet.pixels[54:74, 46:76] == np.float32(0.5)).all()
    labels = [sheet.pixels[28:46, left : left + 30] for left in (8, 46)]
    assert all(label.max() > 0.3 for label in labels)
    assert not np.array_equal(*labels)


def test_the_sheet_is_about_square() -> None:
    sheet = contact_sheet([plain(0.3)] * 8, items(8), ContactSheetParams()).image
    assert 0.5 < sheet.height / sheet.width < 2
    with pytest.raises(InputError, match="1 pictures for 2 items"):
        contact_sheet([plain(0)], items(2), ContactSheetParams())


def test_a_sheet_holds_what_fits(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr("texloom.stages.evaluation.contact_sheet._MOST_PIXELS", 6 * (20 + 18 + 8) * (30 + 8))
    sheet = contact_sheet([plain(0.3)] * 8, items(8), ContactSheetParams(columns=1000)).image
    assert sheet.pixels.shape == (20 + 18 + 2 * 8, 6 * (30 + 8) + 8, 3)
    assert "the first 6 of 8 pictures are on the sheet, as all would be too large" in caplog.messages
