"""Sizes: (height, width) in Python, width x height in every text."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic
import pytest

from tests.conftest import ROOT
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.sizes import SIDES, Size, format_size, parse_size, size_value, takes_sides


class Sized(Params):
    size: Size = (16, 32)
    tiles: Annotated[tuple[int, int], SIDES] | None = None


def test_texts_are_width_by_height() -> None:
    assert Sized(size="64x32").size == (32, 64)  # type: ignore[arg-type]
    assert Sized(size=(32, 64)).size == (32, 64)
    assert Sized(size="64").size == Sized(size=64).size == (64, 64)  # type: ignore[arg-type]
    assert (parse_size("3x2"), parse_size("5"), parse_size("3x"), parse_size("3x2x1")) == (
        (2, 3),
        (5, 5),
        None,
        None,
    )


def test_json_has_texts_that_are_read_again() -> None:
    sized = Sized(size=(32, 64), tiles=(1, 2))
    assert sized.model_dump(mode="json") == {"size": "64x32", "tiles": "2x1"}
    assert Sized.model_validate(sized.model_dump(mode="json")) == sized
    assert sized.model_dump()["size"] == (32, 64)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ([512, 1024], "got the list [512, 1024]; write 1024x512 or 512x1024"),
        ([512, 512], "got the list [512, 512]; write 512"),
        ([512], "as 512 or 768x512, got [512]"),
        ("512 x 512", "as 512 or 768x512, got '512 x 512'"),
    ],
)
def test_what_has_two_readings_is_refused(size: object, message: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=re.escape(message)):
        Sized.model_validate({"size": size})


def test_people_read_the_width_first() -> None:
    assert format_size((2, 3)) == format_size(np.zeros((2, 3, 4)).shape) == "3 x 2 px"
    assert format_size(Image(np.zeros((2, 3, 1), np.float32), ("Y",))) == "3 x 2 px"
    assert size_value((2, 3)) == "3x2"
    assert takes_sides(Annotated[tuple[int, int], SIDES] | None)
    assert not takes_sides(tuple[int, int])


def test_no_module_formats_sizes_itself() -> None:
    paths = [path for folder in ("stages", "pipelines") for path in (ROOT / folder).rglob("*.py")]
    own = re.compile(r"\{[\w.]*height\}\s?x\s?\{|\[0\]\}\s?x\s?\{")
    found = [
        str(path)
        for path in paths
        if own.search(path.read_text()) and path != Path(ROOT / "stages/vocabulary/sizes.py")
    ]
    assert found == []
