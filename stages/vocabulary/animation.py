"""Animated previews of frame stacks."""

import io
from collections.abc import Sequence

import numpy as np

FRAME_SECONDS = 0.1
"""how long a frame is shown"""
_QUALITY = 90


def animated_webp(levels: Sequence[np.ndarray]) -> bytes:
    """An endless animation of 8-bit pictures, (h, w, 3) in sRGB; one picture stays still."""
    import PIL.Image

    first, *others = map(PIL.Image.fromarray, levels)
    buffer = io.BytesIO()
    first.save(
        buffer, "WEBP", save_all=True, append_images=others, duration=round(1000 * FRAME_SECONDS), loop=0,
        quality=_QUALITY,
    )  # fmt: skip
    return buffer.getvalue()
