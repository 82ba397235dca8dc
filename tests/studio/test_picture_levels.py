"""Large pictures, as a screen shows them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.studio import decoding, picture_levels
from texloom.pipelines.studio.layer_tiles import Tiler
from texloom.pipelines.studio.layers import layers
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.picture_levels import LARGE, SIDE, halved, levels_of, shown, small_image
from texloom.pipelines.studio.work import LayersRead, LayersWork, PictureWork, Places, TileWork
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (701, LARGE + 1)


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(4).integers(0, 256, (*SHAPE, 3), np.uint8)


@pytest.fixture
def picture(tmp_path: Path, pixels: np.ndarray) -> Source:
    PIL.Image.fromarray(pixels).save(tmp_path / "large.png")
    return open_source("picture", str(tmp_path / "large.png"))


def test_levels_are_halves_in_linear_light(picture: Source, pixels: np.ndarray, places: Places) -> None:
    levels = levels_of(picture, places)
    assert [one.shape[:2] for one in levels] == [SHAPE, (351, 1025), (176, 513), (88, 257)]
    assert (levels[0] == pixels).all()
    light = Image.of(pixels[:700, :2048]).pixels
    mean = (light[::2, ::2] + light[1::2, ::2] + light[::2, 1::2] + light[1::2, 1::2]) / 4
    expected = Image(mean, ("R", "G", "B")).srgb.astype(int)
    assert np.abs(levels[1][:350, :1024].astype(int) - expected).max() <= 1


def test_halving_keeps_a_plain_picture() -> None:
    for code in range(256):
        assert (halved(np.full((3, 5, 3), code, np.uint8)) == code).all()


def test_a_picture_is_decoded_once(picture: Source, places: Places, monkeypatch: pytest.MonkeyPatch) -> None:
    levels_of(picture, places)
    monkeypatch.setattr(Source, "colour", None)
    assert shown(picture, 300, places).shape == (103, 300, 3)
    assert small_image(picture, (100, 300), places).shape == (176, 513, 3)


def test_a_list_of_pictures_makes_no_levels(picture: Source, places: Places) -> None:
    assert shown(picture, 128, places).shape == (44, 128, 3)
    assert not Path(places.scratch, "pictures").exists()


@pytest.mark.parametrize("kind", ["png", "jpg", "grey", "alpha", "deep", "palette", "turned"])
def test_the_colour_of_a_picture_is_that_of_its_pixels(kind: str, tmp_path: Path, pixels: np.ndarray) -> None:
    image = PIL.Image.fromarray(pixels[:40, :50])
    options: dict[str, Any] = {}
    if kind == "grey":
        image = image.convert("L")
    elif kind == "alpha":
        image = image.convert("RGBA")
    elif kind == "deep":
        image = PIL.Image.fromarray(pixels[:40, :50, 0].astype(np.uint16) * 200)
    elif kind == "palette":
        image = image.convert("P")
    elif kind == "turned":
        options["exif"] = image.getexif()
        options["exif"][0x0112] = 6
    file = tmp_path / f"one.{'jpg' if kind in ('jpg', 'turned') else 'png'}"
    image.save(file, **options)
    source = open_source("picture", str(file))
    assert (source.colour() == source.read().srgb).all()


def test_tiles_are_parts_of_a_level(picture: Source, pixels: np.ndarray, places: Places) -> None:
    tiler, sent = Tiler(places), []

    def tile(level: int, row: int, column: int) -> np.ndarray:
        work = TileWork(key="key", file=picture.reference, layer=0, level=level, row=row, column=column)
        tiler.send(work, lambda _, payload: sent.append(payload))
        return np.asarray(PIL.Image.open(io.BytesIO(sent[-1])))

    assert (tile(0, 1, 2) == pixels[SIDE : 2 * SIDE, 2 * SIDE : 3 * SIDE]).all()
    assert tile(0, 0, 4).shape == (SIDE, 1, 3)
    assert tile(3, 0, 0).shape == (88, 257, 3)
    for level, row, column in ((4, 0, 0), (0, 2, 0), (3, 0, 1)):
        with pytest.raises(InputError, match="no such tile"):
            tile(level, row, column)


def test_the_page_is_told_how_large_a_picture_is(picture: Source) -> None:
    told: list[Message] = []
    layers(LayersWork(file=picture.reference), told.append)
    ((layer,),) = [one.layers.layers for one in told if isinstance(one, LayersRead)]
    assert (layer.name, layer.height, layer.width) == ("large", *SHAPE)


def test_a_large_picture_is_sent_smaller(picture: Source, places: Places) -> None:
    sent: list[bytes] = []
    wanted = PictureWork(picture="folder:large.png", side=1024)
    decoding.encode(wanted, places, lambda _, payload: sent.append(payload))
    assert PIL.Image.open(io.BytesIO(sent[0])).size == (1024, 350)


def test_the_pictures_looked_at_longest_ago_are_removed(
    picture: Source, places: Places, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = levels_of(picture, places)
    monkeypatch.setattr(picture_levels, "_MOST_BYTES", 0)
    PIL.Image.new("RGB", SHAPE[::-1]).save(tmp_path / "other.png")
    levels_of(open_source("picture", str(tmp_path / "other.png")), places)
    assert not Path(places.scratch, "pictures", picture.digest).exists()
    assert kept[0].shape == (*SHAPE, 3)  # open files keep their content


def test_a_broken_picture_leaves_nothing(picture: Source, places: Places) -> None:
    content = Path(picture.reference).read_bytes()
    Path(picture.reference).write_bytes(content[: len(content) // 2])
    broken = open_source("picture", picture.reference)
    with pytest.raises(InputError, match="truncated or broken"):
        levels_of(broken, places)
    assert [path.suffix for path in Path(places.scratch, "pictures").iterdir()] == [".lock"]
