from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import masked, picture
from texloom.stages.analysis.structure.painted_structure import painted_structure
from texloom.stages.vocabulary.declare import InputError

SHAPE = (20, 30)


def test_painted_features_replace_the_detected_ones() -> None:
    image, detected = picture(np.full((*SHAPE, 3), 0.5)), np.eye(*SHAPE, dtype=bool)
    strokes = np.zeros(SHAPE, bool)
    strokes[5:8] = True
    np.testing.assert_array_equal(painted_structure(image, detected).structure, detected)
    painted = picture(np.where(strokes, 0.9, 0.05))
    np.testing.assert_array_equal(painted_structure(image, detected, painted).structure, strokes)
    usable = np.ones(SHAPE, bool)
    usable[:, :10] = False
    made = painted_structure(masked(image, usable, 0.5), detected, painted).structure
    np.testing.assert_array_equal(made, strokes & usable)


@pytest.mark.parametrize(("shape", "value"), [((20, 29), 1.0), (SHAPE, 0.0), (SHAPE, 1.0)])
def test_pictures_without_features_are_refused(shape: tuple[int, int], value: float) -> None:
    image, detected = picture(np.full((*SHAPE, 3), 0.5)), np.eye(*SHAPE, dtype=bool)
    with pytest.raises(InputError, match="painted:"):
        painted_structure(image, detected, picture(np.full(shape, value)))
