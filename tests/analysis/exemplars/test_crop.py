from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.exemplars.crop import CropParams, check_part, crop
from texloom.stages.vocabulary.declare import InputError


def test_the_part_is_kept_bit_for_bit(rng: np.random.Generator) -> None:
    image = picture(rng.random((9, 12, 3)))
    part = crop(image, CropParams(size=(4, 5), at=(5, 7))).image
    np.testing.assert_array_equal(part.pixels, image.pixels[5:, 7:])
    assert part.channels == image.channels
    np.testing.assert_array_equal(crop(image, CropParams(size=(9, 12))).image.pixels, image.pixels)


def test_without_a_place_it_is_the_middle(rng: np.random.Generator) -> None:
    image = picture(rng.random((9, 12, 3)))
    np.testing.assert_array_equal(crop(image, CropParams(size=(3, 4))).image.pixels, image.pixels[3:6, 4:8])


@pytest.mark.parametrize(
    ("params", "line"),
    [
        ({"size": (10, 3)}, "size: 3 x 10 px is not inside the image of 12 x 9 px"),
        (
            {"size": (3, 3), "at": (0, 10)},
            "size: 3 x 3 px from row 0, column 10 is not inside the image of 12 x 9 px",
        ),
        (
            {"size": (3, 3), "at": (7, 0)},
            "size: 3 x 3 px from row 7, column 0 is not inside the image of 12 x 9 px",
        ),
    ],
)
def test_a_part_outside_is_refused_before_anything_runs(params: dict[str, tuple[int, int]], line: str) -> None:
    with pytest.raises(InputError) as refused:
        check_part(CropParams(**params), {"image": picture(np.zeros((9, 12, 3)))})
    assert str(refused.value) == line
