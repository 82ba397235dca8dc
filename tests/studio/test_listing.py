"""Which pictures of a folder are listed, and what is not shown is counted."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.media.sources import Source
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.listing import chosen, folders_of, scan


def picture(path: Path, side: int = 4) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(np.full((side, side, 3), 99, np.uint8)).save(path)


def library(root: Path) -> Library:
    return Library(root / "project", root / "store")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    project = tmp_path / "project"
    for name in ("a.png", "wood/oak.png", "wood/pine/knot.png", "wood/pine/end.png", ".hidden/x.png"):
        picture(project / name)
    for role in ("albedo", "normal", "height"):
        picture(project / "stone" / "moss" / f"moss_{role}.png")
    picture(project / "texloom_project" / "thumbnails" / "x.png")
    return project


def test_pictures_of_all_subfolders_and_materials_are_listed(folder: Path) -> None:
    page = library(folder.parent).pictures()
    assert [one.id for one in page.pictures] == [
        "folder:a.png", "folder:stone/moss", "folder:wood/oak.png", "folder:wood/pine/end.png",
        "folder:wood/pine/knot.png",
    ]  # fmt: skip
    assert [one.is_material for one in page.pictures] == [False, True, False, False, False]
    assert (page.found, page.total, page.notes) == (5, 5, ())
    assert page.folders == {"stone": 1, "wood": 3, "wood/pine": 2}


def test_a_picture_of_a_camera_is_a_photograph(tmp_path: Path) -> None:
    made = PIL.Image.new("RGB", (64, 64), "grey")
    camera = PIL.Image.Exif()
    camera[0x010F] = "a camera"
    (tmp_path / "project").mkdir()
    (tmp_path / "received").mkdir()
    (tmp_path / "store" / "sources").mkdir(parents=True)
    made.save(tmp_path / "received" / "photo.jpg", exif=camera)
    made.save(tmp_path / "project" / "drawn.jpg")
    own = library(tmp_path)
    assert own.keep(tmp_path / "received", "", Source.read).is_photograph
    assert [(one.name, one.is_photograph) for one in own.pictures().pictures] == [("drawn", False), ("photo", True)]


def test_search_folder_and_order(folder: Path) -> None:
    for number, path in enumerate(("wood/oak.png", "a.png")):
        os.utime(folder / path, (2e9 + number, 2e9 + number))
    one = library(folder.parent)
    assert [each.name for each in one.pictures(search="PINE end").pictures] == ["end"]
    assert one.pictures(folder="wood").found == 3
    assert one.pictures(folder="wo").found == 0
    assert [each.name for each in one.pictures(sorting="newest", count=2).pictures] == ["a", "oak"]


def test_what_cannot_be_read_is_counted(folder: Path) -> None:
    (folder / "b.png").write_bytes(b"no picture")
    page = library(folder.parent).pictures(count=2)
    assert [one.id for one in page.pictures] == ["folder:a.png"]
    assert (page.asked, page.found) == (2, 6)
    assert page.notes == ("1 of these cannot be read",)


@pytest.mark.skipif(os.name != "posix", reason="needs links")
def test_links_inside_are_followed_once_and_others_are_counted(folder: Path) -> None:
    picture(folder.parent / "elsewhere" / "secret.png")
    (folder / "linked.png").symlink_to(folder / "wood" / "oak.png")
    (folder / "again").symlink_to(folder / "wood" / "pine")
    (folder / "loop").symlink_to(folder)
    (folder / "out.png").symlink_to(folder.parent / "elsewhere" / "secret.png")
    (folder / "outside").symlink_to(folder.parent / "elsewhere")
    (folder / "broken.png").symlink_to(folder / "nothing.png")
    made = scan(folder, ())
    ids = [one.id for one in made.found]
    assert "folder:linked.png" in ids
    assert len([one for one in ids if one.endswith("knot.png")]) == 1
    assert not any("secret" in one or "outside" in one for one in ids)
    assert made.notes == ("3 links out of the folder are left out",)
    shown = library(folder.parent).pictures()
    assert "folder:linked.png" in [one.id for one in shown.pictures]


def test_folders_that_are_too_deep_are_counted(folder: Path) -> None:
    picture(folder / "/".join("abcdefghij") / "deep.png")
    made = scan(folder, ())
    assert made.left_out == 1
    assert made.notes == ("1 folder too deep or too many is left out",)


def test_thousands_are_counted_and_paged(tmp_path: Path) -> None:
    picture(tmp_path / "project" / "one.png")
    content = (tmp_path / "project" / "one.png").read_bytes()
    for number in range(2000):
        (tmp_path / "project" / f"{number:04}.png").write_bytes(content)
    page = library(tmp_path).pictures(first=1980, count=60)
    assert (len(page.pictures), page.asked, page.found, page.total) == (21, 21, 2001, 2001)
    assert page.pictures[-1].name == "one"
    assert chosen(scan(tmp_path / "project", ()).found, "199", "", "name")[0].id == "folder:0199.png"
    assert folders_of(scan(tmp_path / "project", ()).found) == {}
