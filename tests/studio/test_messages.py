"""The types of the page are those of the server."""

from __future__ import annotations

from pathlib import Path

import pytest

from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.answers import PreviewFailed
from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PaintOpenRequest
from texloom.pipelines.studio.recipe_flows import overrides_of
from texloom.pipelines.studio.typescript import FILE, types
from texloom.stages.vocabulary.declare import InputError


def test_the_types_of_the_page_are_current() -> None:
    assert FILE.read_text() == types(), "python -m texloom.pipelines.studio.typescript"


def test_messages_come_out_as_they_went_in() -> None:
    message = PreviewFailed(number=3, problem="é")
    header, payload = unpacked(packed(message, b"pixels"))
    assert PreviewFailed.model_validate_json(header) == message
    assert bytes(payload) == b"pixels"


@pytest.mark.parametrize("frame", [b"", b"\0\0", b"\x05\0\0\0{}"])
def test_cut_messages_are_refused(frame: bytes) -> None:
    with pytest.raises(ValueError, match="message"):
        unpacked(frame)


@pytest.mark.parametrize("picture", ["folder:a\n\x1b[31m.png", "a\x1b", "folder:../a\n.png"])
def test_problems_are_one_printable_line(tmp_path: Path, picture: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "a\n.png").touch()
    with pytest.raises(InputError) as refused:
        Library(tmp_path / "folder", tmp_path / "store").reference(picture)
    assert str(refused.value).isprintable()
    recipe = Recipe(flow="\x1b[31m\n", sources={})
    with pytest.raises(InputError) as refused:
        overrides_of(recipe, Library(tmp_path / "folder", tmp_path / "store"))
    assert str(refused.value).isprintable()


def test_a_recipe_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no picture is chosen"):
        overrides_of(Recipe(flow="quilting", sources={}), Library(tmp_path, tmp_path / "store"))


def test_a_canvas_has_two_pixels_a_side() -> None:
    with pytest.raises(ValueError, match="greater than or equal to 2"):
        PaintOpenRequest(number=1, texture="", control="", size=(1, 16))
