"""Energy of compactions against their size, and the size beyond which more pixels gain little."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.analysis.similarity.k_coherence import Candidates
from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes
from texloom.stages.common.similarity.neighbourhoods import Rectangles, inside_of
from texloom.stages.evaluation._pages.plots import size_curves
from texloom.stages.synthesis.inverse.bound import mean_energy, patch_energy, way
from texloom.stages.synthesis.inverse.compact import CompactParams, compact
from texloom.stages.synthesis.inverse.crops import best_corner
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.size_search import knee
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.progress import part
from texloom.stages.vocabulary.sizes import format_size

_ROUNDS = 4  # of k-medoids
_CROP_SAMPLES, _FINALISTS = 512, 6  # effort of the search of the best crop


class EnergyCurveParams(Params):
    """The sizes, and how compactions are made."""

    least: int = Field(16, ge=8, le=2048)
    """side of the smallest compaction, px; all are square"""
    most: int = Field(128, ge=16, le=4096)
    """side of the largest, px; that of the texture where this is shorter"""
    sizes: int = Field(7, ge=3, le=50)
    """their number, evenly spaced in the logarithm"""
    alpha: float = Field(CompactParams.model_fields["alpha"].default, ge=1e-6, le=100)
    """weight of the forward term, see `compact`"""
    seams: float = Field(CompactParams.model_fields["seams"].default, ge=0, le=100)
    """weight of visible seams, see `compact`; not part of the energies of the curve"""
    toward_bound: float = Field(CompactParams.model_fields["toward_bound"].default, ge=0, lt=1)
    """how far below the best crop's energy compactions should be, see `compact`"""
    samples: int = Field(20_000, ge=100, le=2_000_000)
    """neighbourhoods of the texture over which an energy is averaged; a quarter as many of the compaction"""


@dataclasses.dataclass(frozen=True)
class EnergyCurve:
    """The curve."""

    table: dict[str, Any]
    """see `energy_curve`; ready for JSON"""
    figure: Image
    """plot of the curve with its knee"""


def check_sizes(params: EnergyCurveParams, known: Mapping[str, Any]) -> None:
    """The smallest compaction must be smaller than the largest that the texture allows."""
    texture = known.get("texture")
    if params.least >= params.most:
        raise InputError(f"energy_curve: least={params.least} px is not below most={params.most} px")
    if texture is not None and params.least >= min(texture.height, texture.width):
        raise InputError(
            f"energy_curve: least={params.least} px is not below the shorter side of texture, "
            f"{format_size(texture)}"
        )


@stage(version=3, check=check_sizes)
def energy_curve(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    nodes: Nodes,
    leaf: Leaf,
    candidates: Candidates,
    params: EnergyCurveParams,
    rng: np.random.Generator,
    rectangles: Rectangles | None = None,
) -> EnergyCurve:
    """Compact a texture to several sizes and plot the energy against the size, with the knee marked.

    Parameters
    ----------
    texture, features, nodes, leaf, candidates, rectangles : as for `compact`; with rectangles, of a family of
        textures in an atlas.

    Returns
    -------
    ``rows``: ``side`` and ``pixels`` of each size, ``energy`` and its weighted terms ``inverse`` and ``forward``,
    squared CIELAB units per pixel, and ``share``, the energy relative to its upper bound; inverse energies to
    compare with: ``crop``, of the best crop of that size (none where an atlas holds none), ``patches``, of as many
    separate neighbourhoods of the texture, and ``means``, of as many means of clusters, which are not real and
    shown only; ``way``, the share of the way from crop to patches; ``knee``: pixels of the size farthest below the
    straight line between both ends.

    Raises
    ------
    InputError : ``least`` is not below ``most`` or the texture's shorter side.

    Notes
    -----
    Energies are exact, from an exhaustive search. The upper bound is that of neighbourhoods at opposite corners of
    the box around all of them.

    References
    ----------
    [Wei2008]_ section 5, Figure 5.
    """
    most = min(params.most, texture.height, texture.width)
    sides = np.unique(np.rint(np.geomspace(params.least, most, params.sizes)).astype(int)).tolist()
    inside = inside_of(rectangles, texture.height, texture.width)
    exact = ExactEnergy(features, texture.height - leaf.shape[0] + 1, params.samples, inside)
    largest = (1 + params.alpha) * exact.largest()
    judge = ExactEnergy(features, exact.size, _CROP_SAMPLES, inside)
    rows = []
    seed = int(rng.integers(2**63))
    for number, side in enumerate(sides):
        options = CompactParams(
            size=(side, side), alpha=params.alpha, seams=params.seams, toward_bound=params.toward_bound
        )
        with part(number / len(sides), (number + 1) / len(sides)):
            compaction = compact(
                texture, features, nodes, leaf, candidates, options, np.random.default_rng(seed),
                rectangles=rectangles,
            )  # fmt: skip
        terms = exact.of(features[compaction.source[..., 0], compaction.source[..., 1]])
        energy = terms.energy(params.alpha)
        corner = best_corner(judge, (side, side), _FINALISTS)
        crop = None
        if corner is not None:
            row, column = corner
            crop = exact.inverse_of(np.ascontiguousarray(features[row : row + side, column : column + side]))
        patches = patch_energy(exact, nodes, leaf, side**2, _ROUNDS)
        rows.append(
            {
                "side": side, "pixels": side**2, "energy": energy, "inverse": terms.inverse,
                "forward": params.alpha * terms.forward, "share": energy / largest,
                "crop": crop, "patches": patches, "means": mean_energy(exact, nodes, leaf, side**2),
                "way": None if crop is None else way(terms.inverse, crop, patches),
            }
        )  # fmt: skip
    pixels = [float(row["pixels"]) for row in rows]
    table = {"rows": rows, "knee": rows[knee(pixels, [row["energy"] for row in rows])]["pixels"]}
    names = {name: name for name in ("energy", "inverse", "forward")}
    names |= {"crop": "best crop", "patches": "separate patches", "means": "means of patches"}
    curves = {
        title: [row[name] for row in rows]
        for name, title in names.items()
        if all(row[name] is not None for row in rows)
    }
    titles = ("energy, squared CIELAB units per pixel", "size of the compaction, px")
    return EnergyCurve(table, size_curves(pixels, curves, float(table["knee"]), titles, "px"))
