"""Choice of the device, and an interactive canvas on a GPU; here in the simulator of CUDA."""

import importlib.util

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.per_pixel import device as _device
from texloom.stages.common.per_pixel.device import on_gpu
from texloom.stages.common.per_pixel.levels import Rect
from texloom.stages.interactive.canvas import Canvas
from texloom.stages.synthesis.per_pixel.per_pixel import ArrangementParams
from texloom.stages.vocabulary.declare import InputError

pytestmark = pytest.mark.usefixtures("gpu")


def test_a_canvas_stays_the_same_stroke_by_stroke(rng: np.random.Generator) -> None:
    image, control = (picture(smooth_noise((24, 28, 3), sigma, rng)) for sigma in (1.5, 4.0))
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
    monkeypatch.setattr("numba.cuda.is_available", _no_compiler)
    with pytest.raises(InputError, match=r"device: gpu, but CUDA does not work: OSError: no libnvvm\.so$"):
        on_gpu("gpu")
    assert not on_gpu("auto")


def _no_compiler() -> bool:
    raise OSError("no libnvvm.so\nsearched in /usr/lib")
