"""Phases of repeating texture over a surface."""

from __future__ import annotations

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from texloom.stages.common.surface.faces import Faces
from texloom.stages.common.surface.surface_phases import surface_phases
from texloom.stages.common.surface.texels import Texels, texels_of


def levels_of(mesh: np.ndarray, size: tuple[int, int], scale: float, chart: np.ndarray) -> list[Texels]:
    down = np.tile(np.array([0, -1, 0], np.float32), (len(mesh), 1))
    return texels_of(Faces(mesh, down, size, scale), chart.astype(np.int32), 4)


def phases_of(levels: list[Texels], generators: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Of the texels of the coarsest level: rows and columns, px, and phases in cycles."""
    level = levels[-1]
    phases = surface_phases(levels, np.array(generators, np.float64))[level.flat] / 2**32
    return (level.in_result(level.flat, level.place) + 0.5) * 2**level.number - 0.5, phases


def turned(phases: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """What phases are off what is wanted but for a shift of all, in cycles."""
    off = np.exp(2j * np.pi * (phases - wanted))
    return np.abs(np.angle(off / off.mean(axis=0))).max(axis=0) / (2 * np.pi)


@pytest.mark.parametrize("generators", [[[20, 0], [0, 28]], [[12, -13], [12, 14]]])
def test_on_a_flat_square_they_are_those_of_the_plane(generators: list[list[float]]) -> None:
    levels = levels_of(square(128.0), (128, 128), 1.0, np.zeros(8))
    places, phases = phases_of(levels, generators)
    assert (turned(phases, places @ np.linalg.inv(generators)) < 0.03).all()


def test_they_go_on_across_a_border() -> None:
    """Of two halves of a square that are apart in the texture."""
    mesh = np.concatenate([square(128.0, (0, 64 / 144), (0, 0.5)), square(128.0, (72 / 144, 136 / 144), (0.5, 1))])
    levels = levels_of(mesh, (128, 144), 1.0, np.repeat([0, 1], 8))
    places, phases = phases_of(levels, [[20, 0], [0, 28]])
    places[places[:, 1] > 68, 1] -= 8
    assert (turned(phases, places @ np.diag([1 / 20, 1 / 28])) < 0.03).all()


def test_around_a_cylinder_they_fit_a_whole_number_of_times() -> None:
    """192 px around hold 9.6 repetitions, so there are 10."""
    levels = levels_of(cylinder(), (64, 192), 2 * np.pi / 192, np.zeros(1024))
    places, phases = phases_of(levels, [[20, 0], [0, 20]])
    assert turned(phases[:, 1:], places[:, 1:] * 10 / 192) < 0.06
