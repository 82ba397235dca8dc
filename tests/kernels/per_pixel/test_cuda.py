"""CUDA kernels against those for CPUs; in the simulator of CUDA, so on very few pixels."""

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from tests.wraps import X, Y
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.per_pixel.device import Device, levels_on, target_on
from texloom.stages.common.per_pixel.levels import Levels, Rect, Style
from texloom.stages.common.per_pixel.phases import phases_of
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.synthesis.per_pixel.per_pixel import prepare
from texloom.stages.vocabulary.arrays import Image, Jacobian
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

pytestmark = pytest.mark.usefixtures("gpu")

SHAPE = (24, 28)
STYLE = Style(
    key=2**64 - 5, jitter=(0.4, 0.9), passes=(1, 1), block=3, tries=5, coherence_bonus=20, control_bonus=12,
    tolerance=0.05
)  # fmt: skip


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((*SHAPE, 3), 1.5, rng))


@pytest.fixture
def control(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((*SHAPE, 3), 4.0, rng))


def tables(image: Image, control: Image | None = None, jacobian: Jacobian | None = None) -> Tables:
    """Of two levels."""
    stack = appearance_stack(
        image, AppearanceStackParams(coarsest=12, toroidal=jacobian is None, k=3), jacobian=jacobian
    )
    return prepare(image, stack, control, jacobian, 1.0)[0]


def both(known: Tables, window: Rect, wrap: Wraps) -> list[Levels]:
    devices: tuple[Device, ...] = ("cpu", "gpu")
    return [levels_on(device, known, STYLE, window, wrap) for device in devices]


def assert_same(levels: list[Levels]) -> None:
    """All places, and those of a part."""
    expected, found = (part.finest() for part in levels)
    np.testing.assert_array_equal(found, expected)
    assert len(np.unique(expected)) > expected.size / 4
    window = levels[0].window
    part = Rect(window.top + 1, window.bottom - 1, window.left + 2, window.right - 1)
    np.testing.assert_array_equal(levels[1].finest(part), expected[1:-1, 2:-1])


def test_a_window_is_the_same(image: Image) -> None:
    levels = both(tables(image), Rect(-3, 1, 1001, 1005), NOWHERE)
    for part in levels:
        part.run()
    assert_same(levels)


@pytest.mark.parametrize(("distorted", "wrap"), [(False, TORUS), (True, TORUS), (False, X), (False, Y)])
def test_what_repeats_is_the_same(image: Image, rng: np.random.Generator, distorted: bool, wrap: Wraps) -> None:
    jacobian, chart = None, None
    if distorted:
        jacobian = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.2, (*SHAPE, 4))).astype(np.float32)
        chart = rng.random((*SHAPE, 2), np.float32) * 50
    known = tables(image, jacobian=jacobian)
    levels = both(known, Rect(0, 8, 0, 8), wrap)
    generators = np.array([[5.3, 0.4], [-1.2, 6.1]], np.float32)
    for part in levels:
        if distorted:
            part.bend((np.array([1, 0.3, 0, 0.7]) + np.zeros((8, 8, 4))).astype(np.float32))
        part.repeat(phases_of(generators, known.shape, known.margin, chart))
        part.run()
    assert_same(levels)


def test_distorted_controlled_and_fixed_texture_is_the_same(
    image: Image, control: Image, rng: np.random.Generator
) -> None:
    jacobian = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.2, (*SHAPE, 4))).astype(np.float32)
    known = tables(image, control, jacobian)
    levels = both(known, Rect(0, 8, 0, 8), TORUS)
    bent = (np.array([1, 0.3, 0, 0.7]) + rng.normal(0, 0.2, (8, 8, 4))).astype(np.float32)
    fixed = np.zeros((8, 8), bool)
    fixed[2:4, 3:6] = True
    places = known.places_of(*rng.integers(2, 14, (2, 8, 8)))
    planes = rng.random((8, 8, 3), np.float32)
    for part in levels:
        part.bend(bent)
        part.pin(fixed, places)
        target_on(part, planes)
        part.run()
    assert_same(levels)
    np.testing.assert_array_equal(levels[1].finest()[fixed], places[fixed])
