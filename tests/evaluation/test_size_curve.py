"""Reconstruction error by the size of a compaction, as a picture."""

from __future__ import annotations

import numpy as np

from texloom.stages.evaluation.size_curve import SizeCurveParams, size_curve


def test_the_knee_shows() -> None:
    rows = [{"share": share, "error": error} for share, error in ((0.02, 9.0), (0.06, 5.0), (0.25, 4.0))]
    one, other = (size_curve({"rows": rows, "knee": knee}, SizeCurveParams()).figure for knee in (0.06, 0.25))
    assert one.pixels.shape == (750, 1200, 3)
    assert 0 <= one.pixels.min() < 0.1
    assert one.pixels.max() == 1
    assert np.abs(one.pixels - other.pixels).max() > 0.5
