"""The flow that gives new maps of a material in register with an earlier result."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.pipelines.media.test_material_export import saved
from tests.pipelines.media.test_material_set import save
from tests.synthetic import blobs, tiles
from texloom.pipelines.engine.run import Run
from texloom.pipelines.media.locate import decode, inspect
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError

SIDE = 64
QUICK = {"preset": "fast", "size": "80x72", "tileable": "true"}


@pytest.fixture
def before(tmp_path: Path, rng: np.random.Generator) -> Path:
    colors = np.rint(blobs((SIDE, SIDE, 3), rng) * 255).astype(np.uint8)
    folder = tmp_path / "before"
    folder.mkdir()
    save(folder / "stones_albedo.png", colors)
    save(folder / "stones_height.png", colors.mean(axis=2).astype(np.uint16) * 256)
    return folder


@pytest.fixture
def after(before: Path, tmp_path: Path) -> Path:
    """The same with a roughness, which is the height once more."""
    folder = Path(shutil.copytree(before, tmp_path / "after"))
    shutil.copy(folder / "stones_height.png", folder / "stones_roughness.png")
    return folder


def slopes(values: np.ndarray) -> np.ndarray:
    return np.concatenate([np.diff(values.astype(float), axis=axis).ravel() for axis in (0, 1)])


def test_a_map_that_comes_later_is_in_register(
    ran: Callable[..., dict[str, Any]], before: Path, after: Path, tmp_path: Path
) -> None:
    first = ran(tmp_path / "first", "materials", {"exemplar": before}, **QUICK)
    sources = {"result": first["texture.exr"], "material": after}
    again = ran(tmp_path / "again", "reapply", sources)
    np.testing.assert_array_equal(again["texture.png"], first["texture.png"])
    names = sorted(path.name for path in again["maps/"].glob("*.png"))
    assert names == ["stones_albedo.png", "stones_height.png", "stones_roughness.png"]
    for name in names[:2]:
        np.testing.assert_array_equal(saved_at(again, name), saved_at(first, name))
    height, rough = (slopes(saved_at(again, name)) for name in names[1:])
    assert np.corrcoef(height, rough)[0, 1] > 0.95  # heights have no steps at seams
    of_maps = ran(tmp_path / "maps", "reapply", {**sources, "result": first["maps/"] / "material.exr"})
    np.testing.assert_array_equal(of_maps["texture.png"], first["texture.png"])


@pytest.fixture
def walls(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Tiles of which 3.6 fit a result of 72 px, and their heights."""
    colors = tiles(rng)
    folder = tmp_path / "walls"
    folder.mkdir()
    save(folder / "walls_albedo.png", colors)
    save(folder / "walls_height.png", colors[..., 0].astype(np.uint16) * 256)
    return folder


def test_whole_cells_fit_and_later_maps_are_scaled_alike(
    ran: Callable[..., dict[str, Any]], walls: Path, tmp_path: Path
) -> None:
    options = {**QUICK, "size": "72x72"}
    first = ran(tmp_path / "fitted", "materials", {"exemplar": walls}, **options)
    path = str(first["exemplar.exr"])
    made = decode(path, inspect(path).digest)
    assert (made.height, made.width) == (108, 108)  # four cells of 18 px
    means = [first["texture.png"].mean(axis=(axis, 2)) for axis in (0, 1)]
    for dark in (np.flatnonzero(mean < mean.mean() - 20) for mean in means):
        assert len(dark) in (8, 9, 10, 11, 12)
        assert set(np.diff(dark)) <= {1, *range(14, 18)}  # four joints, evenly apart
    again = ran(tmp_path / "again", "reapply", {"result": first["texture.exr"], "material": walls})
    np.testing.assert_array_equal(again["texture.png"], first["texture.png"])
    np.testing.assert_array_equal(saved_at(again, "walls_height.png"), saved_at(first, "walls_height.png"))
    cut = ran(tmp_path / "cut", "materials", {"exemplar": walls}, **options, **{"scaled.fit": "false"})
    assert "exemplar.exr" not in cut


def saved_at(exports: dict[str, Any], name: str) -> np.ndarray:
    return saved(exports["maps/"] / name)


def test_what_has_no_correspondence_is_refused(
    ran: Callable[..., dict[str, Any]],
    opened: Callable[..., Run],
    store: Store,
    before: Path,
    tmp_path: Path,
) -> None:
    made = ran(tmp_path / "made", "self_tuning", {"exemplar": before}, **{**QUICK, "size": "84x72"})
    result = made["texture.exr"]

    def problem_with(result: Path) -> str:
        with pytest.raises(InputError) as raised:
            opened("reapply", {"result": result, "material": before})
        return str(raised.value)

    assert "no such file" in problem_with(tmp_path / "none.exr")
    assert "is not an EXR that a run of texloom has written" in problem_with(before / "stones_albedo.png")
    edit = ran(tmp_path / "edit", "make_tileable", {"picture": before / "stones_albedo.png"}, width="10")
    assert "keeps pixels of a picture, as edits do" in problem_with(edit["texture.exr"])
    stitched = ran(tmp_path / "stitched", "quilting", {"exemplar": before / "stones_albedo.png"}, size="80x72")
    assert "was made by synthesis.quilting, of which no correspondence" in problem_with(stitched["texture.exr"])
    for folder in (store.root / "cache" / "synthesis.optimise").iterdir():
        store.remove("synthesis.optimise", folder.name)
    gone = problem_with(result)
    assert f"its correspondence is no longer in the store {store.root}" in gone
    assert f"make it again: texloom run self_tuning {before} --seed 7 --size 84x72 --tileable" in gone
