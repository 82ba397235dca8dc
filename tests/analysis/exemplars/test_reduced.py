"""An exemplar at a smaller size."""

from __future__ import annotations

import numpy as np

from tests.synthetic import picture
from texloom.stages.analysis.exemplars.reduced import ReducedParams, outlines, reduced


def test_the_shorter_side_has_the_size(rng: np.random.Generator) -> None:
    image = picture(rng.random((96, 144)).astype(np.float32))
    made = reduced(image, ReducedParams(side=64)).image
    assert (made.height, made.width) == (64, 96)
    assert abs(float(made.pixels.mean() - image.pixels.mean())) < 0.01
    assert image.pixels.min() <= made.pixels.min() <= made.pixels.max() <= image.pixels.max()
    told = outlines(ReducedParams(side=64), {"image": image})["image"]
    assert (told.height, told.width) == (64, 96)


def test_a_small_one_remains(rng: np.random.Generator) -> None:
    image = picture(rng.random((48, 80)).astype(np.float32))
    assert reduced(image, ReducedParams(side=48)).image is image
