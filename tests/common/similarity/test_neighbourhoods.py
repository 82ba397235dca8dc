from __future__ import annotations

import numpy as np

from texloom.stages.common.similarity.neighbourhoods import UNIT, Components, fixed_point


def test_fixed_point_rounds_and_lays_channels_side_by_side() -> None:
    planes = np.float32([[[1, 2, 3], [0.5, -0.5, 100]], [[1 / 48, 1 / 24, 0], [-128, 127, 99.99]]])
    values = fixed_point(planes)
    assert values.dtype == np.int16
    expected = [
        [UNIT, 2 * UNIT, 3 * UNIT, UNIT // 2, -UNIT // 2, 100 * UNIT],
        [0, 1, 0, -128 * UNIT, 127 * UNIT, 1600],
    ]
    assert values.tolist() == expected


def test_fixed_point_holds_guidance_at_its_strongest() -> None:
    """Guidance of 0..100 times a weight of 3 is told apart up to its end; beyond it values are clipped."""
    values = fixed_point(np.float32([[[299, 300, 1e6, -1e6]]]))[0]
    assert values[0] == 299 * UNIT
    assert values[1] == 300 * UNIT
    assert values[2] >= values[1]
    assert values[3] == -values[2]
    assert int(values[2]) - int(values[3]) < 2**15  # differences fit 16 bits


def test_vectors_of_some_neighbourhoods_are_those_among_all(rng: np.random.Generator) -> None:
    planes = rng.uniform(0, 100, (60, 70, 3)).astype(np.float32)
    pixels = fixed_point(planes)
    components = Components.of(pixels, 3, 5)
    vectors = components.vectors(pixels)
    assert vectors.shape == (56 * 66, 32)
    numbers = rng.permutation(len(vectors))[:300]
    np.testing.assert_array_equal(components.vectors_at(pixels, numbers), vectors[numbers])
    row, column = np.divmod(int(numbers[0]), 66)
    own = fixed_point(planes[row : row + 5, column : column + 5]).reshape(1, -1)
    np.testing.assert_array_equal(components.projected(own)[0], vectors[numbers[0]])
