"""Parts of a large picture with margins, each of which is worked on by itself."""

import itertools
from collections.abc import Iterator

import numpy as np

from texloom.stages.vocabulary.facts import Wraps

LARGEST_WHOLE = 4096**2
"""pixels of a picture that needs no parts"""

_SIDE = 2048  # px of the parts


def parts_with_margins(
    height: int, width: int, margin: int, wrap: Wraps
) -> Iterator[tuple[np.ndarray, np.ndarray, tuple[slice, slice]]]:
    """Rows and columns of each part with its margins, and where in these the part itself is."""

    def along(side: int, around: bool) -> Iterator[tuple[np.ndarray, slice]]:
        for first in range(0, side, _SIDE):
            last = min(first + _SIDE, side)
            start, stop = first - margin, last + margin
            if not around:
                start, stop = max(0, start), min(side, stop)
            yield np.arange(start, stop) % side, slice(first - start, last - start)

    for (rows, down), (columns, across) in itertools.product(along(height, wrap.down), along(width, wrap.across)):
        yield rows, columns, (down, across)
