"""Scores, deformations and textons of a lattice."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
