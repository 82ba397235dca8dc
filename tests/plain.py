"""Runs of the two baselines of patch optimisation on small pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.optimisation.bidirectional import BidirectionalScale
from texloom.stages.synthesis.optimisation.image_melding import ImageMeldingScale
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.vocabulary.arrays import Image

SHAPE, SIZE = (40, 44), (56, 60)
"""an exemplar and a result, px"""


@dataclass(frozen=True)
class Baseline:
    """A stage that a test calls with few scales."""

    name: str
    start: str
    """method of `initialise` from which it starts"""
    state: type[Any]
    """what it saves after a scale"""

    def __call__(self, image: Image, start: np.ndarray | None = None, seed: int = 5, **options: Any) -> Any:
        inputs = {name: options.pop(name) for name in ("checkpoints",) if name in options}
        declared = find_stage(f"synthesis.{self.name}")
        params = declared.params(**{"preset": "fast", "coarsest": 24, **options})
        random = np.random.default_rng(seed)
        return declared.function(image, self.begin(image) if start is None else start, params, random, **inputs)

    def begin(self, image: Image) -> np.ndarray:
        """The start of a result of `SIZE`."""
        params = InitialiseParams(size=SIZE, method=self.start)
        return initialise(image, params, np.random.default_rng(3)).match


bidirectional = Baseline("bidirectional", "pixels", BidirectionalScale)
image_melding = Baseline("image_melding", "blocks", ImageMeldingScale)
BASELINES = (bidirectional, image_melding)


def distances(one: np.ndarray, other: np.ndarray, side: int = 6) -> float:
    """Mean squared distance of the patches of ``one`` to the most similar ones of ``other``, by brute force."""
    windows = [
        np.lib.stride_tricks.sliding_window_view(pixels, (side, side), axis=(0, 1)).reshape(-1, side * side * 3)
        for pixels in (one, other)
    ]
    products = windows[0] @ windows[1].T
    squares = [(window**2).sum(axis=1) for window in windows]
    return float(np.maximum(0, squares[0][:, None] - 2 * products + squares[1]).min(axis=1).mean())
