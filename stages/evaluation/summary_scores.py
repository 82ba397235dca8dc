"""Scores of small pictures as summaries of a texture, and of its reconstruction."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes
from texloom.stages.common.similarity.patch_distance import blurred
from texloom.stages.evaluation._measures.table import Figures, table
from texloom.stages.synthesis.inverse.bound import mean_energy, patch_energy, way
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, OddSize, Params, stage
from texloom.stages.vocabulary.sizes import format_size

_WHAT = {
    "compaction": "Energy of the compaction: what it lacks of the texture, and what is foreign to the texture.",
    "crop": "Energy of the best crop of that size.",
    "seam_carving": "Energy of the texture carved to that size.",
    "epitome": "Energy of an epitome of that size.",
    "histogram": "Energy of a picture of that size that matches colour histograms alone.",
    "way": "How far the compaction gets from the best crop, 0, to as many separate patches of the texture, 1.",
    "reconstruction": "Mean distance of the pixels of reconstruction and texture, both blurred; CIELAB units.",
}
_ROUNDS = 4  # of k-medoids


class SummaryScoresParams(Params):
    """How energies and distances are measured."""

    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    alpha: float = Field(0.01, ge=1e-6, le=100)
    """weight of the forward term, see `compact`"""
    samples: int = Field(4096, ge=64, le=1 << 20)
    """maximum number of texture neighbourhoods that are matched; the forward term takes a quarter as many"""
    blur: float = Field(2.0, ge=0.3, le=50)
    """standard deviation of the blur before pixels are compared, px"""


@dataclasses.dataclass(frozen=True)
class SummaryScores:
    """Energies and scores."""

    table: dict[str, Any]
    """``summary``: score by axis; ``measures``: by name, see `summary_scores`. Ready for JSON"""


@stage(version=2)
def summary_scores(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: SummaryScoresParams,
    source: Correspondence | None = None,
    crop: Correspondence | None = None,
    carved: Correspondence | None = None,
    epitome: Float32[np.ndarray, "H W c"] | None = None,
    histogram: Correspondence | None = None,
    compaction: Image | None = None,
    reconstruction: Image | None = None,
    nodes: Nodes | None = None,
    leaf: Leaf | None = None,
) -> SummaryScores:
    """Score a compaction, and simpler pictures of its size, by one energy.

    ``compaction``, ``crop``, ``seam_carving``, ``epitome`` and ``histogram`` are energies in squared CIELAB units
    per pixel, from an exhaustive search; ``more`` has the two terms, the forward one unweighted. Score 0 is the
    energy of the texture's mean colour, 1 that of the texture itself, 0. ``reconstruction`` is a mean distance,
    scored likewise.

    Parameters
    ----------
    texture : the large texture.
    features : what neighbourhoods are compared by, CIELAB units; see `control_features`.
    source, crop, carved, histogram : the texture pixel under each pixel of what `compact`, `best_crop`,
        `seam_carving` and `histogram_summary` return.
    epitome : the means that `epitome` learned; an epitome wraps around.
    compaction : what `compact` returns; where it wraps, neighbourhoods across its border count.
    nodes, leaf : clusters of the texture's neighbourhoods, see `tsvq`; with them, ``source`` and ``crop`` the line
        ``way`` tells how far the compaction gets from the best crop, 0, to as many separate neighbourhoods of the
        texture as it has pixels, 1; ``more`` has their energies, and for comparison those of means of clusters.
    reconstruction : the texture synthesised from the compaction and the texture's control map, of the same size.

    Raises
    ------
    InputError
        the reconstruction is not of the texture's size.

    References
    ----------
    [Wei2008]_ equation (1), and Figures 2 to 4 for what it compares with.
    """
    shape = (texture.height, texture.width)
    if features.shape[:2] != shape:
        raise ValueError(f"summary_scores: features {features.shape} do not belong to a texture of {shape}")
    exact = ExactEnergy(features, params.neighbourhood, params.samples)
    worst = float(features.reshape(-1, features.shape[2]).var(axis=0, dtype=np.float64).sum())
    sources = {"compaction": source, "crop": crop, "seam_carving": carved, "histogram": histogram}
    planes = {
        name: features[places[..., 0], places[..., 1]] for name, places in sources.items() if places is not None
    }
    if epitome is not None:
        planes["epitome"] = epitome
    measured: dict[str, dict[str, Any]] = {}
    wraps = compaction is not None and compaction.wraps.both
    for name, summary in planes.items():
        is_torus = name == "epitome" or (name == "compaction" and wraps)
        extra = params.neighbourhood - 1 if is_torus else 0
        terms = exact.of(np.pad(summary, ((0, extra), (0, extra), (0, 0)), mode="wrap"))
        more = {"inverse": terms.inverse, "forward": terms.forward}
        measured[name] = Figures(terms.energy(params.alpha), 0.0, worst, more).line()
    if nodes is not None and leaf is not None and source is not None and crop is not None:
        count = source.shape[0] * source.shape[1]
        bound = patch_energy(exact, nodes, leaf, count, _ROUNDS)
        own, other = (measured[name]["more"]["inverse"] for name in ("compaction", "crop"))
        more = {"crop": other, "patches": bound, "means": mean_energy(exact, nodes, leaf, count)}
        share = way(own, other, bound)
        measured["way"] = Figures(share, 1.0, 0.0, more, score=min(max(share, 0.0), 1.0)).line()
    if reconstruction is not None:
        if (reconstruction.height, reconstruction.width) != shape:
            raise InputError(f"reconstruction: {format_size(reconstruction)}; the texture has {format_size(shape)}")
        measured["reconstruction"] = _difference(texture, reconstruction, params.blur).line()
    axes = {name: {"reconstruction": "likeness", "way": "bound"}.get(name, "energy") for name in measured}
    return SummaryScores(table({name: (axes[name], _WHAT[name]) for name in measured}, measured))


def _difference(texture: Image, other: Image, blur: float) -> Figures:
    """Mean CIELAB distance of two pictures' pixels."""
    one, two = (blurred(lab_from_linear(image.color), blur) for image in (texture, other))
    mean = one.mean(axis=(0, 1))
    distance, worst = (float(np.sqrt(((one - plain) ** 2).sum(axis=2)).mean()) for plain in (two, mean))
    return Figures(distance, 0.0, worst)
