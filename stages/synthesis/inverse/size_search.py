"""How large a compaction should be: the knee of its reconstruction error, found on a reduced texture."""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams
from texloom.stages.analysis.similarity.tsvq import TsvqParams
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.similarity.neighbourhoods import inside_at
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.level import Matching, TextureLevel
from texloom.stages.synthesis.inverse.start import starts

_LONGEST = 160  # px of the reduced texture
_SHARES = tuple(2.0**exponent for exponent in (-6, -5.25, -4.5, -3.75, -3, -2.5, -2))
"""of the texture's pixels, a sixty-fourth to a quarter"""
_ITERATIONS = 4
_SAMPLES = 2048  # neighbourhoods over which an error is averaged
_STEP = 2  # px between those that a compaction is made for


def size_errors(
    features: Float32[np.ndarray, "h w c"],
    neighbourhood: int,
    inside: Bool[np.ndarray, "h w"],
    alpha: float,
    seams: float,
    block: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Reconstruction errors of quick compactions of a reduced texture, and the share of pixels at their knee.

    Returns
    -------
    ``rows``: ``share`` of the texture's pixels and ``error``, the root mean squared distance of the texture's
    neighbourhoods from the most similar ones of the compaction, CIELAB units a pixel; an error is no higher than
    those of smaller sizes. ``knee``: see `knee`. All but the first sizes have sides of two neighbourhoods or more.
    """
    factor = min(1.0, _LONGEST / max(features.shape[:2]))
    shape = (round(features.shape[0] * factor), round(features.shape[1] * factor))
    level = TextureLevel(
        resize(features, *shape), neighbourhood, _STEP, None,
        TsvqParams(neighbourhood=neighbourhood, max_samples=1 << 14), KCoherenceParams(), inside_at(inside, *shape),
    )  # fmt: skip
    exact = ExactEnergy.of_level(level, _SAMPLES)
    aspect = shape if inside.all() else (min(shape), min(shape))
    pixels = level.inside.sum()
    rows: list[dict[str, Any]] = []
    for share in _SHARES:
        scale = math.sqrt(share * pixels / math.prod(aspect))
        size = (min(round(aspect[0] * scale), shape[0]), min(round(aspect[1] * scale), shape[1]))
        if min(size) < 2 * neighbourhood and share < _SHARES[-3]:
            continue
        size = (max(size[0], neighbourhood), max(size[1], neighbourhood))
        (source,) = starts(level, size, block, "cover", seams, 0.0, False, rng)
        matching = Matching(level, source, alpha, seams)
        for _ in range(_ITERATIONS):
            matching.match_inverse(matching.propose_by_centres(math.prod(size)))
            matching.match_forward_by_coherence()
            matching.choose()
        error = math.sqrt(exact.inverse_of_values(matching.values))
        rows.append({"share": share, "error": min([error, *(row["error"] for row in rows)])})
    return {
        "rows": rows,
        "knee": rows[knee([row["share"] for row in rows], [row["error"] for row in rows])]["share"],
    }


def knee(sizes: list[float], errors: list[float]) -> int:
    """Number of the size at which the curve is farthest below the straight line between its ends."""
    across = np.array(sizes, np.float64) - sizes[0]
    down = np.array(errors, np.float64) - errors[0]
    if not across[-1]:
        return 0
    return int((across / across[-1] * down[-1] - down).argmax())
