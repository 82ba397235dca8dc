"""Parallel per-pixel synthesis on processors and GPUs."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
