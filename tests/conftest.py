"""What all tests share: hypothesis draws the same examples every time and is not timed (kernels compile at first use)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("texloom", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("texloom")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20150501)
