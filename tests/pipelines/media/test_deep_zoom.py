"""Pyramids of tiles."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import PIL.Image
import pytest

import texloom
from texloom.pipelines.media import deep_zoom
from texloom.pipelines.media.writers.registry import WriteJob, write
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_codes


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deep_zoom, "TILE", 16)


def put_together(folder: Path) -> np.ndarray:
    """The picture of a level."""
    tiles = {tuple(map(int, path.stem.split("_"))): np.asarray(PIL.Image.open(path)) for path in folder.iterdir()}
    columns, rows = (max(place[axis] for place in tiles) + 1 for axis in (0, 1))
    return np.vstack([np.hstack([tiles[column, row] for column in range(columns)]) for row in range(rows)])


def test_levels_halve_the_picture(tmp_path: Path) -> None:
    image = Image(np.random.default_rng(0).random((37, 50, 4), np.float32), ("R", "G", "B", "height"))
    digests = write(WriteJob(tmp_path / "a.dzi", image, Image, {}))
    assert digests.pop("") == file_digest(tmp_path / "a.dzi")
    assert all(file_digest(tmp_path / name) == digest for name, digest in digests.items())
    size = next(iter(ElementTree.parse(tmp_path / "a.dzi").getroot()))
    assert size.attrib == {"Height": "37", "Width": "50"}
    levels = {int(folder.name): put_together(folder) for folder in (tmp_path / "a_files").iterdir()}
    assert {level: shown.shape[:2] for level, shown in levels.items()} == {
        6: (37, 50), 5: (19, 25), 4: (10, 13), 3: (5, 7), 2: (3, 4), 1: (2, 2), 0: (1, 1),
    }  # fmt: skip
    np.testing.assert_array_equal(levels[6], srgb_codes(image.color))
    means = image.color[:36, :48].reshape(18, 2, 24, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(levels[5][:18, :24].astype(int), srgb_codes(means).astype(int), atol=1)


def test_an_endless_texture_is_made_window_by_window(tmp_path: Path) -> None:
    exemplar = np.random.default_rng(1).random((32, 32, 3)).astype(np.float32)
    stack = texloom.stages.appearance_stack(exemplar)
    given = (exemplar, stack.appearance, stack.basis, stack.candidates, stack.toroidal)
    whole = texloom.stages.per_pixel(*given, size=(48, 40), origin=(-7, 1000), seed=5).image

    def read(rows: slice, columns: slice) -> np.ndarray:
        size = (rows.stop - rows.start, columns.stop - columns.start)
        origin = (rows.start - 7, columns.start + 1000)
        return texloom.stages.per_pixel(*given, size=(16, 16), origin=origin, seed=5).image.color[
            : size[0], : size[1]
        ]

    texloom.write_deep_zoom(tmp_path / "endless.dzi", 48, 40, read)
    np.testing.assert_array_equal(put_together(tmp_path / "endless_files/6"), srgb_codes(whole.color))
