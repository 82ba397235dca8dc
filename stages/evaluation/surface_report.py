"""A page about a textured surface: seams between charts, stretch, use of the exemplar."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32
from pydantic import Field

from texloom.stages.common.source_maps.exemplar_use import use_of_exemplar
from texloom.stages.common.surface.chart_seams import Pairs, neighbours
from texloom.stages.common.surface.faces import Faces
from texloom.stages.evaluation._pages import page
from texloom.stages.vocabulary.arrays import Correspondence, Image, Jacobian, Mesh, Page
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage

_CONTINUES = 1.5  # px of the exemplar by which neighbours may be off and still continue each other
_MAX_SAMPLED = 2**20  # pixels from which stretch is measured
_STRETCH = 2.0  # octaves to both sides that the map of stretch shows


class SurfaceReportParams(Params):
    """What the page shows."""

    largest: int = Field(2048, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the lossy compression of pictures"""


@dataclasses.dataclass(frozen=True)
class SurfaceReport:
    """The measures, as a table and on a page."""

    table: dict[str, dict[str, float]]
    """``seams``: mean difference of neighbours, CIELAB, and share that continue each other in the exemplar, across
    borders and inside charts, and the ratio of the differences; ``stretch``: px of the result along a px of
    texture, and ratio of the longer to the shorter axis; ``use``: share of the exemplar's pixels that are used"""
    page: Page
    """with all pictures inside; it needs no network"""


@stage(version=1)
def surface_report(
    mesh: Mesh,
    chart: Int32[np.ndarray, "*faces"],
    direction: Float32[np.ndarray, "corners 3"],
    texel_size: float,
    image: Image,
    match: Correspondence,
    jacobian: Jacobian,
    covered: Bool[np.ndarray, "H W"],
    exemplar: Image,
    views: Image,
    layout: Image,
    params: SurfaceReportParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> SurfaceReport:
    """Compare neighbouring pixels across the borders of charts with those inside, and show the texture.

    Differences are divided by the distances in texture, as pixels across a border are not exactly one pixel apart.

    Parameters
    ----------
    mesh, chart : see `surface_charts`.
    direction : see `surface_direction`.
    texel_size, image, match, jacobian, covered : the texture; see `on_surface`.
    exemplar : what it was made from.
    views : the mesh from several sides, see `surface_views`.
    layout : the charts, see `surface_charts`.
    provenance : the steps upstream.

    References
    ----------
    The measures are ours.
    """
    faces = Faces(mesh, direction, (image.height, image.width), texel_size)
    inside, across = neighbours(faces, chart)
    lab = lab_from_linear(image.color)
    within, beyond = _difference(lab, inside), _difference(lab, across)
    shape = (exemplar.height, exemplar.width)
    used = np.zeros(shape, bool)
    used[tuple(match[covered].astype(np.int64).T)] = True
    every = max(1, int(covered.sum()) // _MAX_SAMPLED)
    area, ratio = _stretch(jacobian[covered][::every].astype(np.float64))
    table = {
        "seams": {
            "across": beyond,
            "inside": within,
            "ratio": beyond / max(within, 1e-9) if len(across.one) else 1.0,
            "continued_across": _continued(match, across),
            "continued_inside": _continued(match, inside),
            "pairs_across": float(len(across.one)),
        },
        "stretch": {
            **{f"scale_{name}": float(np.quantile(area, q)) for name, q in _QUANTILES.items()},
            **{f"ratio_{name}": float(np.quantile(ratio, q)) for name, q in _QUANTILES.items()},
        },
        "use": {"used": float(used.mean())},
    }
    a, b, c, d = np.moveaxis(jacobian, 2, 0)
    density = np.where(covered, np.log2(np.abs(a * d - b * c)) / 2, np.float32(np.nan)).astype(np.float32)
    shown = {
        "exemplar": page.shown(exemplar, params.largest, params.quality),
        "texture": page.shown(image, params.largest, params.quality),
        "views": page.shown(views, params.largest, params.quality),
        "layout": page.shown(layout, params.largest, params.quality),
        "stretch": page.shown_field(density, 0.0, _STRETCH, params.largest),
        "use": page.shown_field(use_of_exemplar(match[covered][None], shape), 1.0, 1.0, params.largest),
    }
    made = page.render(page.template_of(__file__), "Texture on a mesh", provenance, False, table=table, shown=shown)
    return SurfaceReport(table, made.page)


_QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}


def _difference(lab: Float32[np.ndarray, "H W 3"], pairs: Pairs) -> float:
    """Mean difference for a px of texture."""
    if not len(pairs.one):
        return 0.0
    difference = np.linalg.norm(lab[tuple(pairs.one.T)] - lab[tuple(pairs.other.T)], axis=1)
    return float(difference.mean(dtype=np.float64) / np.linalg.norm(pairs.offset, axis=1).mean())


def _continued(match: Correspondence, pairs: Pairs) -> float:
    """Share of the pairs whose pixels of the exemplar are as far from each other as they are in texture."""
    if not len(pairs.one):
        return 1.0
    moved = match[tuple(pairs.other.T)].astype(np.float64) - match[tuple(pairs.one.T)]
    return float((np.abs(moved - pairs.offset).max(axis=1) <= _CONTINUES).mean())


def _stretch(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Geometric mean of the axes of each Jacobian, and the longer over the shorter."""
    a, b, c, d = jacobian.T
    area, total = np.abs(a * d - b * c), (jacobian**2).sum(axis=1)
    longer = np.sqrt((total + np.sqrt(np.maximum(total**2 - 4 * area**2, 0))) / 2)
    return np.sqrt(area), longer**2 / area
