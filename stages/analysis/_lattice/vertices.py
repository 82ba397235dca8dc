"""Lattice vertices placed by hand: reading and checking their file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.declare import InputError

_NAMES = ("generators", "vertices")
_MAX_STEPS = 10_000  # larger step numbers are taken for mistakes


@dataclass(frozen=True)
class Vertices:
    """Vertices of a lattice and their positions."""

    steps: Int64[np.ndarray, "n 2"]
    """of each vertex along the two generators"""
    places: Float64[np.ndarray, "n 2"]
    """px, row before column"""
    generators: Float64[np.ndarray, "2 2"] | None
    """px; None: those of the lattice fitted to the vertices"""


def _numbers(value: Any, count: int, name: str) -> list[float]:
    is_list = isinstance(value, list) and len(value) == count
    if not is_list or not all(type(number) in (int, float) and np.isfinite(number) for number in value):
        raise InputError(f"{name}: got {json.dumps(value)[:60]}, want {count} finite numbers")
    return [float(number) for number in value]


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
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"vertices: {path}: {error.strerror or 'cannot be read'}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"vertices: {path}: is not JSON: {str(error).splitlines()[0]}") from None
    try:
        return _parsed(content)
    except InputError as error:
        raise InputError(f"vertices: {path}: {error}") from None


def _parsed(content: Any) -> Vertices:
    if not isinstance(content, dict) or "vertices" not in content:
        raise InputError(
            'want {"generators": [[row, column], [row, column]], "vertices": [[i, j, row, column], ...]}'
        )
    if unknown := sorted(set(content) - set(_NAMES)):
        raise InputError(f"{unknown[0]}: no such entry; there is {', '.join(_NAMES)}")
    rows = content["vertices"]
    if not isinstance(rows, list) or not rows:
        raise InputError("vertices: want a list of [i, j, row, column]")
    table = np.array([_numbers(row, 4, f"vertices[{index}]") for index, row in enumerate(rows)])
    wrong = np.flatnonzero((table[:, :2] % 1 != 0).any(axis=1) | (np.abs(table[:, :2]) > _MAX_STEPS).any(axis=1))
    if wrong.size:
        raise InputError(
            f"vertices[{wrong[0]}]: i and j are steps, integers up to {_MAX_STEPS}, got {rows[wrong[0]][:2]}"
        )
    steps = table[:, :2].astype(np.int64)
    seen: dict[tuple[int, ...], int] = {}
    for index, step in enumerate(map(tuple, steps.tolist())):
        if (first := seen.setdefault(step, index)) != index:
            raise InputError(f"vertices[{index}]: repeats step {list(step)} of vertices[{first}]")
    generators = None
    if content.get("generators") is not None:
        pair = content["generators"]
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError("generators: want two of [row, column]")
        generators = np.array([_numbers(vector, 2, f"generators[{index}]") for index, vector in enumerate(pair)])
    elif len(table) < 3 or np.linalg.matrix_rank(np.column_stack([steps, np.ones(len(steps))])) < 3:
        raise InputError("generators: missing, and there are fewer than three vertices, or they are collinear")
    return Vertices(steps, table[:, 2:], generators)
