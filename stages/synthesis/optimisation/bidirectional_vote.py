"""The vote of bidirectional similarity: both the target's and the exemplar's patches vote."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int32

from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.vote import Window, vote_pixels, weights_along
from texloom.stages.vocabulary.facts import Wraps

ReversePatches: TypeAlias = Int32[np.ndarray, "2 h_places w_places"]

_STRIP = 256  # rows; sums are in double precision


def bidirectional_vote(
    match: Patches,
    reverse: ReversePatches,
    pixels: Float32[np.ndarray, "h w c"],
    window: Window,
    completeness: float,
    allowed: Bool[np.ndarray, "h_places w_places"] | None,
    wrap: Wraps,
) -> Float32[np.ndarray, "H W c"]:
    """The target of least bidirectional dissimilarity for given matches, [Simakov2008]_ section 3.

    Parameters
    ----------
    match : the exemplar patch of each target patch; they vote for coherence.
    reverse : the target patch of each exemplar patch; they vote for completeness.
    completeness : weight of all votes for completeness; that of all for coherence is 1 less it.
    allowed : the exemplar patches that vote for completeness; none for all.
    wrap : where the target wraps; along such an axis it has as many pixels as patches.
    """
    from texloom.stages.kernels.patchmatch.reverse_votes import ReverseVotes, reverse_vote_sums

    target = vote_pixels(match, pixels, window, wrap)
    if completeness == 0:
        return target
    height, width, channels = target.shape
    size, (patches_down, patches_across) = window.size, match.shape[1:]
    places = np.argwhere(np.ones(reverse.shape[1:], bool) if allowed is None else allowed)
    rows, columns = reverse[:, places[:, 0], places[:, 1]]
    order = np.argsort(rows, kind="stable")
    votes = ReverseVotes(
        row=places[order, 0].astype(np.int32),
        column=places[order, 1].astype(np.int32),
        target_column=columns[order].astype(np.int32),
        starts=np.searchsorted(rows[order], np.arange(patches_down + 1)).astype(np.int64),
        exemplar=np.ascontiguousarray(pixels.reshape(pixels.shape[0], -1)),
        channels=channels,
        wrap=wrap,
    )
    weights = window.astype(np.float64)
    down, across = map(weights_along, (patches_down, patches_across), (window, window), wrap)
    # Each term is a mean over its patches.
    forward_weight, reverse_weight = (1 - completeness) / match[0].size, completeness / len(places)
    lines = np.repeat(weights, channels)
    for top in range(0, height, _STRIP):
        count = min(_STRIP, height - top)
        sums = np.empty((count, (patches_across + size - 1) * channels))
        counts = np.empty((count, patches_across + size - 1))
        run_spans(reverse_vote_sums, (votes, weights, lines, top, sums, counts), count, 16)
        strip = target[top : top + count]
        own = forward_weight * np.outer(down[top : top + count], across)
        others = reverse_weight * counts[:, :width]
        total = own + others
        voted = reverse_weight * sums[:, : width * channels].reshape(count, width, channels)
        # Where coherence has no weight, pixels without a vote keep the coherent ones.
        known = total > 0
        voted += own[..., None] * strip
        strip[known] = voted[known] / total[known][:, None]
    return target
