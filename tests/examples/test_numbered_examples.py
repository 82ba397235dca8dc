"""The numbered examples run as printed, and make what their pictures show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from examples.make_pictures import HERE, PICTURES, golden, page, run

_HASHED = 16  # differences a row, and rows, of a hash
_LONG = ("03", "04", "06", "08", "09", "10")  # numbers of those that `.ci/hosts` runs
_MOST = 0.1  # share of a hash that compression changes; of another texture half differs


def perceptual_hash(picture: Path) -> np.ndarray:
    """(16, 16) bool: whether the mean lightness of parts of a picture rises to the right."""
    with Image.open(picture) as opened:
        means = opened.convert("L").resize((_HASHED + 1, _HASHED), Image.Resampling.BOX)
    levels = np.asarray(means, np.int64)
    return levels[:, 1:] > levels[:, :-1]


@pytest.mark.parametrize(
    "example", [pytest.param(name, marks=[pytest.mark.long] if name[:2] in _LONG else []) for name in PICTURES]
)
def test_an_example_makes_its_picture(example: str, tmp_path: Path) -> None:
    made, shown = perceptual_hash(run(example, tmp_path)), perceptual_hash(golden(example))
    assert np.mean(made != shown) <= _MOST, "look at it, and renew it by: python -m examples.make_pictures"


def test_all_examples_are_on_the_page() -> None:
    assert set(PICTURES) == {path.name for path in HERE.iterdir() if path.name[:2].isdigit()}
    assert (HERE / "README.md").read_text() == page()


def test_another_texture_is_noticed() -> None:
    hashes = [perceptual_hash(golden(example)) for example in ("02_tileable.yaml", "10_library.py")]
    assert np.mean(hashes[0] != hashes[1]) > 3 * _MOST
