from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.ndimage import distance_transform_edt

from texloom.stages.analysis.structure.signed_distance import signed_distance


@given(arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.booleans()))
def test_equals_the_exact_transform_outside_minus_inside(structure: np.ndarray) -> None:
    result = signed_distance(structure)
    if structure.all() or not structure.any():
        assert not result.pixels.any()
        assert not result.field.any()
        return
    expected = distance_transform_edt(~structure) - distance_transform_edt(structure)
    np.testing.assert_array_equal(result.pixels, expected.astype(np.float32))
    assert ((result.pixels < 0) == structure).all()
    assert (np.abs(result.pixels) >= 1).all()


def test_large_distances_are_exact(rng: np.random.Generator) -> None:
    structure = rng.random((150, 200)) < 0.002
    expected = distance_transform_edt(~structure) - distance_transform_edt(structure)
    np.testing.assert_array_equal(signed_distance(structure).pixels, expected.astype(np.float32))


def test_field_is_the_distance_scaled_to_the_range_of_lightness() -> None:
    structure = np.zeros((20, 30), bool)
    structure[5:9, 10:20] = True
    result = signed_distance(structure)
    assert result.field.min() == 0
    assert result.field.max() == pytest.approx(100)
    slope, offset = np.polyfit(result.pixels.ravel().astype(np.float64), result.field.ravel().astype(np.float64), 1)
    np.testing.assert_allclose(result.field, slope * result.pixels + offset, atol=1e-3)
    assert slope > 0
