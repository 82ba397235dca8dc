"""A frame stack that the code draws: a metal that rusts, sooner where a control map is high."""

from __future__ import annotations

import numpy as np

from tests.synthetic import picture, smooth_noise
from texloom.stages.vocabulary.arrays import Image

_METAL, _RUST, _SCALE = (
    np.array(color, np.float32) for color in ((0.3, 0.32, 0.36), (0.25, 0.07, 0.02), (0.06, 0.02, 0.01))
)


def aged(frames: int, side: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames in linear light, (side, side, 3), and the control map, (side, side)."""
    rng = np.random.default_rng(5)
    control = smooth_noise((side, side), side / 8, rng).astype(np.float32)
    spots = smooth_noise((side, side), 3.0, rng).astype(np.float32) - 0.5
    grain = 1 + 0.2 * (smooth_noise((side, side), 1.0, rng).astype(np.float32)[..., None] - 0.5)
    made = []
    for time in np.linspace(0, 1, frames, dtype=np.float32):
        age = 1.6 * time - (1 - control) + 0.3 * spots
        rust, scale = (np.clip(4 * (age - start), 0, 1)[..., None] for start in (0, 0.3))
        made.append((((1 - rust) * _METAL + rust * _RUST) * (1 - scale) + scale * _SCALE) * grain)
    return made, control


def stacked(frames: list[np.ndarray]) -> Image:
    """The frames as one image, as a source of a flow gives them."""
    names = [f"frame{number}." if number > 1 else "" for number in range(1, len(frames) + 1)]
    channels = tuple(f"{name}{channel}" for name in names for channel in picture(frames[0]).channels)
    return Image(np.concatenate([np.atleast_3d(frame) for frame in frames], axis=2), channels)
