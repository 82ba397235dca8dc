"""The deformed lattice: where the vertices of a near-regular exemplar's lattice really are."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from pydantic import Field

from texloom.stages.analysis._lattice.vertices import Vertices, read_vertices
from texloom.stages.arrays import Channels, Image, Vectors
from texloom.stages.color import lab_from_linear
from texloom.stages.common import lattice_cells
from texloom.stages.declare import InputError, InputFile, Params, stage

_DETAIL = 48.0  # px to which longer generators are reduced when vertices are looked for
_SEEDS = 3  # a side: cells of the exemplar that are tried as the first template
_PASSES = 2  # with the mean of what was found as template
_LEAST_LIKENESS = 0.25  # correlation with the template from which a place may be a vertex
_LEAST = 4  # vertices that make a lattice
_GIVEN = 1e4  # weight of a vertex from a file, against 1 of one that is certainly found
_REJECTION = 4.0  # standard deviations from its neighbours at which a vertex no longer counts
_LEAST_DEVIATION = 0.5  # px
_MARGIN = 1.0  # generators beyond the exemplar's border up to which the lattice goes on
_LARGEST = 40_000  # vertices

Steps = Annotated[Int32[np.ndarray, "vertices 2"], Channels(("row", "column"))]
"""of each vertex of a lattice, along its two generators"""

Points = Annotated[Float32[np.ndarray, "vertices 2"], Channels(("row", "column"))]
"""a place for each vertex of a lattice, px"""


class DeformedLatticeParams(Params):
    """Where vertices come from."""

    vertices: InputFile | None = None
    """a JSON file with vertices placed by hand, `{"vertices": [[i, j, row, column], ...]}`: i and j count steps
    along the two generators, row and column are px; vertices that are left out follow smoothly. `"generators":
    [[row, column], [row, column]]` may name the regular lattice. null: vertices are found in the exemplar"""
    reach: float = Field(0.2, gt=0, le=0.45)
    """how far from where its neighbour leads to a vertex is looked for, as a share of the shorter generator"""
    stiffness: float = Field(0.01, gt=0, le=100)
    """how much the lattice resists bending from vertex to vertex, against what was found; 0.01 follows single
    elements, 1 only slow bends"""


@dataclasses.dataclass(frozen=True)
class DeformedLattice:
    """The lattice as it is, and as it would be if it were regular."""

    generators: Vectors
    """of the regular lattice, px"""
    steps: Steps
    """of each vertex along the two generators"""
    vertices: Points
    """where each vertex is, px; some lie up to a generator beyond the exemplar's borders"""
    regular: Points
    """where each vertex is in the regular lattice that comes nearest, px"""
    found: float
    """share of the vertices within the exemplar that were found there or given, 0..1"""
    deviation: float
    """root mean square distance of the vertices within the exemplar from the regular lattice, px"""
    picture: Image
    """the exemplar with the lattice drawn over it; circles mark what was found or given"""


def check_vertices(params: DeformedLatticeParams, known: Mapping[str, Any]) -> None:
    """The file must be readable, its vertices near the exemplar, and no cell turned over."""
    if params.vertices is None:
        return
    given = read_vertices(params.vertices)
    image = known.get("image")
    if image is not None:
        sides = np.array([image.height, image.width])
        outside = np.flatnonzero(((given.places < -sides) | (given.places > 2 * sides)).any(axis=1))
        if outside.size:
            row, column = given.places[outside[0]]
            raise InputError(
                f"vertices: {params.vertices}: vertices[{outside[0]}]: ({row:g}, {column:g}) is far beyond the "
                f"exemplar's {image.height}x{image.width} px"
            )
    generators, _ = _straight(given)
    if abs(np.linalg.det(generators)) < 4:
        raise InputError(f"vertices: {params.vertices}: the lattice's cells have less than 4 px")
    at = {tuple(step): place for step, place in zip(given.steps.tolist(), given.places, strict=True)}
    for (i, j), place in at.items():
        if (i + 1, j) in at and (i, j + 1) in at:
            edges = np.array([at[i + 1, j] - place, at[i, j + 1] - place])
            if np.linalg.det(edges) * np.linalg.det(generators) <= 0:
                raise InputError(f"vertices: {params.vertices}: the cell at step [{i}, {j}] is turned over")


def _straight(given: Vertices) -> tuple[Float64[np.ndarray, "2 2"], Float64[np.ndarray, "2"]]:
    """Generators and place of step (0, 0) of the regular lattice nearest to some vertices."""
    if given.generators is not None:
        return given.generators, (given.places - given.steps @ given.generators).mean(axis=0)
    system = np.column_stack([given.steps, np.ones(len(given.steps))])
    fit = np.linalg.lstsq(system, given.places, rcond=None)[0]
    return fit[:2], fit[2]


def _tracked(image: Image, generators: np.ndarray, reach: float) -> tuple[Vertices, Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """The vertices found in the exemplar, and how much each looks like the others, 0..1.

    A vertex is where the lattice's cell around it looks like all the others. The first template is the cell of the
    exemplar from which most others are found, later ones are the mean of what was found.
    """
    import cv2

    tone = lab_from_linear(image.color)[..., 0]
    factor = min(1.0, _DETAIL / float(np.hypot(*generators.T).max()))
    if factor < 1:
        sides = (round(tone.shape[1] * factor), round(tone.shape[0] * factor))
        tone = cv2.resize(tone, sides, interpolation=cv2.INTER_AREA)
    scale = np.array(image.pixels.shape[:2]) / tone.shape
    short = generators / scale
    offsets = lattice_cells.cell_offsets(short)
    distance = max(2.0, reach * float(np.hypot(*short.T).min()))

    def followed(cell: np.ndarray) -> tuple[lattice_cells.Peaks, lattice_cells.Tracked]:
        likeness = lattice_cells.correlation(tone, offsets, lattice_cells.normalised(cell[None])[0])
        peaks = lattice_cells.peaks(likeness, _LEAST_LIKENESS, distance)
        return peaks, lattice_cells.track(short, peaks)

    def quality(result: tuple[lattice_cells.Peaks, lattice_cells.Tracked]) -> float:
        places = np.rint(result[1].places[result[1].found]).astype(int)
        return float(np.maximum(result[0].likeness[tuple(places.T)], 0).sum())

    low, high = -offsets.min(axis=0), np.array(tone.shape) - 1 - offsets.max(axis=0)
    if (high < low).any():
        raise InputError("image: the exemplar does not show one whole cell of its lattice")
    middles = np.stack(
        np.meshgrid(*(np.linspace(a, b, 2 * _SEEDS + 1)[1::2] for a, b in zip(low, high, strict=True))), axis=-1
    )
    best = max(
        (followed(lattice_cells.cut(tone, at[None], offsets)[0]) for at in middles.reshape(-1, 2)), key=quality
    )
    for _ in range(_PASSES):
        places = best[1].places[best[1].found]
        if len(places) < _LEAST:
            break
        best = followed(lattice_cells.normalised(lattice_cells.cut(tone, places, offsets)).mean(axis=0))
    peaks, track = best
    if int(track.found.sum()) < _LEAST or track.fitted() is None:
        raise InputError(
            "image: the lattice's cells are not found again in the exemplar; give its vertices in a file"
        )
    likeness = peaks.likeness[tuple(np.rint(track.places[track.found]).astype(int).T)]
    # Shrunk pixels stand over the middles of those that they are made of.
    places = (track.places[track.found] + 0.5) * scale - 0.5
    return Vertices(track.steps[track.found], places, None), np.clip(likeness.astype(np.float64), 0, 1)


def _around(
    shape: tuple[int, int], generators: np.ndarray, origin: np.ndarray, given: Int64[np.ndarray, "k 2"]
) -> Int64[np.ndarray, "n 2"]:
    """The steps of all vertices within a picture or a little beyond, and those given, in order."""
    sides = np.array(shape)
    corners = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * (
        sides / 2 + _MARGIN * np.abs(generators).max(axis=0)
    )
    ends = (corners + (sides - 1) / 2 - origin) @ np.linalg.inv(generators)
    ranges = [
        np.arange(np.floor(a), np.ceil(b) + 1) for a, b in zip(ends.min(axis=0), ends.max(axis=0), strict=True)
    ]
    if ranges[0].size * ranges[1].size > _LARGEST * 16:
        raise InputError("generators: the lattice has too many vertices for this exemplar")
    steps = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.int64)
    places = steps @ generators + origin
    beyond = _MARGIN * np.abs(generators).max(axis=0)
    near = ((places >= -beyond) & (places <= sides - 1 + beyond)).all(axis=1)
    return np.unique(np.concatenate([steps[near], given]), axis=0)


def _smoothed(
    steps: Int64[np.ndarray, "n 2"],
    at: Int64[np.ndarray, "k"],  # type: ignore[name-defined]
    places: np.ndarray,
    weights: np.ndarray,
    stiffness: float,
) -> Float64[np.ndarray, "n 2"]:
    """Displacements of all steps that come near to those known and bend little between neighbours.

    Minimises the weighted squares of the differences to what is known plus ``stiffness`` times the squared second
    differences along both generators and both diagonals. What disagrees with its surroundings loses its weight.

    Parameters
    ----------
    at : the steps whose displacement is known, by their index.
    places : the known displacements, (k, 2).
    weights : of those, (k,).
    """
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    lines = [
        (number[i - di, j - dj], index, number[i + di, j + dj])
        for (i, j), index in number.items()
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1))
        if (i - di, j - dj) in number and (i + di, j + dj) in number
    ]
    count = len(lines)
    bends = csc_array(
        (np.tile([1.0, -2.0, 1.0], count), (np.repeat(np.arange(count), 3), np.array(lines, int).ravel())),
        shape=(count, len(steps)),
    )
    # A trace of weight everywhere keeps what hangs on nothing where it is.
    smooth = stiffness * (bends.T @ bends) + diags_array(np.full(len(steps), 1e-9))
    trusted = weights
    moves = np.zeros((len(steps), 2))
    for _ in range(4):
        total = np.bincount(at, trusted, len(steps))
        wanted = np.zeros((len(steps), 2))
        wanted[at] = trusted[:, None] * places
        moves = splu(csc_array(smooth + diags_array(total))).solve(wanted)
        away = np.hypot(*(moves[at] - places).T)
        scale = _REJECTION * max(_LEAST_DEVIATION, 1.4826 * float(np.median(away)))
        trusted = weights * np.maximum(1 - (away / scale) ** 2, 0) ** 2
    return np.asarray(moves)


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
    fixed = np.rint(places[:, ::-1] * 16).astype(int)  # sixteenths of a px, column first, as OpenCV has them
    for (i, j), index in number.items():
        for side in ((1, 0), (0, 1)):
            other = number.get((i + side[0], j + side[1]))
            if other is not None:
                ends = (fixed[index].tolist(), fixed[other].tolist())
                cv2.line(canvas, ends[0], ends[1], (1.0, 0.8, 0.0), unit, cv2.LINE_AA, 4)
    for centre in fixed[known]:
        cv2.circle(canvas, centre.tolist(), 48 * unit, (0.0, 1.0, 1.0), unit, cv2.LINE_AA, 4)
    return Image(canvas, ("R", "G", "B"))


@stage(version=1, check=check_vertices)
def deformed_lattice(
    image: Image, params: DeformedLatticeParams, generators: Vectors | None = None
) -> DeformedLattice:
    """Find the vertices of the lattice of an exemplar whose elements are out of line, or take them from a file.

    From a vertex each neighbour is looked for one generator away, where the lattice's cell looks most like all
    others, so that the lattice is followed through slow bends. Vertices are then smoothed a little, and those that
    disagree with all their neighbours, or were not found, are put where the others lead to. The regular lattice is
    the least squares fit to what was found.

    Parameters
    ----------
    generators : the lattice, (2, 2) px, as from `lattice`; not needed with a file.

    Raises
    ------
    InputError
        the file is not as `vertices` says; or there is neither a file nor a lattice; or its cells are not found.

    References
    ----------
    [Lin2004]_ appendix A, where a person draws the generators and drags the vertices. Finding them is ours.
    """
    check_vertices(params, {"image": image})
    if not np.isfinite(image.pixels).all():
        raise InputError("image: a value is not finite")
    if params.vertices is not None:
        given = read_vertices(params.vertices)
        weights = np.full(len(given.steps), _GIVEN)
    elif generators is not None and len(generators) == 2:
        given, weights = _tracked(image, generators.astype(np.float64), params.reach)
        weights = weights**2
    else:
        raise InputError(
            "generators: the exemplar shows no lattice; set stripes=true or a lower significance at the step that "
            "detects it (analysis.lattice_selection), or give vertices in a file, param 'vertices'"
        )
    straight, origin = _straight(given)
    shape = (image.height, image.width)
    steps = _around(shape, straight, origin, given.steps)
    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    at = np.array([number[tuple(step)] for step in given.steps.tolist()], np.int64)
    regular = steps @ straight + origin
    moves = _smoothed(steps, at, given.places - regular[at], weights, params.stiffness)
    if params.vertices is not None:
        moves[at] = given.places - regular[at]
    places = regular + moves
    inside = ((places >= 0) & (places <= np.array(shape) - 1)).all(axis=1)
    known = np.isin(np.arange(len(steps)), at)
    deviation = float(np.sqrt((moves[inside] ** 2).sum(axis=1).mean())) if inside.any() else 0.0
    return DeformedLattice(
        generators=straight.astype(np.float32),
        steps=steps.astype(np.int32),
        vertices=places.astype(np.float32),
        regular=regular.astype(np.float32),
        found=float(known[inside].mean()) if inside.any() else 0.0,
        deviation=deviation,
        picture=_drawn(image, steps, places, known),
    )
