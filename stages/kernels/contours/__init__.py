"""The forest that detects contours."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
