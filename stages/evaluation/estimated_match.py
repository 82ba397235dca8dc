"""Where the pixels of a picture come from, estimated from the pixels."""

import dataclasses

import numpy as np
from jaxtyping import Int64, UInt32
from pydantic import Field

from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.core.threads import run_all, run_spans, spans
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import OddSize, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import count_excluded, fill_excluded, valid_pixels

_STRIP = 32  # rows that are searched one after the other
_SETTLED = 0.001  # share of changed matches below which the search ends
_NOTICEABLE = 2.3  # CIELAB units, a just noticeable difference
_CONTRAST = 0.2  # largest difference of a copy, relative to the exemplar's standard deviation


class EstimatedMatchParams(Params):
    """The search."""

    patch_size: OddSize = 7
    """side of the patches that are searched, px; smaller copied pieces are not recognised"""
    sweeps: int = Field(24, ge=1, le=200)
    """maximum number of scans over the picture"""
    tries: int = Field(4, ge=1, le=64)
    """random patches that are tried for each patch in each scan"""


@dataclasses.dataclass(frozen=True)
class EstimatedMatch:
    """The estimated source map."""

    match: Correspondence
    """for every pixel of the picture an exemplar pixel that it may come from"""
    copies: Mask
    """true where a patch about the pixel is that of its source: the pixel is a copy"""


@stage(version=1)
def estimated_match(exemplar: Image, image: Image, params: EstimatedMatchParams) -> EstimatedMatch:
    """Estimate the source map of a picture that another program made from the exemplar.

    For every patch of the picture the most similar patch of the exemplar is sought by PatchMatch. Where pieces were
    copied, all their patches find themselves. Each pixel takes the displacement of the most similar of the patches
    that cover it, so that pieces reach up to their joints. In exemplars of one colour, or in pictures that were
    scaled, turned or recoloured, ``copies`` is false, and ``match`` is the most similar place.

    A pixel is a copy where the root mean square difference of its patch, CIELAB units, is at most 2.3 and at most a
    fifth of the exemplar's standard deviation.

    Parameters
    ----------
    exemplar, image : the texture and the picture, of any sizes; only their colour counts. Masked pixels of the
        exemplar are no source.

    References
    ----------
    The search is [Barnes2009]_ section 3. The rest is ours.
    """
    usable = valid_pixels(exemplar)
    own, made = (lab_from_linear(fill_excluded(one).color) for one in (exemplar, image))
    size = min(params.patch_size, *own.shape[:2], *made.shape[:2])
    whole = None if usable is None else count_excluded(usable, size, size) == 0
    if whole is not None and not whole.any():
        size, whole = 1, usable
    row, column, distance = _search(own, made, size, whole, params)
    match, least = _pixels(row, column, distance, size)
    colors = own.reshape(-1, 3) if usable is None else own[usable]
    deviation = float(np.sqrt(colors.var(axis=0, dtype=np.float64).sum()))
    limit = min(_NOTICEABLE, _CONTRAST * deviation)
    return EstimatedMatch(
        match, least <= (limit * UNIT * size) ** 2 if deviation > 0 else np.zeros(least.shape, bool)
    )


def _search(
    exemplar: np.ndarray, image: np.ndarray, size: int, whole: Mask | None, params: EstimatedMatchParams
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column of the most similar exemplar patch of every patch, and their squared distances."""
    from texloom.stages.kernels.patchmatch.search import (
        ALL_ACTIVE,
        PatchShape,
        Scan,
        SearchedExemplar,
        Target,
        match_distances,
        sweep,
    )

    rng = np.random.default_rng(7)
    places, patches = (tuple(side - size + 1 for side in part.shape[:2]) for part in (exemplar, image))
    free = np.arange(places[0] * places[1]) if whole is None else np.flatnonzero(whole)
    start = np.divmod(free[rng.integers(0, len(free), patches)], places[1])
    row, column = (part.astype(np.int32) for part in start)
    source = fixed_point(exemplar)
    shape = PatchShape.of(size, 3)
    target = Target(
        fixed_point(image), row, column, np.empty(patches, np.int64), np.full(patches, ALL_ACTIVE, np.uint8)
    )
    run_spans(match_distances, (shape, target, source), patches[0], 16)
    # every patch is free; masked ones cost more than any distance
    penalty = np.zeros(places, np.float32)
    if whole is not None:
        penalty[~whole] = 2**60
    none = np.zeros(1, np.int32)
    own = SearchedExemplar(source, penalty, np.int64(0), np.int64(0), none, none)
    # strips of one parity are searched together while those between them do not change
    strips = spans(patches[0], max(1, patches[0] // _STRIP))
    radii = np.full(params.tries, max(places))
    for number in range(params.sweeps):
        scan = Scan(number % 2 == 0, NOWHERE, radii, np.int64(0), 0, rng.integers(2**64, dtype=np.uint64), True)
        changed = 0
        for phase in (strips[0::2], strips[1::2]):
            swept = run_all(sweep, [(shape, target, own, scan, *span) for span in phase])
            changed += sum(len(moves) for moves, _ in swept)
        if changed <= _SETTLED * row.size:
            break
    return row, column, target.distance


def _pixels(
    row: np.ndarray, column: np.ndarray, distance: np.ndarray, size: int
) -> tuple[UInt32[np.ndarray, "H W 2"], Int64[np.ndarray, "H W"]]:
    """The source of each pixel by the most similar of the patches that cover it, and that patch's distance.

    Of patches that are equally similar, the one whose middle is nearest counts.
    """
    height, width = row.shape
    shape = (height + size - 1, width + size - 1)
    least = np.full(shape, np.iinfo(np.int64).max)
    match = np.empty((*shape, 2), np.uint32)
    middle = size // 2
    offsets = sorted(np.ndindex(size, size), key=lambda at: (at[0] - middle) ** 2 + (at[1] - middle) ** 2)
    for down, across in offsets:
        here = np.s_[down : down + height, across : across + width]
        better = distance < least[here]
        np.copyto(least[here], distance, where=better)
        np.copyto(match[..., 0][here], (row + down).astype(np.uint32), where=better)
        np.copyto(match[..., 1][here], (column + across).astype(np.uint32), where=better)
    return match, least
