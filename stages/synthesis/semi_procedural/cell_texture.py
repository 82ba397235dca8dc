"""The cells of an exemplar's lattice as shaders lay them: their contents, window function, and choice."""

import dataclasses
import logging
import math
from typing import Any

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.analysis.regularity.deformed_lattice import Points, Steps
from texloom.stages.analysis.regularity.straighten import Positions, straighten
from texloom.stages.kernels.core.elementary_functions import cos, log, sin
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import (
    CellOutline,
    cell_outline,
    course_outline,
)
from texloom.stages.synthesis.near_regular.course_cells import course_cells
from texloom.stages.synthesis.near_regular.lattice_tiles import Window, whole
from texloom.stages.synthesis.near_regular.tile_set import TileSource
from texloom.stages.synthesis.semi_procedural.cell_contents import CellContents
from texloom.stages.synthesis.semi_procedural.cell_tiling import GROUPS, CellTiling
from texloom.stages.synthesis.semi_procedural.cell_window import reach, window_of
from texloom.stages.synthesis.semi_procedural.course_runs import STRETCH, course_runs
from texloom.stages.synthesis.stitching.exemplar import Exemplar, lab_of
from texloom.stages.vocabulary.arrays import Image, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, NoParams, Params, stage
from texloom.stages.vocabulary.masks import without_usable

_LOG = logging.getLogger(__name__)

_FEWEST = 4  # cells
_FEW = 12  # cells, of which fewer are seen to return
_MOST = 128  # cells
_MOST_PIXELS = 1 << 24  # of a sheet
_SMALLEST = 64.0  # px of a cell's area
_WIDEST = 0.2  # band, as a share of the shorter generator
_AGREED = 1.0  # px
_SIDE = 384  # px of the plane that is measured
_ALIKE = 0.15  # variance that cells share, from which they are laid: 16 photographs have 0.29 to 0.95, noise has 0
_ADVICE = "the flow wang_tiles keeps its structure"


class CellTextureParams(Params):
    """How cells are joined, and what happens where they are not alike."""

    band: float = Field(0.0, ge=0, le=_WIDEST)
    """half the width of the band in which neighbouring cells are blended, as a share of the shorter generator; 0:
    as far as the cells of the exemplar are alike around their joints"""
    accept: bool = False
    """go on with a lattice whose cells are not alike"""


@dataclasses.dataclass(frozen=True)
class CellTexture:
    """What a shader samples."""

    image: Image
    """a sheet of boxes around the cells"""
    window: ScalarMap
    """weight of a cell around its point of the lattice, 0..1"""
    layout: dict[str, Any]
    """`size` of the sheet, and `unit`, that of the exemplar (width, height, px); `generators` (rows and columns,
    px) and their `inverse`; `corner` of the window from its point; `low` and `candidates`: the least step from a
    point whose cell reaches a place, and how many may; `along`, and `shift` of rows along it: mean, spread, length,
    px; `cells` of the sheet, its `columns`, the `box` of each and its `point` in it, px; `groups`, `band` (px);
    `alike`, the share of their variance that cells have in common, and `joints`, the contrast where they are
    blended over theirs"""


@stage(version=1)
def cell_texture(
    image: Image,
    generators: Vectors,
    steps: Steps,
    vertices: Points,
    params: CellTextureParams,
    courses: bool = False,
    found: Vectors | None = None,
) -> CellTexture:
    """Cut a near-regular exemplar into the cells of its lattice, from which shaders lay a plane without end.

    The exemplar is straightened to a lattice of whole pixels, with the usual steps of its own. The outline of a
    cell runs where a joint of two cells would show least: where they are alike, or beside contours, as of
    bricks. A plane has at each point of the lattice one of the cells, drawn by a hash of its number, and
    blended with its neighbours across the outline. Around joints all cells get the same slow tone. Courses
    whose elements are equally long have a phase of their own in each, as in the exemplar. Where elements differ
    in length, cells are runs of them from joint to joint, which are stretched to one length by 10 % at most, and
    lie at any place of a course.

    Parameters
    ----------
    image : the exemplar; all maps are cut together.
    generators, steps, vertices, courses : its lattice, see `deformed_lattice`.
    found : the lattice of `lattice_selection`, which is more exact where the vertices nearly agree with it.

    Raises
    ------
    InputError
        fewer than four cells are shown whole; elements of courses are not equally long, and have few clear joints;
        or cells, of runs their ends, have less than
        0.15 of their variance in common, and ``accept`` is false.

    References
    ----------
    [Guehl2020]_: a structure that is computed, with details of an exemplar. Of the paper's functions there are the
    point process, which is the exemplar's lattice, or its courses with a jitter along them, and the window around
    each point, whose outline is the exemplar's. The paper fits parameters to a binary structure, and synthesises
    colours by numbers; here a cell shows one of the exemplar's, since a shader can look that up. Points that lie at
    random, as of pebbles, are not written: cells of the exemplar would have to be cut to other shapes. The joints
    of one tone are ours.
    """
    if len(generators) != 2:
        raise InputError(f"generators: the exemplar shows no lattice; {_ADVICE}")
    frame = _frame(generators, steps, vertices, found)
    if abs(determinant(frame)) < _SMALLEST:
        raise InputError(f"generators: cells of less than {_SMALLEST:g} px are too small; {_ADVICE}")
    straight, points = _straightened(image, steps, vertices.astype(np.float64), frame)
    exemplar = Exemplar(image, lab_of, 100.0, {})
    image = without_usable(image)
    source = TileSource(exemplar, straight)
    shift, runs = [0, 0, 1], None
    if courses:
        strip = course_outline(source.features, source.valid, points, frame)
        elements = course_cells(source.features, source.valid, points[0], strip)
        runs = course_runs(source.features, source.valid, points[0], strip) if elements is None else None
        if elements is not None:
            points, frame = elements.vertices, np.rint(elements.outline.generators)
            outline = CellOutline.rectangle(frame, elements.outline.phase or (0.0, 0.0))
            shift = _shift(elements.shifts, round(float(np.hypot(*frame[1]))))
        elif runs is not None:
            outline, frame = runs.outline, runs.outline.generators
            length = round(float(np.hypot(*frame[1])))
            shift = [0, length, length]
        else:
            raise InputError(
                "image: its courses have elements of different lengths, with too few clear joints between them; "
                f"{_ADVICE}"
            )
    else:
        outline = cell_outline(source.features, source.valid, points, frame, 1.0)
    short = float(np.hypot(*frame.T).min())
    around = Window.of(outline, _WIDEST * short)
    if runs is not None:
        positions, points = runs.laid_out(straight, around, _MOST_PIXELS)
        source = TileSource(exemplar, positions)
        _LOG.warning(
            "its courses have blocks of different lengths: cells are runs of them, %d px long to %.0f %%",
            length, 100 * STRETCH,
        )  # fmt: skip
    points = np.rint(points)
    points = points[whole(around, points, np.eye(2), source.valid, 0)]
    if len(points) < _FEWEST:
        raise InputError(f"image: it shows {len(points)} whole cells, fewer than {_FEWEST}; {_ADVICE}")
    contents = CellContents.of(source, around, points.astype(np.int64), short)
    contents = contents.fitting(min(_MOST, max(_FEWEST, _MOST_PIXELS // contents.depth.size)))
    alike = contents.alike if runs is None else contents.alike_at_ends(frame[1])
    if alike < _ALIKE and not params.accept:
        raise InputError(
            f"image: cells of its lattice are not alike: they have {alike:.2f} of their variance in common, less "
            f"than {_ALIKE}; {_ADVICE}, --set accept=true goes on"
        )
    contents = contents.with_even_joints(image.channels)
    band = params.band * short or contents.band(around.band)
    window, corner = window_of(outline, max(1.0, band))
    contents = contents.cropped(corner, window.shape)
    low, candidates = reach(window, corner, frame)
    groups = GROUPS if len(contents.pixels) >= 4 * GROUPS else 1
    cells = len(contents.pixels) // groups * groups
    sheet, columns = _sheet(contents.pixels[:cells])
    layout = {
        "size": [sheet.shape[1], sheet.shape[0]], "unit": [image.width, image.height],
        "generators": frame.astype(int).tolist(),
        "inverse": inverse_of(frame).astype(np.float32).tolist(), "corner": corner.tolist(),
        "low": low, "candidates": candidates, "shift": shift,
        "along": (frame[1] / np.hypot(*frame[1])).astype(np.float32).tolist(), "cells": cells,
        "columns": columns, "box": list(contents.depth.shape), "point": (-contents.first).tolist(),
        "groups": groups, "band": band, "alike": alike,
    }  # fmt: skip
    made = image.elsewhere(sheet)
    layout["joints"] = _joints_of(CellTiling.of(made, window, layout))
    if cells < _FEW:
        _LOG.warning("the exemplar shows %d cells that fit to each other: they are seen to return", cells)
    return CellTexture(made, window, layout)


def _joints_of(tiling: CellTiling) -> float:
    """Contrast where cells are blended: mean gradient of lightness there over that of the cells themselves."""
    rows, columns = (one.astype(np.float32) for one in np.mgrid[:_SIDE, :_SIDE])
    most, down, across = (np.zeros(rows.shape, np.float32) for _ in range(3))
    for weight, y, x in tiling.covering(rows, columns):
        more = weight > most
        most, down, across = (np.where(more, one, old) for one, old in ((weight, most), (y, down), (x, across)))
    zone = (most < 0.95)[1:-1, 1:-1]
    plane = _gradient(tiling, tiling.pixels(rows, columns))[zone]
    at = tuple(np.rint(one[1:-1, 1:-1][zone]).astype(np.int64) - 1 for one in (down, across))
    alone = _gradient(tiling, tiling.pyramid[0])[at]
    return float(plane.mean(dtype=np.float64) / max(float(alone.mean(dtype=np.float64)), 1e-9))


def _gradient(tiling: CellTiling, pixels: np.ndarray) -> np.ndarray:
    count = 1 if tiling.channels[0] == "Y" else 3
    light = np.sqrt(np.maximum(pixels[..., :count].mean(axis=2), 0))
    return np.asarray(np.hypot(light[2:, 1:-1] - light[:-2, 1:-1], light[1:-1, 2:] - light[1:-1, :-2]))


def _frame(
    generators: Vectors, steps: Steps, vertices: Points, found: Vectors | None
) -> Float64[np.ndarray, "2 2"]:
    """The generators of the plane, whole px: those that were found, or else the usual steps between vertices.

    The lattice that fits all vertices best is narrower where a few steps in the middle are.
    """
    if found is not None and len(found) == 2 and bool((np.abs(found - generators) <= _AGREED).all()):
        return np.rint(found).astype(np.float64)
    places = {tuple(step): place for step, place in zip(steps.tolist(), vertices.astype(np.float64), strict=True)}
    usual = generators.astype(np.float64)
    for axis, (down, across) in enumerate(((1, 0), (0, 1))):
        pairs = [(place, places.get((i + down, j + across))) for (i, j), place in places.items()]
        between = [other - place for place, other in pairs if other is not None]
        if between:
            usual[axis] = np.median(between, axis=0)
    return np.asarray(np.rint(usual))


def _straightened(
    image: Image, steps: Steps, vertices: Float64[np.ndarray, "vertices 2"], frame: Float64[np.ndarray, "2 2"]
) -> tuple[Positions, Float64[np.ndarray, "vertices 2"]]:
    """Where in the exemplar pixels of one with vertices on a lattice of generators ``frame`` are, and vertices."""
    regular = matrix_product(steps, frame)
    regular = regular + np.rint(np.median(vertices - regular, axis=0))
    straight = straighten(image, vertices.astype(np.float32), regular.astype(np.float32), NoParams())
    return straight.source, regular


def _shift(shifts: Float64[np.ndarray, "pairs"], length: int) -> list[int]:  # type: ignore[name-defined]
    """Mean and spread of the shifts from course to course, shares of a length, on a circle; px."""
    angles = 2 * np.pi * shifts
    x, y = (float(np.asarray(turn(angles)).mean()) if len(shifts) else 0.0 for turn in (cos, sin))
    together = min(1.0, math.hypot(x, y))
    deviation = math.sqrt(-2 * float(log(np.float64(max(together, 1e-6))))) / (2 * math.pi)
    mean = math.atan2(y, x) / (2 * math.pi) % 1
    return [round(mean * length), round(min(1.0, math.sqrt(12) * deviation) * length), length]


def _sheet(boxes: np.ndarray) -> tuple[np.ndarray, int]:
    """Boxes side by side in about a square, and the number of them in a row; the last row is filled up."""
    count, height, width, channels = boxes.shape
    columns = math.ceil(math.sqrt(count * height / width))
    rows = -(-count // columns)
    laid = boxes[np.arange(rows * columns) % count].reshape(rows, columns, height, width, channels)
    return np.ascontiguousarray(np.swapaxes(laid, 1, 2).reshape(rows * height, columns * width, channels)), columns
