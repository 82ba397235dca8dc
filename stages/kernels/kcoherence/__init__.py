"""Candidate sets and discrete synthesis by k-coherence."""

import texloom.stages.kernels.core.numba_loading  # noqa: F401
