"""Strokes as JSON files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.control.orientation_field import OrientationFieldParams, orientation_field
from texloom.stages.vocabulary.declare import InputError

LINES = [[[10, 10], [10, 90.5]], [[60, 20], [40, 50], [60, 80]]]


def written(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_lines_are_drawn_where_their_points_are(tmp_path: Path) -> None:
    source = open_source("strokes", str(written(tmp_path / "s.json", {"size": "100x80", "strokes": LINES})))
    assert (source.height, source.width, source.channels) == (80, 100, ("Y",))
    drawn = source.read().pixels[..., 0]
    on, off = ([10, 10, 50, 40], [15, 50, 35, 50]), ([20, 70, 50], [50, 50, 50])
    assert (drawn[on] > 0.9).all()
    assert (drawn[off] == 0).all()
    assert 2 * 150 < (drawn > 0.5).sum() < 6 * 150


def test_directions_follow_them(tmp_path: Path, rng: np.random.Generator) -> None:
    lines = {"size": "100x80", "strokes": [[[70, 10], [10, 70]]]}
    strokes = open_source("strokes", str(written(tmp_path / "s.json", lines))).read()
    noise = picture(rng.random((80, 100)).astype(np.float32))
    angle = orientation_field(noise, OrientationFieldParams(), strokes).angle
    np.testing.assert_allclose(np.degrees(angle[40, 38:42]), 135, atol=3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "it is not JSON"),
        ('{"a":' * 100_000, "it is not JSON"),
        ({"strokes": LINES}, "a mapping with 'size', 'strokes'"),
        ({"size": "100x80", "strokes": LINES, "color": 1}, "a mapping with 'size', 'strokes'"),
        ({"size": [80, 100], "strokes": LINES}, r"got the list \[80, 100\]; write 100x80 or 80x100"),
        ({"size": "0x80", "strokes": LINES}, "size: the width should be greater than 0"),
        ({"size": "100x80", "strokes": []}, "must be a list of lines"),
        ({"size": "100x80", "strokes": [LINES[0], [[1, 2]]]}, "stroke 2 must be a list of two or more points"),
        ({"size": "100x80", "strokes": [[[1, 2], [3, 1e300]]]}, "stroke 1 must be"),
        ({"size": "100x80", "strokes": [[[1, 2], [float("nan"), 3]]]}, "stroke 1 must be"),
        ({"size": "100x80", "strokes": [[[1, 2], [True, 3]]]}, "stroke 1 must be"),
        ({"size": "100x80", "strokes": [[[0, 0]] * 100_001]}, "more than 100000 points"),
        ({"size": "100x80", "strokes": LINES, "width": 0}, "width must be a whole number from 1 to 255"),
        ({"size": "40000x80", "strokes": LINES}, "is too large: 40000 x 80 px"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, content: Any, message: str) -> None:
    path = written(tmp_path / "s.json", content)
    with pytest.raises(InputError, match=message) as caught:
        open_source("strokes", str(path))
    assert str(caught.value).startswith(f"sources.strokes: {path}: ")
    assert str(caught.value).isprintable()


def test_a_few_bytes_make_no_huge_picture(tmp_path: Path) -> None:
    path = written(tmp_path / "s.json", {"size": "16384x16384", "strokes": LINES})
    with pytest.raises(
        InputError, match=r"a size of 16384 x 16384 px is too large, at most 67108864 pixels of strokes"
    ):
        open_source("s", str(path))
