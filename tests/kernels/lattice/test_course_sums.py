from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.lattice import naive
from texloom.stages.kernels.lattice.course_sums import course_sums


@pytest.mark.parametrize("period", [(4.0, 0.0), (-1.3, 3.9), (0.0, 3.2)])
def test_pixels_are_added_to_the_bins_of_their_segments(
    period: tuple[float, float], rng: np.random.Generator
) -> None:
    plane = rng.standard_normal((19, 23)).astype(np.float32)
    rows, columns = np.arange(19.0), np.arange(23.0)
    length = np.hypot(*period)
    across = rows * (period[0] / length**2), columns * (period[1] / length**2)
    along = rows * (-period[1] / length), columns * (period[0] / length)
    places = [one[:, None] + other for one, other in (across, along)]
    lowest = float(np.floor(places[0].min())), float(places[1].min())
    places = [place - low for place, low in zip(places, lowest, strict=True)]
    segments = 3, 3 / (float(places[1].max()) + 1e-9)
    shape = (2, 2, 3, 5 * (int(places[0].max()) + 2))
    found, expected = np.zeros(shape), np.zeros(shape)
    course_sums(plane, across, along, lowest, 5, segments, found)
    naive.course_sums(plane, *places, 5, segments, expected)
    np.testing.assert_array_equal(found, expected)
    assert found[0, 0].sum() == plane.size
    assert (found[0, 0].sum(axis=1) > plane.size / 6).all()
