from __future__ import annotations

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from texloom.stages.analysis.surfaces.surface_charts import SurfaceChartsParams, surface_charts
from texloom.stages.analysis.surfaces.surface_direction import SurfaceDirectionParams, surface_direction
from texloom.stages.common.surface.chart_seams import neighbours
from texloom.stages.common.surface.faces import Faces
from texloom.stages.evaluation.surface_report import SurfaceReport, SurfaceReportParams, surface_report
from texloom.stages.vocabulary.arrays import Image

SIDE = 32


def report(mesh: np.ndarray, columns: np.ndarray) -> SurfaceReport:
    """Of a result with these values in its columns, from an exemplar of the same pixels."""
    charts = surface_charts(mesh, SurfaceChartsParams(size=(SIDE, SIDE), charts="own"))
    direction = surface_direction(charts.mesh, SurfaceDirectionParams()).direction
    image = Image(np.tile(columns.astype(np.float32)[:, None], (SIDE, 1, 1)), ("Y",))
    match = np.stack(np.indices((SIDE, SIDE)), axis=2).astype(np.uint32)
    jacobian = np.tile(np.array([2, 0, 0, 1], np.float32), (SIDE, SIDE, 1))
    covered = np.ones((SIDE, SIDE), bool)
    return surface_report(
        charts.mesh, charts.chart, direction, 2 * np.pi / SIDE, image, match, jacobian, covered, image, image,
        charts.layout, SurfaceReportParams(),
    )  # fmt: skip


@pytest.mark.parametrize(("values", "low", "high"), [("wave", 0.5, 1.5), ("ramp", 5, 100)])
def test_a_seam_that_can_be_seen_has_a_large_ratio(values: str, low: float, high: float) -> None:
    """Around a cylinder a wave continues itself, a ramp does not."""
    columns = np.arange(SIDE)
    light = 0.5 + 0.4 * np.cos(4 * np.pi * columns / SIDE + 1) if values == "wave" else columns / SIDE
    seams = report(cylinder(), light).table["seams"]
    assert low < seams["ratio"] < high
    assert seams["pairs_across"] == 2 * SIDE
    assert seams["continued_inside"] == 1
    assert seams["continued_across"] == 0


def test_stretch_and_use() -> None:
    table = report(square(), np.arange(SIDE)).table
    assert table["stretch"]["scale_median"] == pytest.approx(2**0.5)
    assert table["stretch"]["ratio_high"] == pytest.approx(2)
    assert table["use"]["used"] == 1
    assert table["seams"]["pairs_across"] == 0


def test_neighbours_across_a_border_are_a_pixel_apart() -> None:
    mesh = np.concatenate([square(64.0, (0, 0.4), (0, 0.5)), square(64.0, (0.6, 1), (0.5, 1))])
    charts = surface_charts(mesh, SurfaceChartsParams(size=(40, 80), charts="own"))
    direction = np.tile(np.array([0, -1, 0], np.float32), (len(mesh), 1))
    _, across = neighbours(Faces(charts.mesh, direction, (40, 80), 1.0), charts.chart)
    right = across.other[:, 1] > across.one[:, 1]
    np.testing.assert_array_equal(across.one[right, 1], 31)
    np.testing.assert_array_equal(across.other[right, 1], 48)
    np.testing.assert_allclose(across.offset[right], np.tile([0, 1], (right.sum(), 1)), atol=1e-3)
    np.testing.assert_array_equal(across.one[:, 0], across.other[:, 0])
