from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.common.geometry.jacobians import inverted


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_there_and_back_is_nowhere(dtype: type, rng: np.random.Generator) -> None:
    jacobian = (np.eye(2) + 0.2 * rng.standard_normal((7, 9, 2, 2))).astype(dtype)
    back = inverted(jacobian.reshape(7, 9, 4))
    assert back.dtype == dtype
    np.testing.assert_allclose(
        jacobian @ back.reshape(7, 9, 2, 2), np.broadcast_to(np.eye(2), (7, 9, 2, 2)), atol=1e-5
    )


def test_a_known_one() -> None:
    """Rows twice as long, and columns that lean by a row each three."""
    assert inverted(np.float64([[[2, 0, 3, 1]]])).tolist() == [[[0.5, 0, -1.5, 1]]]
