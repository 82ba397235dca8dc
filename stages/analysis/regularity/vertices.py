"""Lattice vertices placed by hand: reading and checking their file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pydantic
from jaxtyping import Float64, Int64
from pydantic import Field

from texloom.stages.numerics.matrices import rank
from texloom.stages.vocabulary.declare import InputError, first_problem

_MAX_STEPS = 10_000  # larger step numbers are taken for mistakes
_MAX_PIXELS = 100_000.0  # as are positions that are farther than thrice the largest side of a picture

_StepNumber = Annotated[int, Field(ge=-_MAX_STEPS, le=_MAX_STEPS)]
_VertexPixels = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_MAX_PIXELS, le=_MAX_PIXELS)]
_Vector = tuple[_VertexPixels, _VertexPixels]


class _VerticesFile(pydantic.BaseModel, extra="forbid"):
    vertices: Annotated[list[tuple[_StepNumber, _StepNumber, _VertexPixels, _VertexPixels]], Field(min_length=1)]
    generators: tuple[_Vector, _Vector] | None = None

    @pydantic.model_validator(mode="after")
    def _is_a_lattice(self) -> "_VerticesFile":
        steps = [vertex[:2] for vertex in self.vertices]
        seen: dict[tuple[int, int], int] = {}
        for index, step in enumerate(steps):
            if (first := seen.setdefault(step, index)) != index:
                raise ValueError(f"vertices.{index} repeats step {list(step)} of vertices.{first}")
        if self.generators is None and rank(np.array([(*step, 1) for step in steps])) < 3:
            raise ValueError(
                "generators are missing, and fewer than three vertices are given, or they are collinear"
            )
        return self


@dataclass(frozen=True)
class Vertices:
    """Vertices of a lattice and their positions."""

    steps: Int64[np.ndarray, "n 2"]
    """of each vertex along the two generators"""
    places: Float64[np.ndarray, "n 2"]
    """px, row before column"""
    generators: Float64[np.ndarray, "2 2"] | None
    """px; None: those of the lattice fitted to the vertices"""

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Vertices":
        """The content of a file of vertices, see `read_vertices`; an `InputError` names what is wrong."""
        try:
            return _vertices(_VerticesFile.model_validate(content))
        except pydantic.ValidationError as error:
            raise InputError(f"vertices: {first_problem(error)}") from None


def read_vertices(path: Path) -> Vertices:
    """Read a file of vertices.

    It is JSON: ``{"generators": [[row, column], [row, column]], "vertices": [[i, j, row, column], ...]}``. A vertex
    is ``i`` steps along the first generator and ``j`` along the second from that of ``i = j = 0``, at ``row``,
    ``column`` px of the exemplar. ``generators`` may be omitted with three or more vertices that are not collinear.

    Raises
    ------
    InputError
        naming the file and the entry that is wrong.
    """
    try:
        return _vertices(_VerticesFile.model_validate_json(path.read_bytes()))
    except OSError as error:
        raise InputError(f"vertices: {path}: {error.strerror or 'cannot be read'}") from None
    except pydantic.ValidationError as error:
        raise InputError(f"vertices: {path}: {first_problem(error)}") from None


def _vertices(content: _VerticesFile) -> Vertices:
    table = np.array(content.vertices)
    generators = None if content.generators is None else np.array(content.generators)
    return Vertices(table[:, :2].astype(np.int64), table[:, 2:], generators)
