"""Editing by compaction: what was retouched in a small texture changes throughout the large one."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.analysis.similarity.k_coherence import Candidates, KCoherenceParams
from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes, TsvqParams
from texloom.stages.common.features.control import check_finite, from_painted, painted_values
from texloom.stages.common.grids.size_checks import check_row_length
from texloom.stages.common.similarity.neighbourhoods import inside_of
from texloom.stages.numerics.matrices import row_product
from texloom.stages.synthesis.inverse.level import Matching, TextureLevel, Tree
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)

_LEVEL = 1 / 255  # of an 8-bit file, in encoded values
_SIDE = 5  # px, of the neighbourhoods by which maps are found
_BLOCK = 512  # neighbourhoods compared with all others at a time


class PropagateEditParams(Params):
    """What counts as edited, and where an edit is applied."""

    threshold: float = Field(0.75, ge=0, le=64)
    """a pixel is edited if one of its values differs by more than this, in levels of an 8-bit file"""
    agreement: float = Field(0.5, gt=0, le=1)
    """share of the neighbourhoods over a pixel of the texture that must place it on an edited pixel; a lower value
    spreads edits farther"""
    maps: bool = True
    """where the edited picture lacks a map of the texture, an edited pixel takes the map's values from the place in
    the compaction that looks most like it, if one does"""


@dataclasses.dataclass(frozen=True)
class PropagateEdit:
    """The edited texture."""

    image: Image
    """the texture with all its channels; pixels that are not in ``mask`` are bit-identical to its"""
    compaction: Image
    """the edited compaction with all channels of the texture"""
    mask: Mask
    """the pixels of the texture that the edit changes"""
    share: float
    """of the texture's pixels that are changed, 0..1"""
    notes: list[str]
    """warnings about the edit, a sentence each"""


def check_edit(params: Any, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The edited picture must have the compaction's size and a channel of the texture."""
    texture, compaction, edited = (known.get(name) for name in ("texture", "compaction", "edited"))
    if isinstance(edited, Image):
        check_finite(edited, "edited")
    if compaction is not None and edited is not None:
        sizes = (compaction.height, compaction.width), (edited.height, edited.width)
        if sizes[0] != sizes[1]:
            raise InputError(f"edited: {format_size(sizes[1])}; the compaction has {format_size(sizes[0])}")
    if texture is not None and edited is not None and not set(texture.channels) & set(edited.channels):
        raise InputError(
            f"edited: channels {' '.join(edited.channels)}; none is one of the texture's, "
            f"{' '.join(texture.channels)}"
        )


@stage(version=1, check=check_edit)
def propagate_edit(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    nodes: Nodes,
    leaf: Leaf,
    candidates: Candidates,
    source: Correspondence,
    compaction: Image,
    edited: Image,
    params: PropagateEditParams,
) -> PropagateEdit:
    """Apply to a texture what was changed in its compaction.

    Each neighbourhood of the texture is matched with the most similar one of the compaction before the edit. A
    pixel of the texture changes by the mean difference, edited less original, of the compaction pixels that the
    neighbourhoods over it place it on: light in sRGB-encoded values, maps in their own.

    Parameters
    ----------
    texture, nodes, leaf, candidates : as for `compact`.
    features : what neighbourhoods are compared by; those of `compact`, or with the coarse colours of the texture,
        which tell places apart that look alike.
    source, compaction : the result of `compact` for these.
    edited : the compaction after the edit, from a lossless file; some or all of the texture's channels.

    Raises
    ------
    InputError
        ``edited`` is not of the compaction's size, has no channel of the texture or a value that is not finite.

    References
    ----------
    [Wei2008]_ section 7 suggests editing by propagation; the matches are those of equation (1).
    """
    whole, changed, notes = _whole_edit(compaction, edited, params)
    if not changed.any():
        notes.append("No pixel of the compaction was edited: the texture is unchanged.")
    for note in notes:
        _LOG.warning(note)
    delta = painted_values(whole) - painted_values(compaction)
    delta[~changed] = 0
    size = texture.height - leaf.shape[0] + 1
    check_row_length("propagate_edit", features.shape[2], size)
    level = TextureLevel(
        features, size, 1, Tree(nodes, leaf, candidates), TsvqParams(neighbourhood=size),
        KCoherenceParams(k=candidates.shape[2]), inside_of(None, texture.height, texture.width),
    )  # fmt: skip
    mean, share = _votes(level, source, delta, changed, compaction.wraps.both)
    mask = share >= params.agreement
    values = painted_values(texture)
    values[mask] += mean[mask]
    pixels = np.where(mask[..., None], from_painted(values, texture.channels).pixels, texture.pixels)
    return PropagateEdit(
        texture.with_pixels(np.ascontiguousarray(pixels, np.float32)), whole, mask, float(mask.mean()), notes
    )


def _votes(
    level: TextureLevel,
    source: Correspondence,
    delta: Float32[np.ndarray, "H W c"],
    changed: Bool[np.ndarray, "H W"],
    wrap: bool,
) -> tuple[Float32[np.ndarray, "h w c"], Float32[np.ndarray, "h w"]]:
    """Mean of ``delta`` over a texture pixel's edited matches, and their share of all its matches."""
    own = np.ascontiguousarray(np.moveaxis(source.astype(np.int32), 2, 0))
    matching = Matching(level, own, 0.01, 0.0, wrap=wrap)
    matching.match_inverse(matching.propose_by_centres(own[0].size))
    assert matching.inverse is not None
    rows, columns = matching.inverse
    (height, width), (down, across) = changed.shape, rows.shape
    total = np.zeros((level.height, level.width, delta.shape[2]), np.float32)
    edited = np.zeros((level.height, level.width), np.int32)
    count = np.zeros((level.height, level.width), np.int32)
    for y in range(level.size):
        for x in range(level.size):
            into = np.s_[y : y + down, x : x + across]
            at = (rows + y) % height, (columns + x) % width
            total[into] += delta[at]
            edited[into] += changed[at]
            count[into] += 1
    mean = total / np.maximum(edited, 1)[..., None].astype(np.float32)
    return mean, (edited / count).astype(np.float32)


def _whole_edit(
    compaction: Image, edited: Image, params: PropagateEditParams
) -> tuple[Image, Bool[np.ndarray, "H W"], list[str]]:
    """The edited compaction with all channels, its edited pixels, and notes."""
    planes = compaction.pixels.copy()
    given = [name for name in compaction.channels if name in edited.channels]
    for name in given:
        planes[..., compaction.channels.index(name)] = edited.pixels[..., edited.channels.index(name)]
    whole = compaction.with_pixels(planes)
    changed = np.abs(painted_values(whole) - painted_values(compaction)).max(axis=2) > params.threshold * _LEVEL
    whole.pixels[~changed] = compaction.pixels[~changed]
    missing = [index for index, name in enumerate(compaction.channels) if name not in given]
    notes: list[str] = []
    if missing and params.maps and changed.any():
        found = _lookalikes(whole, compaction, changed)
        rows, columns = np.nonzero(changed)
        known = found >= 0
        places = np.divmod(found[known], compaction.width)
        for index in missing:
            whole.pixels[rows[known], columns[known], index] = compaction.pixels[(*places, index)]
        if not known.all():
            notes.append(
                f"{(~known).mean():.0%} of the edited pixels look like nothing in the compaction: their maps stay."
            )
    return whole, changed, notes


def _lookalikes(whole: Image, compaction: Image, changed: Bool[np.ndarray, "H W"]) -> np.ndarray:
    """For each edited pixel the number of the pixel of the compaction whose surroundings look like its own.

    -1 where they look less like them than like the pixel's own before the edit.
    """
    before, after = (_surroundings(image) for image in (compaction, whole))
    numbers = np.flatnonzero(changed)
    lengths = (before**2).sum(axis=1)
    found = np.empty(numbers.size, np.int64)
    for first in range(0, numbers.size, _BLOCK):
        own = numbers[first : first + _BLOCK]
        # Whole numbers below 2^24, so that sums are exact in any order.
        distances = lengths - 2 * row_product(after[own], before.T)
        best = distances.argmin(axis=1)
        least = distances[np.arange(own.size), best] + (after[own] ** 2).sum(axis=1)
        change = ((after[own] - before[own]) ** 2).sum(axis=1)
        found[first : first + _BLOCK] = np.where(4 * least <= change, best, -1)
    return found


def _surroundings(image: Image) -> Float32[np.ndarray, "n values"]:
    """CIELAB of the pixels around each pixel, whole units, one pixel a row."""
    reach = _SIDE // 2
    planes = np.rint(np.clip(lab_from_linear(image.color), -128, 128))
    padded = np.pad(planes, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (_SIDE, _SIDE), axis=(0, 1))
    return np.ascontiguousarray(windows.reshape(image.height * image.width, -1), np.float32)
