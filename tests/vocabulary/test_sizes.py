"""Sizes: (height, width) in Python, width x height in every text."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic
import pytest

from tests.conftest import ROOT
from texloom.stages.lookup.registry import find_stage, shipped_stages
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.sizes import (
    LENGTHS,
    SIDES,
    Size,
    format_size,
    parse_lengths,
    parse_size,
    size_value,
    takes_sides,
)


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


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ("5x512", "the width should be greater than or equal to 16, got 5"),
        ("512x5", "the height should be greater than or equal to 16, got 5"),
        ((5, 512), "the height should be greater than or equal to 16, got 5"),
        (5, "the side should be greater than or equal to 16, got 5"),
        (512.5, "the side should be a valid integer"),
        (True, "as 512 or 768x512, got True"),
    ],
)
def test_the_wrong_side_is_named(size: object, message: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=re.escape(message)):
        Sized.model_validate({"size": size})


def test_lengths_are_texts_without_loss() -> None:
    class Measured(Params):
        lengths: Annotated[tuple[float, float], LENGTHS]

    for lengths in ((2.0, 13.2), (1e5, 1 / 3), (1e-5, 123456.0)):
        measured = Measured(lengths=lengths)
        assert Measured.model_validate(measured.model_dump(mode="json")) == measured
    assert (parse_lengths("13.2x10"), parse_lengths("2.5"), parse_lengths("1e3")) == ((10, 13.2), (2.5, 2.5), None)
    assert size_value((10.0, 13.2)) == "13.2x10"


def test_every_size_that_a_stage_takes_is_one() -> None:
    sizes = {
        f"{name}.{param}": SIDES in field.metadata or takes_sides(field.annotation)
        for name in shipped_stages()
        for param, field in find_stage(name).params.model_fields.items()
        if param in ("size", "extent", "period") and "tuple" in str(field.annotation)
    }
    assert [name for name, is_size in sizes.items() if not is_size] == []
    assert "synthesis.epitome.size" in sizes


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
