"""The picture of rooms and imports is current."""

from __future__ import annotations

from types import ModuleType

import pytest

from tests.docs.pages import DOCS, script


@pytest.fixture(scope="module")
def rooms() -> ModuleType:
    return script(DOCS / "draw_rooms.py")


def test_picture_is_current(rooms: ModuleType) -> None:
    assert rooms.FILE.read_text(encoding="utf-8") == rooms.svg(), "run: python docs/draw_rooms.py"


def test_arrows_that_follow_from_others_are_left_out(rooms: ModuleType) -> None:
    assert rooms.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {"a": {"b"}, "b": {"c"}, "c": set()}
    assert rooms.rows({"a": {"b"}, "b": {"c"}, "c": set(), "d": set()}) == [["a"], ["b"], ["c", "d"]]


def test_circles_are_refused(rooms: ModuleType) -> None:
    with pytest.raises(ValueError, match="these import each other: a, b"):
        rooms.reduced({"a": {"b"}, "b": {"a"}, "c": {"a"}})
