"""Compiled loops over triangles, and over texels beside chart borders."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
