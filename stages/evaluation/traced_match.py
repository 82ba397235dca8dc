"""Where a result comes from when its exemplar was a result itself."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import UInt32

from texloom.stages.vocabulary.arrays import Channels, Correspondence
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.sizes import format_size

_Former = Annotated[UInt32[np.ndarray, "rows columns 2"], Channels(("row", "column"))]


@dataclasses.dataclass(frozen=True)
class TracedMatch:
    """The correspondence with the first exemplar."""

    match: Correspondence
    """for every pixel of the result the pixel of the first exemplar that it comes from"""


@stage(version=1)
def traced_match(match: Correspondence, former: _Former | None = None) -> TracedMatch:
    """Trace the pixels of a result back to the first exemplar.

    Parameters
    ----------
    match : for every pixel of the result the pixel of its exemplar.
    former : for every pixel of that exemplar the pixel of the first; none where that is the first itself.

    Raises
    ------
    InputError : ``match`` points outside of ``former``.
    """
    if former is None:
        return TracedMatch(match)
    if (match >= former.shape[:2]).any():
        raise InputError(f"match: points outside of the {format_size(former.shape)} of former")
    return TracedMatch(np.ascontiguousarray(former[match[..., 0], match[..., 1]]))
