"""Layers of EXR files, and their tiles."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from tests.studio.conftest import Served, exemplar
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.store import exr
from texloom.pipelines.store.preview import picture
from texloom.pipelines.studio import layer_tiles
from texloom.pipelines.studio.endless import Endless
from texloom.pipelines.studio.layer_tiles import Tiler
from texloom.pipelines.studio.layers import layers_of
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.picture_levels import SIDE
from texloom.pipelines.studio.recipe_flows import image_of, open_texture
from texloom.pipelines.studio.work import EndlessWork, Places, TileWork
from texloom.stages.vocabulary.declare import InputError

SHAPE = (1100, 1300)


@pytest.fixture(params=[False, True], ids=["lines", "tiles"])
def file(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Colour, a scalar and positions, in lines or in tiles."""
    if request.param:
        monkeypatch.setattr(exr, "TILED", 2**18)
    rng = np.random.default_rng(2)
    rows, columns = np.indices(SHAPE, np.uint32)
    parts = {
        "image": {name: rng.random(SHAPE).astype(np.float16) for name in "RGBA"},
        "height": {"height": 5 * columns.astype(np.float32) - 100},
        "match": {"match.row": rows, "match.column": columns},
    }
    exr.write(tmp_path / "result.exr", parts, {}, "ZIP")
    return tmp_path / "result.exr"


def tile_of(tiler: Tiler, file: Path, layer: int, level: int, row: int, column: int) -> np.ndarray:
    sent: list[bytes] = []
    work = TileWork(key="key", file=str(file), layer=layer, level=level, row=row, column=column)
    tiler.send(work, lambda _, payload: sent.append(payload))
    return np.asarray(PIL.Image.open(io.BytesIO(sent[0])))


@pytest.fixture
def tiler(tmp_path: Path) -> Tiler:
    return Tiler(Places(folder=str(tmp_path), store=str(tmp_path), scratch=str(tmp_path / "scratch")))


def test_tiles_of_full_size_are_parts_of_the_picture(file: Path, tiler: Tiler) -> None:
    _, parts = exr.load(file)
    for layer, one in enumerate(layers_of(file)):
        whole = picture({name.rpartition(".")[2]: parts[one.part][name] for name in one.channels})
        assert whole is not None
        for row, column in ((0, 0), (1, 1), (2, 2)):
            window = whole[SIDE * row : SIDE * (row + 1), SIDE * column : SIDE * (column + 1)]
            np.testing.assert_array_equal(tile_of(tiler, file, layer, 0, row, column), window)


def test_coarser_levels_are_smaller_versions(file: Path, tiler: Tiler) -> None:
    made = tile_of(tiler, file, 1, 2, 0, 0)
    assert made.shape == (275, 325)
    np.testing.assert_allclose(made[100], np.linspace(0, 255, 325), atol=2)
    assert tile_of(tiler, file, 0, 1, 1, 1).shape == (550 - SIDE, 650 - SIDE, 4)


@pytest.mark.parametrize("place", [(0, 3, 0), (0, 0, 3), (3, 0, 0), (1, 2, 0)])
def test_tiles_that_are_not_there_are_refused(file: Path, tiler: Tiler, place: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="no such tile"):
        tile_of(tiler, file, 0, *place)


def test_full_size_is_decoded_only_in_view(file: Path, tiler: Tiler, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []
    original = exr.Windows.read

    def counted(self: exr.Windows, part: str, rows: slice, columns: slice) -> exr.Planes:
        planes = original(self, part, rows, columns)
        read.append(next(iter(planes.values())).size)
        return planes

    monkeypatch.setattr(exr.Windows, "read", counted)
    tile_of(tiler, file, 0, 0, 0, 0)
    is_tiled = len(exr.Windows(file).bands("image")) > 1
    assert sum(read) == (SIDE**2 if is_tiled else SHAPE[0] * SHAPE[1])


def test_files_of_levels_are_bounded(file: Path, tiler: Tiler, monkeypatch: pytest.MonkeyPatch) -> None:
    tile_of(tiler, file, 0, 2, 0, 0)
    monkeypatch.setattr(layer_tiles, "_MOST_BYTES", 0)
    tile_of(tiler, file, 1, 2, 0, 0)
    assert not list(tiler.folder.glob("key_0_*"))
    assert tile_of(tiler, file, 0, 2, 0, 0).shape == (275, 325, 4)  # what is open goes on


def test_broken_files_are_refused(tmp_path: Path, tiler: Tiler) -> None:
    (tmp_path / "broken.exr").write_bytes(b"\x76\x2f\x31\x01nothing")
    with pytest.raises(InputError, match=r"broken\.exr"):
        layers_of(tmp_path / "broken.exr")


def test_tiles_need_a_file_that_was_opened(served: Served) -> None:
    assert served.request("/api/tiles/0123/0/0/0/0")[0] == 404
    assert served.request("/api/tiles/0123/0/0/0/0", cookie="")[0] == 401


@pytest.fixture(scope="module")
def endless(tmp_path_factory: pytest.TempPathFactory) -> tuple[Endless, Recipe]:
    folder = tmp_path_factory.mktemp("endless")
    PIL.Image.fromarray(exemplar()).save(folder / "blotches.png")
    places = Places(folder=str(folder), store=str(folder / "store"), scratch=str(folder / "scratch"))
    return Endless(places), Recipe(flow="per_pixel", sources={"exemplar": "folder:blotches.png"}, seed=5)


def sent_by(endless: Endless, work: EndlessWork) -> np.ndarray:
    sent: list[bytes] = []
    endless.send(work, lambda: None, lambda _, payload: sent.append(payload))
    return np.asarray(PIL.Image.open(io.BytesIO(sent[0])))


def test_endless_tiles_are_windows_of_the_flow(endless: tuple[Endless, Recipe]) -> None:
    made, recipe = endless
    for level, row, column in ((0, 1, -3), (1, -1, 0)):
        shown = sent_by(made, EndlessWork(recipe=recipe, level=level, row=row, column=column))
        side = SIDE << level
        window = {"size": (side, side), "params": {"texture.origin": (row * side, column * side)}}
        run, texture = open_texture(recipe.model_copy(update=window), made.library, made.store)
        execute(run, lambda _: None, made.store.root / "runs")
        whole = image_of(run, texture).srgb
        wanted = cv2.resize(whole, (SIDE, SIDE), interpolation=cv2.INTER_AREA) if level else whole
        np.testing.assert_array_equal(shown, wanted)


def test_endless_tiles_can_be_cancelled_and_need_a_texture_that_goes_on(endless: tuple[Endless, Recipe]) -> None:
    class NotWantedError(Exception):
        pass

    def stop() -> None:
        raise NotWantedError

    made, recipe = endless
    with pytest.raises(NotWantedError):
        made.send(EndlessWork(recipe=recipe, level=2, row=40, column=40), stop, lambda *_: None)
    for other in ({"tileable": "x"}, {"flow": "quilting"}):
        work = EndlessWork(recipe=recipe.model_copy(update=other), level=0, row=0, column=0)
        with pytest.raises(InputError, match="go on without end"):
            made.send(work, lambda: None, lambda *_: None)
