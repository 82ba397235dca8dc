"""The deformed lattice of a near-regular exemplar: the actual positions of its vertices."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from pydantic import Field

from texloom.stages.analysis.regularity.course_tracking import track_courses
from texloom.stages.analysis.regularity.courses import clearest_plane
from texloom.stages.analysis.regularity.lattice import valid_lightness
from texloom.stages.analysis.regularity.lattice_tracking import MIN_VERTICES, track_lattice
from texloom.stages.analysis.regularity.vertices import Vertices, read_vertices
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import determinant, inverse_of, least_squares, matrix_product, solve_symmetric
from texloom.stages.vocabulary.arrays import Channels, Image, Vectors
from texloom.stages.vocabulary.declare import InputError, InputFile, Params, stage
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.sizes import format_size

_COURSE_SIDE = 2.0  # length of a cell along courses, as a multiple of their period
_FILE_WEIGHT = 1e4  # of a vertex from a file; a detected one has at most 1
_REJECTION = 4.0  # standard deviations from its neighbours at which a vertex gets no weight
_MIN_DEVIATION = 0.5  # px
_MARGIN = 1.0  # generators by which the lattice extends beyond the exemplar's borders
_MAX_VERTICES = 40_000
_ROBUST_PASSES = 4  # of the smoothing

Steps = Annotated[Int32[np.ndarray, "vertices 2"], Channels(("row", "column"))]
"""of each vertex of a lattice, along its two generators"""

Points = Annotated[Float32[np.ndarray, "vertices 2"], Channels(("row", "column"))]
"""the position of each vertex of a lattice, px"""


class DeformedLatticeParams(Params):
    """How vertices are detected or read."""

    vertices: InputFile | None = None
    """a JSON file with vertices placed by hand, `{"vertices": [[i, j, row, column], ...]}`: i and j count steps
    along the two generators, row and column are px; missing vertices are interpolated smoothly. `"generators":
    [[row, column], [row, column]]` may give the regular lattice. null: vertices are detected in the exemplar"""
    reach: float = Field(0.2, gt=0, le=0.45)
    """search radius around the position that a neighbour predicts, as a share of the shorter generator"""
    stiffness: float = Field(0.01, gt=0, le=100)
    """weight of the lattice's bending against the detected positions; 0.01 follows single elements, 1 only slow
    bends"""


@dataclasses.dataclass(frozen=True)
class DeformedLattice:
    """The deformed lattice and the regular lattice nearest to it."""

    generators: Vectors
    """of the regular lattice, px; with courses the first is the step between them, the second runs along them"""
    courses: bool
    """the exemplar has courses only: a cell may begin anywhere along the second generator"""
    steps: Steps
    """of each vertex along the two generators"""
    vertices: Points
    """position of each vertex, px; some lie up to a generator outside the exemplar"""
    regular: Points
    """position of each vertex in the regular lattice, px"""
    detected: float
    """share of the vertices inside the exemplar that were detected or given, 0..1"""
    deviation: float
    """root mean square distance of the vertices within the exemplar from the regular lattice, px"""
    picture: Image
    """the exemplar with the lattice drawn over it; circles mark detected or given vertices"""


def check_vertices(params: DeformedLatticeParams, known: Mapping[str, Any]) -> None:
    """The file must be readable, its vertices near the exemplar, and no cell inverted."""
    if params.vertices is None:
        return
    image = known.get("image")
    vertices = read_vertices(params.vertices)
    try:
        check_lattice(vertices, None if image is None else (image.height, image.width))
    except InputError as error:
        raise InputError(f"vertices: {params.vertices}: {error}") from None


def check_lattice(vertices: Vertices, shape: tuple[int, int] | None) -> None:
    """`InputError` unless vertices placed by hand form a lattice in an exemplar of ``shape``."""
    if shape is not None:
        sides = np.array(shape)
        outside = np.flatnonzero(((vertices.places < -sides) | (vertices.places > 2 * sides)).any(axis=1))
        if outside.size:
            row, column = vertices.places[outside[0]]
            raise InputError(
                f"vertices.{outside[0]}: ({row:g}, {column:g}) is far outside the exemplar's {format_size(shape)}"
            )
    generators, _ = _regular_fit(vertices)
    if abs(determinant(generators)) < 4:
        raise InputError("the lattice's cells are smaller than 4 px")
    position = dict(zip(map(tuple, vertices.steps.tolist()), vertices.places, strict=True))
    for (i, j), place in position.items():
        if (i + 1, j) in position and (i, j + 1) in position:
            edges = np.array([position[i + 1, j] - place, position[i, j + 1] - place])
            if determinant(edges) * determinant(generators) <= 0:
                raise InputError(f"the cell at step [{i}, {j}] is inverted")


def _regular_fit(vertices: Vertices) -> tuple[Float64[np.ndarray, "2 2"], Float64[np.ndarray, "2"]]:
    """Generators, and position of step (0, 0), of the regular lattice nearest to some vertices."""
    if vertices.generators is not None:
        return vertices.generators, (vertices.places - matrix_product(vertices.steps, vertices.generators)).mean(
            axis=0
        )
    system = np.column_stack([vertices.steps, np.ones(len(vertices.steps))])
    fit = least_squares(system, vertices.places)
    return fit[:2], fit[2]


def _tracked_courses(image: Image, period: np.ndarray, reach: float) -> tuple[Vertices, Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """The vertices detected on courses, with cells of a given length along them, and their correlations, 0..1."""
    along = np.array([-period[1], period[0]])
    width = abs(along[0]) * image.height + abs(along[1]) * image.width
    along *= min(_COURSE_SIDE, width / (3 * float(matrix_product(period, period))))
    plane = clearest_plane(valid_lightness(image), valid_pixels(image), period)
    known, correlations = track_courses(plane, period, along, reach)
    if len(known.steps) < MIN_VERTICES or (np.ptp(known.steps, axis=0) == 0).any():
        raise InputError("image: the courses are not detected in the exemplar; give a lattice's vertices in a file")
    # Few strips would not determine the courses' direction better than their detection did.
    unit = period / np.hypot(*period)
    line = np.column_stack([known.steps[:, 0], np.ones(len(known.steps))]) * correlations[:, None]
    spacing = least_squares(line, matrix_product(known.places, unit) * correlations)[0]
    generators = np.array([spacing * unit, along])
    return Vertices(known.steps, known.places, generators), correlations


def _steps_near(
    shape: tuple[int, int], generators: np.ndarray, origin: np.ndarray, known: Int64[np.ndarray, "k 2"]
) -> tuple[Int64[np.ndarray, "n 2"], Int64[np.ndarray, "k"]]:  # type: ignore[name-defined]
    """The steps of all vertices inside an image or within `_MARGIN` of it, and the indices of the known ones."""
    sides, margin = np.array(shape), _MARGIN * np.abs(generators).max(axis=0)
    corners = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * (sides / 2 + margin)
    ends = matrix_product(corners + (sides - 1) / 2 - origin, inverse_of(generators))
    ranges = [
        np.arange(np.floor(first), np.ceil(last) + 1)
        for first, last in zip(ends.min(axis=0), ends.max(axis=0), strict=True)
    ]
    if ranges[0].size * ranges[1].size > _MAX_VERTICES * 16:
        raise InputError("generators: the lattice has too many vertices for this exemplar")
    steps = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.int64)
    places = matrix_product(steps, generators) + origin
    near = ((places >= -margin) & (places <= sides - 1 + margin)).all(axis=1)
    steps, number = np.unique(np.concatenate([known, steps[near]]), axis=0, return_inverse=True)
    return steps, number.ravel()[: len(known)]


def _smoothed(
    steps: Int64[np.ndarray, "n 2"],
    at: Int64[np.ndarray, "k"],  # type: ignore[name-defined]
    known: np.ndarray,
    weights: np.ndarray,
    stiffness: float,
) -> Float64[np.ndarray, "n 2"]:
    """Smooth displacements of all steps, fitted robustly to the known ones.

    Minimises the weighted squared differences to the known displacements plus ``stiffness`` times the squared
    second differences along both generators and both diagonals. Outliers lose their weight.

    Parameters
    ----------
    at : index of each step whose displacement is known.
    known : the known displacements, (k, 2).
    weights : of the known displacements, (k,).
    """
    sparse = loaded("scipy.sparse")
    bends = _second_differences(steps)
    # A little weight everywhere keeps unconnected steps in place.
    smooth = stiffness * (bends.T @ bends) + sparse.diags_array(np.full(len(steps), 1e-9))
    current = weights
    moves = np.zeros((len(steps), 2))
    for _ in range(_ROBUST_PASSES):
        total = np.bincount(at, current, len(steps))
        targets = np.zeros((len(steps), 2))
        targets[at] = current[:, None] * known
        moves = solve_symmetric(smooth + sparse.diags_array(total), targets)
        residual = np.hypot(*(moves[at] - known).T)
        scale = _REJECTION * max(_MIN_DEVIATION, 1.4826 * float(np.median(residual)))
        current = weights * np.maximum(1 - (residual / scale) ** 2, 0) ** 2
    return np.asarray(moves)


def _second_differences(steps: Int64[np.ndarray, "n 2"]) -> Any:
    """Sparse matrix (k, n) of the second differences of a value at each step, in four directions."""
    sparse = loaded("scipy.sparse")
    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    lines = [
        (number[i - di, j - dj], index, number[i + di, j + dj])
        for (i, j), index in number.items()
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1))
        if (i - di, j - dj) in number and (i + di, j + dj) in number
    ]
    count = len(lines)
    columns = (np.repeat(np.arange(count), 3), np.array(lines, int).ravel())
    return sparse.csc_array((np.tile([1.0, -2.0, 1.0], count), columns), shape=(count, len(steps)))


def _drawn(
    image: Image,
    steps: Int64[np.ndarray, "n 2"],
    places: Float64[np.ndarray, "n 2"],
    known: Bool[np.ndarray, "n"],  # type: ignore[name-defined]
) -> Image:
    """The exemplar, darkened, with the lattice over it."""
    import cv2

    canvas = np.ascontiguousarray(0.6 * np.clip(image.color, 0, 1), np.float32)
    unit = max(1, round(min(canvas.shape[:2]) / 512))
    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    fixed = np.rint(places[:, ::-1] * 16).astype(int)  # sixteenths of a px, column first, as OpenCV expects
    for (i, j), index in number.items():
        for side in ((1, 0), (0, 1)):
            neighbour = number.get((i + side[0], j + side[1]))
            if neighbour is not None:
                ends = (fixed[index].tolist(), fixed[neighbour].tolist())
                cv2.line(canvas, ends[0], ends[1], (1.0, 0.8, 0.0), unit, cv2.LINE_AA, 4)
    for centre in fixed[known]:
        cv2.circle(canvas, centre.tolist(), 48 * unit, (0.0, 1.0, 1.0), unit, cv2.LINE_AA, 4)
    return Image(canvas, ("R", "G", "B"))


@stage(version=2, check=check_vertices)
def deformed_lattice(
    image: Image, params: DeformedLatticeParams, generators: Vectors | None = None
) -> DeformedLattice:
    """Detect the vertices of the lattice of a near-regular exemplar, or read them from a file.

    Starting from one vertex, each neighbour is searched for one generator away, where the exemplar correlates most
    with the lattice's mean cell, so that slow bends are followed: by lightness, or by contours where tiles have
    many tones. Courses are compared with the mean course, strip
    by strip, and get cells of twice their period. Vertices are then smoothed; outliers and missing
    vertices follow the others. The regular lattice is the least squares fit to the detected vertices.

    Parameters
    ----------
    image : the exemplar.
    generators : the lattice, px, two rows, or one at right angles to courses, as from `lattice_selection`; not
        needed with a file.

    Raises
    ------
    InputError
        the file is invalid; there is neither a file nor a lattice; or the lattice's cells are not detected.

    References
    ----------
    [Lin2004]_ appendix A, where a person draws the generators and drags the vertices. Detecting them is ours.
    """
    if not np.isfinite(image.pixels).all():
        raise InputError("image: a value is not finite")
    courses = params.vertices is None and generators is not None and len(generators) == 1
    if params.vertices is not None:
        return lattice_through(image, read_vertices(params.vertices), params.stiffness)
    if courses and generators is not None:
        known, correlations = _tracked_courses(image, generators[0].astype(np.float64), params.reach)
        weights = correlations**2
    elif generators is not None and len(generators) == 2:
        known, correlations = track_lattice(image, generators.astype(np.float64), params.reach)
        weights = correlations**2
    else:
        raise InputError(
            "generators: the exemplar shows neither a lattice nor courses. If it does repeat, give vertices in a "
            "file, param 'vertices', or set a lower significance or stripes=true at the step that detects its "
            "lattice (analysis.lattice_selection); if not, use self_tuning, or wang_tiles for a plane without end"
        )
    return lattice_through(image, known, params.stiffness, weights, courses)


def lattice_through(
    image: Image,
    known: Vertices,
    stiffness: float,
    weights: Float64[np.ndarray, "n"] | None = None,  # type: ignore[name-defined]
    courses: bool = False,
) -> DeformedLattice:
    """The smooth lattice near known vertices.

    Parameters
    ----------
    stiffness : see `DeformedLatticeParams`.
    weights : of the known vertices; None: they are placed by hand and keep their positions.
    courses : see `DeformedLattice`.
    """
    fitted, origin = _regular_fit(known)
    shape = (image.height, image.width)
    steps, at = _steps_near(shape, fitted, origin, known.steps)
    regular = matrix_product(steps, fitted) + origin
    force = np.full(len(at), _FILE_WEIGHT) if weights is None else weights
    moves = _smoothed(steps, at, known.places - regular[at], force, stiffness)
    if weights is None:
        moves[at] = known.places - regular[at]
    places = regular + moves
    inside = ((places >= 0) & (places <= np.array(shape) - 1)).all(axis=1)
    is_known = np.isin(np.arange(len(steps)), at)
    deviation = float(np.sqrt((moves[inside] ** 2).sum(axis=1).mean())) if inside.any() else 0.0
    return DeformedLattice(
        generators=fitted.astype(np.float32),
        courses=courses,
        steps=steps.astype(np.int32),
        vertices=places.astype(np.float32),
        regular=regular.astype(np.float32),
        detected=float(is_known[inside].mean()) if inside.any() else 0.0,
        deviation=deviation,
        picture=_drawn(image, steps, places, is_known),
    )
