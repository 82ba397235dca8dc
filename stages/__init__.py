"""What texloom computes: kernels, analysis, synthesis, evaluation. Knows nothing of files, YAML or Prefect.

Every stage can be called by its name, with arrays and keyword arguments, see `texloom.stages.lookup.direct`:
``texloom.stages.quilting(rgb, size=(512, 512), seed=7)``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from texloom.stages.lookup.direct import DirectCall


def __getattr__(name: str) -> DirectCall:
    if name.startswith("_"):  # Python and its tools look for such names
        raise AttributeError(name)
    from texloom.stages.lookup.direct import direct_call

    globals()[name] = call = direct_call(name)
    return call


def __dir__() -> list[str]:
    from texloom.stages.lookup.registry import stage_names

    return sorted({*globals(), *(name.rpartition(".")[2] for name in stage_names())})
