"""The picture of rooms and imports is current."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import pytest

from tests.docs.pages import DOCS


@pytest.fixture(scope="module")
def rooms() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_rooms", DOCS / "draw_rooms.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_picture_is_current(rooms: ModuleType) -> None:
    assert rooms.FILE.read_text(encoding="utf-8") == rooms.svg(), "run: python docs/draw_rooms.py"


def test_arrows_that_follow_from_others_are_left_out(rooms: ModuleType) -> None:
    assert rooms.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {"a": {"b"}, "b": {"c"}, "c": set()}
    assert rooms.rows({"a": {"b"}, "b": {"c"}, "c": set(), "d": set()}) == [["a"], ["b"], ["c", "d"]]


def test_circles_are_refused(rooms: ModuleType) -> None:
    with pytest.raises(ValueError, match="these import each other: a, b"):
        rooms.reduced({"a": {"b"}, "b": {"a"}, "c": {"a"}})
