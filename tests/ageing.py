"""An exemplar that changes on its way from one side to the other."""

from __future__ import annotations

import numpy as np

from tests.synthetic import blobs, picture, smooth_noise
from texloom.stages.vocabulary.arrays import Image


def ageing(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Grey grain at the left; to the right ever more of it is under spots of rust."""
    grain, spots = blobs(shape, rng, 1.0), smooth_noise(shape, 1.5, rng)
    ranks = spots.ravel().argsort(kind="stable").argsort(kind="stable").reshape(shape) / spots.size
    rusty = (ranks < np.linspace(0, 1, shape[1]))[..., None]
    grey = (0.3 + 0.3 * grain)[..., None] * np.ones(3)
    rust = (0.2 + 0.2 * grain)[..., None] * np.array([1.6, 0.8, 0.4])
    return picture(np.where(rusty, rust, grey).astype(np.float32))
