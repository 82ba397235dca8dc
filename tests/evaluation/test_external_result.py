from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.evaluation.external_result import ExternalResultParams, external_result
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def image() -> Image:
    return picture(np.arange(20 * 24 * 3).reshape(20, 24, 3) / 1440)


def test_a_larger_picture_is_cropped_to_its_centre(image: Image) -> None:
    result = external_result(image, ExternalResultParams(size=(16, 18)))
    np.testing.assert_array_equal(result.image.pixels, image.pixels[2:18, 3:21])
    assert not result.image.wraps


def test_without_a_size_all_of_the_picture_is_the_result(image: Image) -> None:
    result = external_result(image, ExternalResultParams(tileable=True))
    np.testing.assert_array_equal(result.image.pixels, image.pixels)
    assert result.image.wraps.both


@pytest.mark.parametrize(
    ("params", "problem"),
    [
        ({"size": (21, 24)}, "image: 24 x 20 px; the result must have at least 24 x 21 px"),
        ({"size": (16, 16), "tileable": True}, "a tileable result must have 16 x 16 px"),
    ],
)
def test_pictures_of_a_wrong_size(image: Image, params: dict[str, object], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        external_result(image, ExternalResultParams.model_validate(params))
