"""Inverse texture synthesis: trees of neighbourhoods and the solver."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
