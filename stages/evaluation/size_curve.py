"""Reconstruction error of a texture by the size of its compaction, and the size that was chosen."""

import dataclasses
from typing import Any

from texloom.stages.evaluation._pages.plots import size_curves
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage


class SizeCurveParams(Params):
    """None."""


@dataclasses.dataclass(frozen=True)
class SizeCurve:
    """The curve."""

    figure: Image
    """plot of the errors with the knee"""


@stage(version=1)
def size_curve(sizes: dict[str, Any], params: SizeCurveParams) -> SizeCurve:  # noqa: ARG001
    """Plot what `compact` chose the size `auto` by.

    Parameters
    ----------
    sizes : ``rows`` of ``share`` and ``error``, and ``knee``; see `compact`.

    References
    ----------
    [Wei2008]_ section 5 and Figure 5, which plots energies; errors of a reduced texture are ours.
    """
    shares, errors = ([row[name] for row in sizes["rows"]] for name in ("share", "error"))
    titles = ("reconstruction error, CIELAB units", "size of the compaction, % of the texture's pixels")
    figure = size_curves([100 * share for share in shares], {"error": errors}, 100 * sizes["knee"], titles, "%")
    return SizeCurve(figure)
