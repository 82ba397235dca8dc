"""A match of patches in an exemplar, which the tests of search and voting share."""

from collections.abc import Callable

import numpy as np
import pytest

SIZE, CHANNELS = 3, 3
PLACES, PATCHES = (30, 26), (80, 20)
"""exemplar patches, and target patches: rows enough for two strips of the search"""


def flat(pixels: np.ndarray) -> np.ndarray:
    """Rows of ``width * channels`` values."""
    return np.ascontiguousarray(pixels.reshape(pixels.shape[0], -1))


@pytest.fixture
def exemplar(rng: np.random.Generator) -> np.ndarray:
    """Smooth noise, so that some places are better than others: (h, w, c) int16."""
    pixels = rng.normal(0, 30, (PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1, CHANNELS)).cumsum(0).cumsum(1)
    return np.clip(pixels, -4000, 4000).astype(np.int16)


@pytest.fixture
def match(rng: np.random.Generator) -> np.ndarray:
    return np.stack([rng.integers(0, n, PATCHES) for n in PLACES]).astype(np.int32)


def outcomes(monkeypatch: pytest.MonkeyPatch, step: Callable[[], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What ``step`` gives with one thread and with two."""
    found = []
    for threads in "12":
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        found.append(step())
    return found[0], found[1]
