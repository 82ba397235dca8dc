"""Features that are matched."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
