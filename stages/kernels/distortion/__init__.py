"""Textures that are distorted in their picture."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
