"""UDIM tiles as one picture."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from tests.pipelines.media.test_sources import problem, read
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.udim import joined
from texloom.pipelines.media.writers.layouts import tiles_of
from texloom.pipelines.media.writers.same import write_same
from texloom.stages.vocabulary.arrays import Image


def tile(folder: Path, number: int, level: int, size: tuple[int, int] = (6, 4), name: str = "wood.{}.png") -> Path:
    PIL.Image.new("L", size, level).save(path := folder / name.format(number))
    return path


def test_tiles_are_one_picture(tmp_path: Path) -> None:
    for number, level in ((1001, 0), (1002, 50), (1011, 100), (1012, 150)):
        tile(tmp_path, number, level)
    tile(tmp_path, 1001, 7, name="other.{}.png")
    source = open_source("exemplar", f"{tmp_path}/wood.<UDIM>.png")
    assert (source.height, source.width, source.picture) == (8, 12, "wood")
    pixels = read(tmp_path / "wood.<udim>.png").pixels[..., 0]
    corners = [round(float(pixels[y, x]), 3) for y, x in ((-1, 0), (-1, -1), (0, 0), (0, -1))]
    assert corners == [0.0, 0.032, 0.127, 0.305]
    tile(tmp_path, 1002, 51)
    assert open_source("exemplar", source.reference).digest != source.digest
    with pytest.raises(Exception, match="has changed since the run began"):
        source.read()


def test_what_is_written_is_read(tmp_path: Path, rng: np.random.Generator) -> None:
    image = Image(rng.random((12, 18, 3), np.float32), ("R", "G", "B"))
    for number, area in tiles_of(image, (2, 3), tmp_path):
        PIL.Image.fromarray(Image(image.pixels[area], image.channels).srgb).save(tmp_path / f"wood.{number}.png")
    np.testing.assert_allclose(read(tmp_path / "wood.<UDIM>.png").pixels, image.pixels, atol=0.01)


def test_refusals(tmp_path: Path) -> None:
    name = tmp_path / "wood.<UDIM>.png"
    assert problem(name) == "there are no tiles, such as wood.1001.png"
    tile(tmp_path, 1001, 0)
    tile(tmp_path, 1012, 0)
    assert problem(name) == (
        "tiles are missing: 1002, 1011; they have to fill 2 x 2 from 1001; move those beyond the gap away, or list "
        "one tile of each map in a YAML file, as wood.1001.png"
    )
    (tmp_path / "wood.1012.png").unlink()
    tile(tmp_path, 1002, 0, (8, 8))
    assert problem(name) == "wood.1002.png has another size, channels or bits than wood.1001.png"
    (tmp_path / "wood.1002.png").write_bytes(b"words")
    assert problem(name).startswith("wood.1002.png is not a picture that can be read")


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("a.png wood.1001.png wood.1002.png", "a.png wood.<UDIM>.png"),
        ("wood_color_1001.png wood_color_1002.png", "wood_color_<UDIM>.png"),
        ("wood_1001.png wood_1011.png", "wood_<UDIM>.png"),
        ("IMG_1001.jpg IMG_1002.jpg IMG_1003.jpg", "IMG_1001.jpg IMG_1002.jpg IMG_1003.jpg"),
        ("wood.1001.png", "wood.1001.png"),
        ("wood.1002.png wood.1003.png", "wood.1002.png wood.1003.png"),
        ("wood.1001.png wood.1001.jpg", "wood.1001.png wood.1001.jpg"),
    ],
)
def test_which_files_are_tiles(names: str, expected: str) -> None:
    found = joined(map(Path, names.split()), lambda stem: stem.endswith("_color"))
    assert [str(path) for path in found] == expected.split()


def test_tiles_named_by_their_place_are_read_and_written_back(tmp_path: Path) -> None:
    folder = tmp_path / "wood"
    folder.mkdir()
    for u, v, level in ((1, 1, 10), (2, 1, 60), (1, 2, 110), (2, 2, 160)):
        tile(folder, 0, level, name=f"wood_BC_u{u}_v{v}.png")
    source = open_source("exemplar", str(folder))
    levels = np.rint(source.read().srgb[..., 0]).astype(int)
    assert [levels[y, x] for y, x in ((-1, 0), (-1, -1), (0, 0), (0, -1))] == [10, 60, 110, 160]
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    for path in folder.iterdir():
        np.testing.assert_array_equal(
            *(np.asarray(PIL.Image.open(one / path.name)) for one in (folder, tmp_path / "out"))
        )
