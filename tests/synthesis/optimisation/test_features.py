"""Which planes of an exemplar its patches are compared by."""

import numpy as np
import pytest

from tests.synthetic import blobs, picture
from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.synthesis.optimisation.features import PatchFeatures
from texloom.stages.synthesis.optimisation.scale import Scale
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import FilledExemplar

SHAPE, SIZE = (20, 24), 5

FULL = Scale(
    level=1, factor=1.0, exemplar=SHAPE, places=(16, 20), target=SHAPE, patches=(16, 20), iterations=1
)  # fmt: skip


def features(image: Image, guidance: np.ndarray | None = None, given: Image | None = None) -> PatchFeatures:
    return PatchFeatures(FilledExemplar.of(image), guidance, 2.0, {}, None, None, 0.0, SIZE, given)


def compared(own: PatchFeatures) -> np.ndarray:
    exemplar, _, _ = own.at(FULL, phased=False, margin=(0, 0))
    return exemplar.reshape(*SHAPE, -1)


@pytest.fixture
def grey(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 1), rng))


def test_a_grey_exemplar_is_compared_by_lightness(grey: Image, rng: np.random.Generator) -> None:
    distance = rng.uniform(0, 100, SHAPE).astype(np.float32)
    lightness = fixed_point(lab_from_linear(grey.color)[..., :1])
    own = features(grey, distance)
    planes = compared(own)
    assert planes.shape == (*SHAPE, 2)
    np.testing.assert_array_equal(planes[..., 0], lightness)
    assert planes[..., 1].min() == 0
    lows, highs = own.ranges(2)
    assert lows.tolist() == [0, 0]
    assert highs.tolist() == [100, 200]
    repeated = Image(grey.color, ("R", "G", "B"))
    np.testing.assert_array_equal(compared(features(repeated, distance)), planes)


def test_a_tint_is_compared(grey: Image) -> None:
    tinted = Image(grey.color * np.float32([1.0, 0.98, 1.0]), ("R", "G", "B"))
    assert compared(features(tinted)).shape == (*SHAPE, 3)


def test_a_grey_exemplar_is_compared_with_a_tint(grey: Image) -> None:
    """What is given may have colours that the exemplar lacks."""
    repeated, tinted = (Image(grey.color * np.float32([1.0, share, 1.0]), ("R", "G", "B")) for share in (1.0, 0.98))
    own = features(repeated, given=tinted)
    planes, known = own.of_given(tinted, compared(own).shape[2])
    np.testing.assert_array_equal(planes, lab_from_linear(tinted.color))
    assert known.all()
    own = features(repeated, given=repeated)
    planes, known = own.of_given(repeated, compared(own).shape[2])
    np.testing.assert_array_equal(planes, lab_from_linear(repeated.color)[..., :1])
