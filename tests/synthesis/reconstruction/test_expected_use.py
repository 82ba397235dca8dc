"""Expected use of exemplar pixels under control."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.synthesis.reconstruction.expected_use import expected_use


def test_pixels_of_like_control_share_the_target() -> None:
    """A tenth of the exemplar is wanted for half of the target."""
    own = np.zeros((20, 50, 1), np.float32)
    own[:, :5] = 9
    wanted = np.zeros((40, 60, 1), np.float32)
    wanted[:, 30:] = 9
    use = expected_use(own, wanted, 1)
    np.testing.assert_allclose(use[:, :5], 1200 / 100)
    np.testing.assert_allclose(use[:, 5:], 1200 / 900)
    np.testing.assert_allclose(expected_use(own[..., :0], wanted[..., :0], 3), 2.4)
    assert use.sum() == pytest.approx(2400)
