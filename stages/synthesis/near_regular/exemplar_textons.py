"""Textons: the cells of a straightened exemplar, and the cost of any two of them side by side."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.filters import interpolated
from texloom.stages.numerics.matrices import inverse_of, matrix_product, row_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline, cell_outline, course_outline
from texloom.stages.synthesis.near_regular.lattice_tiles import Window, whole

_MAX_TEXTONS = 2048  # of more a random subset is compared
_MAX_COMPARED = 400  # pixels of a zone that are compared
_MIN_BORDER = 0.15  # of the longest border with a neighbour, below which they touch at a corner only
_UNIT = 4.0  # fixed-point steps per CIELAB unit: sums of products are exact in any order
_SAMPLES = 96  # of a cell along a generator, at which weights are kept
_PHASES = 48  # textons that begin in a cell's length along courses
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))


@dataclass(frozen=True)
class Textons:
    """The whole cells of an exemplar."""

    generators: Float64[np.ndarray, "2 2"]
    """of the lattice whose cells they are, px in the straightened exemplar"""
    places: Float64[np.ndarray, "textons 2"]
    """lattice coordinates of each texton's vertex; times ``generators`` plus ``origin`` in px"""
    origin: Float64[np.ndarray, "2"]
    directions: tuple[tuple[int, int], ...]
    """steps to neighbours with a common border, one of each two opposite ones"""
    costs: tuple[Float32[np.ndarray, "textons textons"], ...]
    """mean squared CIELAB difference in the zone if the second texton follows the first, in each direction"""
    levels: tuple[Float32[np.ndarray, " textons"], ...]
    """mean square of CIELAB in the zone at the end of each texton, in each direction"""
    blend: "Blend"


@dataclass(frozen=True)
class Blend:
    """How the cells of a lattice are blended at each place of the parallelogram of its generators."""

    cells: Int64[np.ndarray, "k 2"]
    """steps from the parallelogram to the cells that reach into it"""
    weights: Float64[np.ndarray, "m n k"]
    """of each cell, for samples of the parallelogram; their sum is 1"""

    @classmethod
    def of(cls, outline: CellOutline, zone: float) -> "Blend":
        """Linear ramps across outlines; ``zone`` is their width, as a share of the generators."""
        import cv2

        repeat = [max(1, -(-_SAMPLES // count)) for count in outline.lift.shape[:2]]
        lift = np.repeat(np.repeat(outline.lift, repeat[0], axis=0), repeat[1], axis=1)
        m, n = lift.shape[:2]
        around = np.moveaxis(np.indices((3, 3)), 0, -1) - 1
        cover = (around[:, None, :, None] - lift[None, :, None, :]).reshape(3 * m, 3 * n, 2)
        # odd, so that ramps are centred
        width, height = (2 * round(zone * count / 2) + 1 for count in (n, m))
        near = cover[m - height : 2 * m + height, n - width : 2 * n + width].reshape(-1, 2)
        cells, weights = [], []
        for cell in np.unique(near, axis=0):
            plane = (cover == cell).all(axis=2).astype(np.float64)
            soft = cv2.blur(plane, (width, height))[m : 2 * m, n : 2 * n]
            if soft.max() > 1e-9:
                cells.append(cell)
                weights.append(np.where(soft > 1e-9, soft, 0))
        table = np.stack(weights, axis=-1)
        return cls(np.array(cells, np.int64), np.ascontiguousarray(table / table.sum(axis=-1, keepdims=True)))


def straightened(
    lab: Float32[np.ndarray, "h w c"], source: Float32[np.ndarray, "h w 2"], usable: Bool[np.ndarray, "h w"] | None
) -> tuple[Float32[np.ndarray, "h w c"], Bool[np.ndarray, "h w"]]:
    """The features of the straightened exemplar, and where they are inside the exemplar and not masked."""
    import cv2

    last = np.array(lab.shape[:2]) - 1
    valid = ((source >= 0) & (source <= last)).all(axis=2)
    if usable is not None:
        # Pixels used by the interpolation must not be masked either.
        unmasked = cv2.erode(usable.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        nearest = np.clip(np.rint(source), 0, last).astype(np.int64)
        valid &= unmasked[nearest[..., 0], nearest[..., 1]]
    planes = [
        interpolated(np.ascontiguousarray(plane), source[..., 0], source[..., 1])
        for plane in np.moveaxis(lab, 2, 0)
    ]
    return np.ascontiguousarray(np.stack(planes, axis=2), np.float32), valid


def find_textons(
    lab: Float32[np.ndarray, "h w c"],
    source: Float32[np.ndarray, "h w 2"],
    generators: np.ndarray,
    origin: np.ndarray,
    zone: float,
    rng: np.random.Generator,
    usable: Bool[np.ndarray, "h w"] | None = None,
    courses: bool = False,
) -> Textons | None:
    """Partition an exemplar into the cells of its lattice; none if it shows no whole cell.

    Their outline is the one along which joints show least, see `cell_outline`.

    Parameters
    ----------
    lab : the exemplar's CIELAB colours, or lightness alone; other features may follow.
    source : for every pixel of the straightened exemplar its position in the exemplar, px.
    generators, origin : the regular lattice of the straightened exemplar, px.
    zone : width of the boundary zones, as a share of a cell's side.
    usable : false for masked pixels of the exemplar, which cells must not contain; none for no mask.
    courses : cells may begin anywhere along the second generator.
    """
    features, valid = straightened(lab.reshape(*lab.shape[:2], -1), source, usable)
    generators = np.asarray(generators, np.float64)
    vertices = _vertices(valid.shape, generators, origin)
    band = max(1.0, zone / 2 * float(np.hypot(*generators.T).min()))
    if courses:
        outline = course_outline(features, valid, vertices, generators)
        shares = np.arange(_PHASES)[:, None] / _PHASES
        vertices = (vertices[:, None] + shares * generators[1]).reshape(-1, 2)
    else:
        outline = cell_outline(features, valid, vertices, generators, band)
    generators = outline.generators
    window = Window.of(outline, band)
    corners = vertices[whole(window, vertices, np.eye(2), valid, 0)]
    if not len(corners):
        return None
    if len(corners) > _MAX_TEXTONS:
        corners = corners[np.sort(rng.choice(len(corners), _MAX_TEXTONS, replace=False))]
    directions, costs, levels = _measured(features, window, corners, generators)
    return Textons(
        generators,
        matrix_product(corners - origin, inverse_of(generators)),
        np.asarray(origin, np.float64),
        directions,
        costs,
        levels,
        Blend.of(outline, zone),
    )


def _vertices(shape: tuple[int, ...], generators: np.ndarray, origin: np.ndarray) -> Float64[np.ndarray, "n 2"]:
    """The points of a lattice in and around an exemplar."""
    sides = np.array(shape)
    corners = (np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * sides) - origin
    position = matrix_product(corners, inverse_of(generators))
    low, high = np.floor(position.min(axis=0)).astype(int) - 2, np.ceil(position.max(axis=0)).astype(int) + 2
    steps = (np.moveaxis(np.indices(high - low + 1), 0, -1) + low).reshape(-1, 2)
    places = matrix_product(steps, generators) + origin
    margin = 2 * np.abs(generators).sum(axis=0)
    return np.asarray(places[((places >= -margin) & (places <= sides + margin)).all(axis=1)])


def _measured(
    features: Float32[np.ndarray, "h w c"],
    window: Window,
    corners: Float64[np.ndarray, "textons 2"],
    generators: Float64[np.ndarray, "2 2"],
) -> tuple[tuple[tuple[int, int], ...], tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Directions, costs and levels, see `Textons`."""
    low = window.offsets.min(axis=0)
    inside = np.zeros(window.offsets.max(axis=0) - low + 1, bool)
    inside[tuple((window.offsets - low).T)] = True
    zones = {}
    for step in _STEPS:
        moved = window.offsets - np.rint(matrix_product(step, generators)).astype(np.int64) - low
        common = ((moved >= 0) & (moved < inside.shape)).all(axis=1)
        common[common] = inside[tuple(moved[common].T)]
        zones[step] = window.offsets[common], moved[common] + low
    longest = max(len(first) for first, _ in zones.values())
    first_pixel = np.rint(corners).astype(np.int64)
    directions, costs, levels = [], [], []
    for step, ends in zones.items():
        count = len(ends[0])
        if count == 0 or count < _MIN_BORDER * longest:
            continue
        every = -(-count // _MAX_COMPARED)
        strips = []
        for end in ends:
            at = first_pixel[:, None] + end[::every]
            strips.append(np.rint(features[at[..., 0], at[..., 1]] * _UNIT).reshape(len(corners), -1).astype(float))
        one, other = strips
        squares = [(strip**2).sum(axis=1) for strip in strips]
        values = one.shape[1] / features.shape[2] * _UNIT**2
        difference = squares[0][:, None] + squares[1][None, :] - 2 * row_product(one, other.T)
        directions.append(step)
        costs.append((np.maximum(difference, 0) / values).astype(np.float32))
        levels.append((squares[0] / values).astype(np.float32))
    return tuple(directions), tuple(costs), tuple(levels)
