"""Patch search and voting of texture optimisation."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
