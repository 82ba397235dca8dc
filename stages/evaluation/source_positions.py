"""Source positions as colours."""

import dataclasses

import numpy as np

from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.sizes import format_size

_PLAIN = 0.35  # share of the exemplar's lightness in the key


@dataclasses.dataclass(frozen=True)
class SourcePositions:
    """Green is the bottom of the exemplar, most often the foreground, red its top; blue grows to the right."""

    image: Image
    """the result in these colours"""
    key: Image
    """the exemplar in these colours, mixed with its lightness"""


@stage(version=1)
def source_positions(image: Image, match: Correspondence) -> SourcePositions:
    """Colour every pixel of a result by its source position in the exemplar.

    Parameters
    ----------
    image : the exemplar.
    match : the exemplar pixel of every pixel of the result.

    Raises
    ------
    ValueError : ``match`` points outside the exemplar.

    References
    ----------
    [Eisenacher2008]_ Figure 18, whose map separates foreground and background; blue is ours.
    """
    if (match >= (image.height, image.width)).any():
        raise ValueError(f"match points outside an exemplar of {format_size(image)}")
    down = np.linspace(0, 1, image.height, dtype=np.float32)[:, None]
    across = np.linspace(0, 1, image.width, dtype=np.float32)[None]
    colors = np.stack(np.broadcast_arrays(1 - down, down, across), axis=2)
    tone = np.clip(image.color.mean(axis=2, keepdims=True), 0, 1)
    key = ((1 - _PLAIN) * colors + _PLAIN * tone).astype(np.float32)
    names = ("R", "G", "B")
    return SourcePositions(Image(colors[match[..., 0], match[..., 1]], names), Image(key, names))
