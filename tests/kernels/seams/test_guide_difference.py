import numpy as np

from tests.kernels.seams import naive
from texloom.stages.kernels.seams.guide_difference import add_guide_difference


def test_differences_are_added_in_any_spans(rng: np.random.Generator) -> None:
    means, wanted = rng.normal(size=(2, 7, 5)), rng.normal(size=2)
    squares = (means**2).sum(axis=0) + rng.random((7, 5)) - 0.2  # means of squares; rounding may make them less
    errors = rng.random((7, 5)).astype(np.float32)
    expected = errors + naive.guide_difference(means, squares, wanted, 1.3) / 50
    for span in ((0, 3), (3, 7)):
        add_guide_difference(means, squares, wanted, 1.3, 50.0, errors, *span)
    np.testing.assert_allclose(errors, expected, rtol=1e-6)
