"""The same results from a GPU as from the processor; here in the simulator of CUDA, so on very few pixels."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.arrays import Image, Jacobian
from texloom.stages.common.per_pixel import device as _device
from texloom.stages.common.per_pixel.device import Device, levels_on, on_gpu, target_on
from texloom.stages.common.per_pixel.levels import Levels, Rect, Style
from texloom.stages.common.per_pixel.phases import phases_of
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.declare import InputError
from texloom.stages.interactive.canvas import Canvas
from texloom.stages.synthesis.per_pixel import ArrangementParams, prepare

SHAPE = (24, 28)
STYLE = Style(
    key=2**64 - 5, jitter=(0.4, 0.9), passes=(1, 1), block=3, tries=5, coherence_bonus=20, control_bonus=12,
    tolerance=0.05
)  # fmt: skip


@pytest.fixture(autouse=True)
def _gpu() -> None:
    from numba import config, cuda

    if not (config.ENABLE_CUDASIM or cuda.is_available()):
        pytest.skip("neither a CUDA GPU nor the simulator (NUMBA_ENABLE_CUDASIM=1)")


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


def both(known: Tables, window: Rect, wrap: bool) -> list[Levels]:
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
    levels = both(tables(image), Rect(-3, 1, 1001, 1005), False)
    for part in levels:
        part.run()
    assert_same(levels)


@pytest.mark.parametrize("distorted", [False, True])
def test_what_repeats_is_the_same(image: Image, rng: np.random.Generator, distorted: bool) -> None:
    jacobian, chart = None, None
    if distorted:
        jacobian = (np.array([1, 0, 0, 1]) + rng.normal(0, 0.2, (*SHAPE, 4))).astype(np.float32)
        chart = rng.random((*SHAPE, 2), np.float32) * 50
    known = tables(image, jacobian=jacobian)
    levels = both(known, Rect(0, 8, 0, 8), True)
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
    levels = both(known, Rect(0, 8, 0, 8), True)
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


def test_a_canvas_stays_the_same_stroke_by_stroke(image: Image, control: Image, rng: np.random.Generator) -> None:
    stack = appearance_stack(image, AppearanceStackParams(coarsest=24))
    params = ArrangementParams(tolerance=0.3)
    values = rng.random((4, 20, 3), np.float32)
    canvases = [
        Canvas(image, control, (4, 20), values=values, params=params, stack=stack, tileable=True, device=device)
        for device in ("cpu", "gpu")
    ]
    before = canvases[0].match()
    np.testing.assert_array_equal(canvases[1].match(), before)
    for size, top, left in (((2, 2), 2, 18), ((2, 2), 2, 18)):
        dab = rng.uniform(-0.1, 1.1, (*size, 3)).astype(np.float32)
        dirty = [painted.paint(dab, top, left) for painted in canvases]
        expected = canvases[0].match()
        np.testing.assert_array_equal(canvases[1].match(), expected)
        np.testing.assert_array_equal(canvases[1].control(), canvases[0].control())
        np.testing.assert_array_equal(canvases[1].picture(Rect(1, 3, 2, 9)), canvases[0].picture()[1:3, 2:9])
        rows, columns = np.nonzero((expected != before).any(axis=2))
        ends = [int(end) for index in (rows, columns) for end in (index.min(), index.max() + 1)]
        assert dirty[1] == [Rect(*ends)]
        assert rows.size < before.size / 4
        before = expected
    assert canvases[1].paint(dab, top, left) == []


def test_the_device_is_chosen_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import config

    assert not on_gpu("cpu")
    assert on_gpu("gpu")
    monkeypatch.setenv("TEXLOOM_DEVICE", "gpu")
    assert on_gpu(None)
    assert not on_gpu("cpu")
    monkeypatch.setenv("TEXLOOM_DEVICE", "fast")
    with pytest.raises(InputError, match="TEXLOOM_DEVICE: got 'fast', want cpu, gpu or auto"):
        on_gpu(None)
    monkeypatch.delenv("TEXLOOM_DEVICE")
    assert not on_gpu(None)
    monkeypatch.setattr(config, "ENABLE_CUDASIM", 0)
    monkeypatch.setattr(_device, "find_spec", lambda name: None)
    assert not on_gpu("auto")
    with pytest.raises(
        InputError, match=r"device: gpu, but numba-cuda is not installed: pip install 'texloom\[gpu\]'"
    ):
        on_gpu("gpu")
    monkeypatch.setattr(_device, "find_spec", lambda name: importlib.util.find_spec("numba"))
    monkeypatch.setattr("numba.cuda.is_available", lambda: False)
    with pytest.raises(InputError, match="device: gpu, but there is no CUDA GPU that this process can use"):
        on_gpu("gpu")
