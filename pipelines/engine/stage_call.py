"""One call of a stage: its result is compared with what it declares, and nothing that it raises ends the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from texloom.pipelines.errors import one_line, shown
from texloom.pipelines.store.outputs import Array, Outputs, prepared
from texloom.pipelines.store.types import hints_of
from texloom.stages.vocabulary.declare import Stage
from texloom.stages.vocabulary.interruption import raised_by_code


class StageError(Exception):
    """A stage has broken its contract, by its result or by ending the program."""

    def __repr__(self) -> str:
        return str(self)


def call_stage(stage: Stage, arguments: Mapping[str, Any]) -> Outputs:
    """The prepared outputs of a stage.

    Raises
    ------
    StageError : its result is not what it declares; or it called ``sys.exit`` or raised KeyboardInterrupt.
    """
    try:
        result = stage.function(**arguments)
    except (SystemExit, KeyboardInterrupt) as error:
        if not raised_by_code(error):
            raise
        call = f"sys.exit({error.code!r})" if isinstance(error, SystemExit) else type(error).__name__
        raise StageError(one_line(f"{_name(stage)} ended by {call}, which only a program may do")) from None
    if not isinstance(result, stage.result):
        problem = f"returned {type(result).__name__} {shown(result)}, declared is {stage.result.__name__}"
        raise StageError(one_line(f"{_name(stage)} {problem}"))
    outputs = Outputs(stage.result)
    for name, hint in hints_of(stage.result).items():
        try:
            value = getattr(result, name)
            if isinstance(value, np.ma.MaskedArray):
                raise TypeError("a masked array, whose mask would be lost, came")
            outputs[name] = prepared(value, hint)
        except AttributeError:
            raise StageError(
                one_line(f"{_name(stage)}: output '{name}': nothing came, declared is {hint}")
            ) from None
        except (TypeError, ValueError, RecursionError) as error:
            problem = f"output '{name}': {error}; declared is {hint}"
            raise StageError(one_line(f"{_name(stage)}: {problem}")) from None
        if stage.origin and _lacks_numbers(outputs[name]):
            problem = f"output '{name}': has values that are NaN or infinite; declared is {hint}"
            raise StageError(one_line(f"{_name(stage)}: {problem}"))
    return outputs


def _name(stage: Stage) -> str:
    return f"stage {stage.name} of {stage.origin}" if stage.origin else f"stage {stage.name}"


def _lacks_numbers(output: Any) -> bool:
    """Whether it is an image with values that are not finite; those of texloom's own stages are tested to be."""
    return isinstance(output, Array) and output.layout.is_image and not np.isfinite(output.values).all()
