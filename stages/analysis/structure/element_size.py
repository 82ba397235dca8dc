"""How large the elements of an exemplar are, such as stones."""

import numpy as np

from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.common.grids.border import Border
from texloom.stages.vocabulary.arrays import Image


def element_size(image: Image) -> float:
    """Side of the median whole element between closed contours, px; 0 where it does not consist of such."""
    cells = ContourCells(edges(image, EdgesParams()).strength, Border(1))
    return float(np.sqrt(np.median(cells.area[cells.whole]))) if cells.clear else 0.0
