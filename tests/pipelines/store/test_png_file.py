"""PNG pictures, whole and written strip by strip."""

from __future__ import annotations

import io
import json
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.media import material_export
from texloom.pipelines.store import codec, outputs, png_file
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.vocabulary.arrays import Image


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_strips_are_read_back(channels: int, dtype: type, tmp_path: Path) -> None:
    levels = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (23, 17, channels), dtype, endpoint=True)
    path = tmp_path / "a.png"
    digest = png_file.write_png(path, 23, 17, (levels[top : top + 7] for top in range(0, 23, 7)), {"seed": 3})
    assert digest == file_digest(path)
    with PIL.Image.open(path) as picture:
        assert json.loads(picture.text["texloom.provenance"]) == {"seed": 3}
        if dtype == np.uint8:
            np.testing.assert_array_equal(np.asarray(picture).reshape(levels.shape), levels)
    if channels in (3, 4):
        order = [2, 1, 0, 3][: max(3, channels)]
        np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., order[:channels]], levels)


@pytest.mark.parametrize("shape", [(23, 17), (23, 17, 1), (23, 17, 2), (23, 17, 3), (1, 1, 4)])
@pytest.mark.parametrize("strip", [2**20, 40])
def test_a_picture_is_read_back(shape: tuple[int, ...], strip: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(png_file, "_STRIP", strip)
    levels = np.random.default_rng(1).integers(0, 255, (*shape, 2), np.uint8, endpoint=True)
    levels = levels[..., 0]  # not contiguous
    with PIL.Image.open(io.BytesIO(png_file.png(levels, {"name": "Fläche"}))) as picture:
        assert json.loads(picture.text["texloom.provenance"]) == {"name": "Fläche"}
        np.testing.assert_array_equal(np.asarray(picture).reshape(shape), levels)


def test_smooth_pictures_are_small() -> None:
    """A ramp in either direction is a run of equal differences, or of equal values."""
    ramp = np.broadcast_to(np.arange(256, dtype=np.uint8)[:, None], (256, 256))
    assert len(png_file.png(ramp)) < 3000
    assert len(png_file.png(np.ascontiguousarray(ramp.T))) < 3000


def test_large_exports_are_the_same_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    names = ("R", "G", "B", "height", "normal.X", "normal.Y", "normal.Z")
    image = Image(rng.random((40, 30, 7), np.float32), names)
    written = {}
    for name, large in (("small", 2**24), ("large", 100)):
        for module in (png_file, outputs, material_export):
            monkeypatch.setattr(module, "LARGE", large)
        folder = tmp_path / name
        folder.mkdir()
        codec.export(image, Image, folder / "texture.png", {})
        material_export.write_maps(image, folder / "maps", [], {})
        written[name] = {path.name: cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in folder.rglob("*.png")}
        assert (folder / "maps/material.exr").is_file()
    assert set(written["small"]) == {"texture.png", "albedo.png", "height.png", "normal.png"}
    for name, levels in written["small"].items():
        np.testing.assert_array_equal(written["large"][name], levels, strict=True)
