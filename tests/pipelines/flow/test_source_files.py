"""Pictures of the command line: single ones, sets, folders and materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.media.sources import open_source
from texloom.stages.vocabulary.declare import InputError

FILES = (
    "a.png", "b.jpg", "notes.txt", "[x].png",
    "deep/one/color.png", "deep/two/color.png", "deep/two/other.png",
    "moss/moss_albedo.png", "moss/moss_height.png",
    "library/oak/oak_albedo.png", "library/oak/oak_rough.png", "library/tin/tin_albedo.png",
    "colors/red_color.png", "colors/blue_color.png",
    "empty/readme.txt",
)  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in FILES:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix in (".png", ".jpg"):
            PIL.Image.fromarray(np.zeros((20, 20), np.uint8)).save(path)
        else:
            path.write_text("words")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def opened(*pictures: str, flow: str = "self_tuning", **overrides: Any) -> Any:
    return load_flow(find_flow(flow), Overrides(pictures=pictures, **overrides))


def names(*pictures: str, flow: str = "self_tuning") -> list[str]:
    return [item.name for item in items_of(opened(*pictures, flow=flow))]


@pytest.mark.parametrize(
    ("flow", "pictures", "expected"),
    [
        ("self_tuning", ["a.png", "b.jpg"], ["a", "b"]),
        ("self_tuning", ["."], ["[x]", "a", "b", "moss"]),
        ("self_tuning", ["?.png", "[x].png"], ["[x]", "a"]),
        ("self_tuning", ["deep/*/color.png"], ["one", "two"]),
        ("self_tuning", ["deep/one/color.png", "deep/two/color.png"], ["one", "two"]),
        (
            "self_tuning",
            ["deep/one/color.png", "deep/two/color.png", "deep/two/other.png"],
            ["one-color", "two-color", "two-other"],
        ),
        ("self_tuning", ["colors"], ["blue_color", "red_color"]),
        ("materials", ["library"], ["oak", "tin"]),
        ("materials", ["library/oak", "moss"], ["moss", "oak"]),
        ("materials", ["library/*"], ["oak", "tin"]),
    ],
)
def test_a_set(flow: str, pictures: list[str], expected: list[str]) -> None:
    assert names(*pictures, flow=flow) == expected


@pytest.mark.parametrize(
    ("flow", "source", "picture"),
    [
        ("self_tuning", "exemplar", "a.png"),
        ("self_tuning", "exemplar", "[x].png"),
        ("self_tuning", "exemplar", "moss"),
        ("self_tuning", "exemplar", "skimage:grass"),
        ("materials", "exemplar", "library/tin"),
        ("fill", "picture", "a.png"),
        ("inverse", "texture", "a.png"),
        ("photo_to_photo", "photo", "a.png"),
        ("texture_sequence", "exemplar", "a.png"),
    ],
)
def test_one_picture_or_material(folder: Path, flow: str, source: str, picture: str) -> None:
    expected = picture if ":" in picture else str(folder / picture)
    assert opened(picture, flow=flow).sources[source] == expected


@pytest.mark.parametrize("flow", ["self_tuning", "materials"])
def test_maps_without_albedo_are_one_material(folder: Path, flow: str) -> None:
    """Each by itself, they would not fit together any more; `open_source` refuses the folder."""
    (folder / "library" / "oak" / "oak_albedo.png").rename(folder / "library" / "oak" / "oak_tint.png")
    (folder / "library" / "oak" / "oak_nor.png").write_bytes((folder / "a.png").read_bytes())
    assert opened("library/oak", flow=flow).sources["exemplar"] == str(folder / "library" / "oak")


def test_a_set_with_a_partner() -> None:
    flow = opened("deep/*/color.png", flow="inverse_set", sources={"control": "deep/*/color.png"})
    assert [sorted(item.sources) for item in items_of(flow)] == [["control", "texture"]] * 2


@pytest.mark.parametrize(
    ("pictures", "sources", "message"),
    [
        (["a.png"], {"exemplar": "b.jpg"}, "--source exemplar: a.png is given as 'exemplar' too; give one of them"),
        (["empty"], {}, "empty: is a folder without pictures"),
        ([], {"exemplar": "empty"}, "empty: is a folder without pictures"),
    ],
)
def test_wrong_pictures(pictures: list[str], sources: dict[str, str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        opened(*pictures, sources=sources)
    assert message in str(caught.value)


def test_a_flow_without_sources(folder: Path) -> None:
    (folder / "flow.yaml").write_text("steps: {s: {stage: evaluation.tabulate}}")
    with pytest.raises(InputError, match=r"sources: the flow takes no picture, got 'a\.png'"):
        opened("a.png", flow="flow.yaml")


def test_tiles_of_a_folder_are_one_item(folder: Path) -> None:
    for number in (1001, 1002):
        PIL.Image.new("L", (8, 8)).save(folder / f"wood.{number}.png")
    assert names(".") == ["[x]", "a", "b", "moss", "wood"]
    assert names("wood.<UDIM>.png", "a.png") == ["a", "wood"]


def test_pictures_that_are_not_read_are_told(folder: Path) -> None:
    (folder / "c.jxl").write_bytes(b"c")
    (folder / "D.XCF").write_bytes(b"d")
    (source,) = opened(".").sources.values()
    assert source.notes == (
        f"sources.exemplar: {folder}: 2 files are not read: D.XCF, c.jxl; save them as PNG, TIFF or EXR",
        f"sources.exemplar: {folder}: 1 file beside the others ignored: notes.txt",
    )
    (folder / "empty" / "e.jxl").write_bytes(b"e")
    with pytest.raises(InputError, match=r"is a folder without pictures; 1 file is not read: e\.jxl"):
        opened("empty")


def test_what_lies_beside_pictures_that_a_pattern_matches_is_counted(folder: Path) -> None:
    assert names("*") == ["[x]", "a", "b", "colors", "moss"]
    (source,) = opened("*").sources.values()
    assert source.notes == (f"sources.exemplar: {folder}/*: 1 file beside the others ignored: notes.txt",)
    (folder / "library" / "Thumbs.db").write_text("words")
    assert names("library/*", flow="materials") == ["oak", "tin"]
    for name in ("a.obj", "b.txt"):  # of a kind that the flow may know
        (folder / "empty" / name).write_text("words")
    assert names("empty/*") == ["a", "b", "readme"]


def test_a_material_in_doubt_is_not_referred_to_a_pattern_that_is_refused(folder: Path) -> None:
    for name in ("x_c", "x_n", "x_s", "x_a"):
        place = folder / "doubt" / f"{name}.png"
        place.parent.mkdir(exist_ok=True)
        level = np.arange(400, dtype=np.uint8).reshape(20, 20)
        PIL.Image.fromarray(np.dstack([level, level, 255 - level]) if name in ("x_c", "x_n") else level).save(place)
    with pytest.raises(InputError, match=r"doubt: x_a.png \(opacity or ao\); if these are one .* x_a.png}$"):
        open_source("exemplar", "doubt")
    with pytest.raises(InputError, match=r"maps of one material; give their folder"):
        opened("doubt/*.png", flow="materials")


@pytest.mark.parametrize("given", [["moss/*.png"], ["moss/*"], ["moss/moss_albedo.png", "moss/moss_height.png"]])
def test_maps_of_one_material_are_never_taken_for_several_unsaid(folder: Path, given: list[str]) -> None:
    (folder / "moss" / "material.mtlx").write_text("words")
    with pytest.raises(InputError, match=r"maps of one material; give their folder, .*moss"):
        opened(*given, flow="materials")
    *_, told = opened(*given).sources["exemplar"].notes
    assert "moss, keeps them in register" in told
