"""Feature masks by differences of Gaussians."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.structure.dog_mask import DogMask, DogMaskParams, check_seeds, dog_mask
from texloom.stages.vocabulary.declare import InputError

DOTS = ((15, 20), (40, 60), (65, 25))


def dots(value: float = 0.1, ground: float = 0.5) -> np.ndarray:
    """Discs of 6 px on a ground that becomes brighter, and a speck."""
    rows, columns = np.indices((80, 90))
    plane = ground + 0.3 * columns / 90
    for row, column in DOTS:
        plane[np.hypot(rows - row, columns - column) < 3.2] = value
    plane[70, 80] = value
    return plane


def mask(plane: np.ndarray, **params: Any) -> DogMask:
    return dog_mask(picture(plane), DogMaskParams(**{"outer": 6.0, "threshold": 8.0, **params}))


def test_features_are_detected_whatever_the_light() -> None:
    made = mask(dots())
    truth = dots() < 0.2
    truth[70, 80] = False  # too small
    assert made.components == 3
    assert (made.structure & truth).sum() > 0.9 * truth.sum()
    assert made.structure.sum() < 1.5 * truth.sum()
    np.testing.assert_array_equal(made.image.pixels[..., 0] > 0.5, made.structure)
    np.testing.assert_array_equal(made.classes, made.structure[None])
    assert mask(dots(), smallest=1).components == 4


def test_dark_and_bright_features() -> None:
    bright = dots(1.0, 0.2)
    assert (
        mask(bright, features="bright").components == mask(bright, features="both", threshold=20.0).components == 3
    )
    assert not mask(bright, threshold=20.0).structure.any()


def test_classes_are_filled_from_seeds() -> None:
    seeds = (((41, 61),), ((64, 24), (2, 2)))
    made = mask(dots(), seeds=seeds, only=2)
    assert made.classes.shape == (3, 80, 90)
    assert [bool(made.classes[1][place]) for place in DOTS] == [False, True, False]
    assert [bool(made.classes[2][place]) for place in DOTS] == [True, False, True]
    assert not made.classes[0].any()
    np.testing.assert_array_equal(made.image.pixels[..., 0] > 0.5, made.classes[2])


@pytest.mark.parametrize(
    ("params", "said"),
    [
        ({"outer": 1.0}, r"^outer: 1 px; must be more than inner"),
        ({"only": 1}, r"^only: 1; there are 1 classes"),
        ({"seeds": (((80, 3),),)}, r"^seeds: \[80, 3\] is outside the image of 90 x 80 px"),
    ],
)
def test_what_is_wrong_is_said(params: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_seeds(DogMaskParams(**params), {"image": picture(dots())})


def test_seeds_need_components() -> None:
    with pytest.raises(InputError, match=r"^seeds: no component"):
        mask(dots(), threshold=100.0, seeds=(((1, 1),),))
