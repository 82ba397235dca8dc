"""The numbered examples run as printed, and make what their pictures show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from examples.make_pictures import HERE, PICTURES, golden, page, perceptual_hash, run

_MOST = 0.1  # share of a hash that compression changes; of another texture half differs


@pytest.mark.parametrize("example", PICTURES)
def test_an_example_makes_its_picture(example: str, tmp_path: Path) -> None:
    made, shown = perceptual_hash(run(example, tmp_path)), perceptual_hash(golden(example))
    assert np.mean(made != shown) <= _MOST, "look at it, and renew it by: python -m examples.make_pictures"


def test_all_examples_are_on_the_page() -> None:
    assert set(PICTURES) == {path.name for path in HERE.iterdir() if path.name[:2].isdigit()}
    assert (HERE / "README.md").read_text() == page()


def test_another_texture_is_noticed() -> None:
    hashes = [perceptual_hash(golden(example)) for example in ("02_tileable.yaml", "10_library.py")]
    assert np.mean(hashes[0] != hashes[1]) > 3 * _MOST
