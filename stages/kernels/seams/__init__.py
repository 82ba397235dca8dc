"""Overlaps, minimum cuts and seam carving."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
