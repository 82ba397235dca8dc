"""How much a texture varies within a patch."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.synthesis.reconstruction.local_variance import local_variance


def test_variance_of_all_planes_together(rng: np.random.Generator) -> None:
    """Noise loses 1/64 of its variance with the mean of 64 pixels."""
    planes = rng.normal(0, [1, 2, 3], (256, 256, 3)).astype(np.float32)
    assert local_variance(planes) == pytest.approx((1 + 4 + 9) * 63 / 64, rel=0.01)
    assert local_variance(3 * planes + 50) == pytest.approx(9 * local_variance(planes), rel=1e-4)


def test_only_what_varies_within_a_patch_counts() -> None:
    step = np.zeros((64, 64, 1), np.float32)
    step[32:] = 100
    assert 0 < local_variance(step) < 0.1 * step.var()
    assert local_variance(step[:32]) == 0


def test_parts_without_texture_lower_it_more_than_the_variance(rng: np.random.Generator) -> None:
    planes = rng.normal(0, 3, (128, 128, 1)).astype(np.float32)
    whole = local_variance(planes)
    planes[:64] = 0
    assert local_variance(planes) == pytest.approx(whole / 4, rel=0.1)
