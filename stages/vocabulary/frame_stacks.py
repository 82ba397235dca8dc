"""Frame stacks: the pictures of a texture at several times as one image.

The channels of the first frame keep their names; those of frame 2 are called ``frame2.R``, ``frame2.G``, and so on.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from texloom.stages.vocabulary.arrays import Image

_LATER = re.compile(r"frame(\d+)\.(.+)")


def stack_channels(channels: Sequence[str], count: int) -> tuple[str, ...]:
    """The channels of a stack of ``count`` frames that have ``channels`` each."""
    later = [f"frame{number}.{name}" for number in range(2, count + 1) for name in channels]
    return (*channels, *later)


def frame_count(channels: Sequence[str]) -> int:
    """The number of frames in a stack; 1 of any other image."""
    last = _LATER.fullmatch(channels[-1])
    return int(last[1]) if last else 1


def name_in_frame(channel: str) -> str:
    """What a channel of a stack is called in its frame."""
    later = _LATER.fullmatch(channel)
    return later[2] if later else channel


def frames_of(image: Image) -> list[Image]:
    """The frames of a stack; any other image is its own only frame."""
    channels = len(image.channels) // frame_count(image.channels)
    return [
        image.with_pixels(image.pixels[..., first : first + channels], image.channels[:channels])
        for first in range(0, len(image.channels), channels)
    ]
