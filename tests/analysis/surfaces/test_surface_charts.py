from __future__ import annotations

import importlib.util
import logging
import sys

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from texloom.pipelines.media.shapes import tower
from texloom.stages.analysis.surfaces.surface_charts import SurfaceChartsParams, surface_charts
from texloom.stages.vocabulary.declare import InputError

SIZE = SurfaceChartsParams(size=(64, 64))


def test_own_texture_coordinates_stay() -> None:
    mesh = cylinder((0.1, 0.9))
    charts = surface_charts(mesh, SIZE)
    np.testing.assert_array_equal(charts.mesh[:, 6:8], mesh[:, 6:8])
    np.testing.assert_array_equal(charts.mesh[:, :3], mesh[:, :3])
    np.testing.assert_allclose(charts.mesh[:, 3:6] * [1, 0, 1], mesh[:, :3] * [1, 0, 1], atol=0.03)
    assert not charts.chart.any()
    assert (charts.height, charts.width) == (64, 64)


def test_charts_are_what_is_connected_in_the_texture() -> None:
    mesh = np.concatenate([square(1.0, (0, 0.4), (0, 0.5)), square(1.0, (0.6, 1), (0.5, 1))])
    np.testing.assert_array_equal(surface_charts(mesh, SIZE).chart, np.repeat([0, 1], 8))


def test_faces_without_area_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    mesh = square()
    mesh[0, 0] = np.nan
    mesh[3:6, :3] = mesh[3, :3]
    with caplog.at_level(logging.WARNING):
        charts = surface_charts(mesh, SIZE)
    assert len(charts.chart) == 6
    assert "2 of 8 faces have no area" in caplog.text


@pytest.mark.parametrize("value", [np.nan, 0.0, np.inf])
def test_without_any_area_it_is_refused(value: float) -> None:
    mesh = square()
    mesh[:, :3] = value
    with pytest.raises(InputError, match="no face has an area"):
        surface_charts(mesh, SIZE)


def overlapping() -> np.ndarray:
    return np.concatenate([square(1.0, (0, 0.6), (0, 0.5)), square(1.0, (0.3, 1), (0.5, 1))])


def beyond() -> np.ndarray:
    return square(u=(0.5, 1.5))


def without() -> np.ndarray:
    mesh = square()
    mesh[:, 6:8] = np.nan
    return mesh


CASES = [(overlapping, "overlap in"), (beyond, "not within 0..1"), (without, "has no texture coordinates")]


@pytest.mark.parametrize(("make", "problem"), CASES)
def test_texture_coordinates_that_cannot_be_used_are_refused_or_replaced(
    make: object, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert callable(make)
    mesh = make()
    with pytest.raises(InputError, match=f"{problem}.*--set charts=new"):
        surface_charts(mesh, SurfaceChartsParams(size=(64, 64), charts="own"))
    with monkeypatch.context() as patch:
        find = importlib.util.find_spec
        patch.setattr(importlib.util, "find_spec", lambda name: None if name == "xatlas" else find(name))
        with pytest.raises(InputError, match=f"{problem}.*xatlas is needed; pip install"):
            surface_charts(mesh, SIZE)
    pytest.importorskip("xatlas")
    made = surface_charts(mesh, SIZE).mesh
    np.testing.assert_array_equal(made[:, :3], mesh[:, :3])
    assert 0 <= made[:, 6:8].min() <= made[:, 6:8].max() <= 1


def test_new_charts_do_not_overlap() -> None:
    pytest.importorskip("xatlas")
    charts = surface_charts(tower(), SIZE)
    surface_charts(charts.mesh, SurfaceChartsParams(size=(64, 64), charts="own"))
    assert charts.chart.max() > 4


def test_a_process_of_xatlas_that_dies_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xatlas")
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(InputError, match="xatlas ended with code 1; give a mesh with texture coordinates"):
        surface_charts(tower(), SIZE)
