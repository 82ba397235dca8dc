"""The trend of an exemplar, laid over a result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.ageing import ageing
from tests.synthetic import masked, picture
from texloom.stages.analysis.control.growth_guide import GrowthGuide, GrowthGuideParams, growth_guide
from texloom.stages.analysis.control.progression import ProgressionParams, progression
from texloom.stages.common.features.slow_features import progression_in
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import Optimised, optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (48, 64)
RAMP = np.broadcast_to(((np.arange(SHAPE[1]) + 0.5) / SHAPE[1]).astype(np.float32), SHAPE)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return ageing(SHAPE, rng)


def guide(
    exemplar: Image,
    angle: float | None = None,
    target: Image | None = None,
    target_angle: np.ndarray | None = None,
    **params: Any,
) -> GrowthGuide:
    """Of a trend from left to right, and one orientation."""
    angles = None if angle is None else np.full(SHAPE, angle, np.float32)
    return growth_guide(exemplar, RAMP, RAMP, GrowthGuideParams(**params), angles, None, target, target_angle)


def painted(values: np.ndarray) -> Image:
    """A target as it is painted, in sRGB."""
    return Image.of(np.rint(values * 255).astype(np.uint8)[..., None].repeat(3, axis=2))


def test_the_trend_is_stretched_over_the_result(exemplar: Image) -> None:
    found = guide(exemplar)
    assert found.target.shape == (96, 128, 1)
    wide = guide(exemplar, size=(48, 192)).wanted
    assert (np.diff(wide, axis=1) >= 0).all()
    np.testing.assert_allclose(wide[:, 1::3], RAMP, atol=1e-6)
    np.testing.assert_allclose(found.target[..., 0] / found.wanted, found.exemplar[0, 0, 0] / RAMP[0, 0], rtol=1e-4)


@pytest.mark.parametrize(
    ("curve", "ends"),
    [([1, 0], (1, 0)), ([0.5, 1], (0.5, 1)), ([0, 1, 0], (0, 0)), ([0.2, 0.2], (0.2, 0.2))],
)
def test_a_curve_bends_the_trend(exemplar: Image, curve: list[float], ends: tuple[float, float]) -> None:
    wanted = guide(exemplar, size=(48, 640), curve=curve).wanted
    np.testing.assert_allclose(wanted[0, [0, -1]], ends, atol=0.03)
    middle = np.interp(0.5, np.linspace(0, 1, len(curve)), curve)
    np.testing.assert_allclose(wanted[:, 320], middle, atol=0.03)


def test_a_tileable_trend_goes_there_and_back(exemplar: Image) -> None:
    found = guide(exemplar, angle=0.5, size=(96, 128), tileable="x")
    np.testing.assert_allclose(found.wanted, found.wanted[:, ::-1], atol=1e-6)
    assert found.wanted[0, 0] < 0.05 < 0.9 < found.wanted[0, 63]
    left, right = found.target[0, 10], found.target[0, -11]
    np.testing.assert_allclose(left * [1, 1, -1], right, rtol=1e-4)  # mirrored, it runs at the opposite angle


def test_a_target_is_followed_as_it_was_painted(exemplar: Image) -> None:
    values = np.where(np.arange(60)[None] < 30, 0.2, 0.8) * np.ones((40, 1))
    found = guide(exemplar, angle=0.5, target=painted(values))
    assert found.target.shape == (40, 60, 1)  # and directions are free
    np.testing.assert_allclose(found.wanted, values, atol=0.003)
    asked = np.ones((40, 60), bool)
    asked[:20] = False
    part = guide(exemplar, target=masked(painted(values), asked, 0.0))
    assert np.isnan(part.target[:18]).all()
    assert not np.isnan(part.target[22:]).any()


def test_a_straight_trend_along_an_angle(exemplar: Image) -> None:
    wanted = guide(exemplar, size=(96, 64), curve=[0, 1]).wanted
    down = growth_guide(exemplar, RAMP, RAMP, GrowthGuideParams(size=(96, 64), angle=90)).wanted
    np.testing.assert_allclose(down, np.broadcast_to((np.arange(96)[:, None] + 0.5) / 96, (96, 64)), atol=1e-5)
    np.testing.assert_allclose(wanted, RAMP[:1].repeat(96, axis=0), atol=1e-6)


def test_a_trend_runs_along_a_path(exemplar: Image) -> None:
    """An arch: its feet are where it begins and ends, its top half way, and beyond its begin nothing is less."""
    arch = [(0.9, 0.1), (0.1, 0.1), (0.1, 0.9), (0.9, 0.9)]
    found = guide(exemplar, size=(200, 300), path=arch, angle=0.5)
    wanted = found.wanted
    assert found.target.shape == (200, 300, 1)  # directions are free
    lengths = np.array([160, 240, 160]) / 560
    for (row, column), expected in zip(arch, np.concatenate([[0], np.cumsum(lengths)]), strict=True):
        assert abs(wanted[int(200 * row), int(300 * column)] - expected) < 0.05
    assert abs(wanted[20, 150] - 0.5) < 0.02
    assert wanted[-1, 0] < 0.02
    assert wanted[-1, -1] > 0.98
    np.testing.assert_allclose(wanted, 1 - wanted[:, ::-1], atol=0.02)
    straight = guide(exemplar, size=(48, 64), path=[(0.5, 0.0), (0.5, 1.0)]).wanted
    np.testing.assert_allclose(straight[:, 4:-4], RAMP[:, 4:-4], atol=0.01)
    bent = guide(exemplar, size=(200, 300), path=arch, curve=[1, 0]).wanted
    np.testing.assert_allclose(bent, 1 - wanted, atol=1e-5)


def test_a_tileable_path_continues_across_borders(exemplar: Image) -> None:
    wanted = guide(exemplar, size=(64, 64), path=[(0.4, 0.2), (0.6, 0.8)], tileable="both").wanted
    for axis in (0, 1):
        jump = np.abs(wanted.take(0, axis) - wanted.take(-1, axis)).max()
        assert jump < 1.5 * np.abs(np.diff(wanted, axis=axis)).max()


def test_paths_that_say_nothing_are_refused(exemplar: Image) -> None:
    with pytest.raises(ValueError, match="all its corners are the same place"):
        guide(exemplar, path=[(0.5, 0.5), (0.5, 0.5)])
    with pytest.raises(ValueError, match="path and angle both say"):
        GrowthGuideParams(path=[(0, 0), (1, 1)], angle=90)
    with pytest.raises(InputError, match="path: a painted target says where"):
        guide(exemplar, target=painted(np.ones((8, 8))), path=[(0, 0), (1, 1)])
    with pytest.raises(ValueError, match=r"path\.0\.1"):
        guide(exemplar, path=[(0, 5), (1, 1)])


def test_directions_are_those_of_strokes_where_there_are_any(exemplar: Image) -> None:
    along = np.full((30, 40), 1.2, np.float32)
    found = guide(exemplar, angle=0.5, size=(48, 64), target_angle=along)
    ratio = found.target[..., 2] / found.target[..., 1]
    np.testing.assert_allclose(ratio, np.tan(2.4), rtol=1e-3)
    free = guide(exemplar, angle=0.5, size=(48, 64), direction=0)
    assert free.exemplar.shape[2] == 1


def grown(exemplar: Image) -> tuple[GrowthGuide, Optimised]:
    trend = progression(exemplar, ProgressionParams())
    found = growth_guide(exemplar, trend.progression, trend.slow, GrowthGuideParams(size=(48, 160)))
    guides = {"exemplar_guide": found.exemplar, "target_guide": found.target}
    start = initialise(exemplar, InitialiseParams(size=None), np.random.default_rng(1), **guides)
    params = OptimiseParams(preset="fast", patch_size=6)
    return found, optimise(exemplar, start.match, params, np.random.default_rng(2), **guides)


def test_a_texture_ages_over_all_of_its_width(exemplar: Image) -> None:
    wanted, made = grown(exemplar)
    found = progression_in(made.image, exemplar)
    assert np.corrcoef(found.ravel(), wanted.wanted.ravel())[0, 1] > 0.8
    again = grown(exemplar)[1]
    np.testing.assert_array_equal(made.match, again.match)


def test_bad_curves_are_refused(exemplar: Image) -> None:
    for curve in ([0.5], [0, 1.5]):
        with pytest.raises(ValueError, match="curve"):
            guide(exemplar, curve=curve)


def test_pictures_show_the_trend(exemplar: Image) -> None:
    shown = guide(exemplar, size=(48, 64)).picture
    assert shown.pixels.shape == (48, 64, 3)
    assert shown.pixels[0, 0, 2] > shown.pixels[0, 0, 0]  # blue
    assert shown.pixels[0, -1, 2] < shown.pixels[0, -1, 0]  # yellow
    assert picture(shown.pixels).pixels.max() <= 1
