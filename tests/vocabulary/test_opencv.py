"""Other distributions of OpenCV beside that of texloom."""

from __future__ import annotations

import importlib.metadata
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.common.geometry.orientation import smoothed
from texloom.stages.vocabulary import opencv
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def test_the_one_that_texloom_installs_will_do() -> None:
    assert opencv.problem() == ""
    assert opencv.WANTED in opencv.distributions()


def test_one_that_lies_over_it_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [("opencv_python", "4.14.0.90"), (opencv.WANTED, "5.0.0.93"), ("numpy", "2.4")]
    installed = [SimpleNamespace(name=name, version=version) for name, version in others]
    monkeypatch.setattr(importlib.metadata, "distributions", lambda: installed)
    monkeypatch.delattr(cv2, "ximgproc")
    grey = np.random.default_rng(1).random((48, 48), np.float32)
    for use in (
        lambda: edges(Image(grey[..., None], ("Y",)), EdgesParams()),
        lambda: smoothed(np.dstack([grey, grey]), np.dstack([grey] * 3), 1.0, 1.0),
    ):
        with pytest.raises(InputError) as caught:
            use()
        text = str(caught.value)
        assert f"OpenCV {cv2.__version__}, of opencv-python, which lies over" in text
        remedy = "pip uninstall -y opencv-python opencv-contrib-python-headless && pip install opencv-contrib"
        assert remedy in text
