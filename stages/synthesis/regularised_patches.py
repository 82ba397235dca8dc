"""Regularised patch-based synthesis: textons of the straightened exemplar on a lattice, then deformed like it."""

import dataclasses
from collections import deque
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.deformed_lattice import Points, Steps
from texloom.stages.analysis.straighten import Positions
from texloom.stages.arrays import Channels, Correspondence, Image, Vectors
from texloom.stages.common.free_form import fitted
from texloom.stages.common.maps import check_weights
from texloom.stages.common.sizes import check_side
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.normals import with_unit_normals
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._lattice.deformation import DIRECTIONS, synthesise_displacements
from texloom.stages.synthesis._lattice.output_lattice import OutputLattice
from texloom.stages.synthesis._lattice.textons import Textons, find_textons
from texloom.stages.synthesis._seams.exemplar import Exemplar, Weights, lab_of

_LEAST = 8  # px of an exemplar's shorter side
_AGAIN = 4.0  # uses more than others that a texton may have rather than be next to itself
_SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
_ROWS = 16  # of the result laid at a time


class RegularisedPatchesParams(Params):
    """The result's size, how textons are chosen, and how far the lattice is deformed."""

    size: Size = (512, 512)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders; its lattice is then stretched a little, so that it does too"""
    strength: float = Field(1.0, ge=0, le=2)
    """how far the result's lattice is deformed: 0 leaves it regular, 1 bends it as much as the exemplar's"""
    zone: float = Field(0.17, gt=0, le=0.5)
    """width of the boundary zone in which neighbours are compared and blended, as a share of a cell's side"""
    tolerance: float = Field(0.1, ge=0, le=1)
    """how much farther than the best a texton may be from its neighbours in the boundary zone, as a share of the
    zone's mean colour; 0 takes the best, more uses the exemplar more evenly"""
    weights: Weights = Field({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


@dataclasses.dataclass(frozen=True)
class RegularisedPatches:
    """The texture."""

    image: Image
    """the exemplar's textons, blended where they meet"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel nearest to where it comes from; of blended ones that of more
    weight"""
    tileable: bool
    """the result continues across its borders"""
    displacement: Annotated[Float32[np.ndarray, "H W 2"], Channels(("row", "column"))]
    """from every pixel of the result to its place in the regular texture, px"""
    generators: Vectors
    """of the result's lattice before it is deformed, px"""


def check_exemplar(params: RegularisedPatchesParams, known: Mapping[str, Any]) -> None:
    """The exemplar must have pixels to be read between."""
    image = known.get("image")
    if image is not None:
        check_weights(params.weights, image.channels)
        check_side(image, _LEAST)


def _choose(
    textons: Textons, lattice: OutputLattice, tolerance: float, rng: np.random.Generator
) -> Int64[np.ndarray, "nodes"]:  # type: ignore[name-defined]
    """A texton for each node, in the order in which the lattice grows from the result's middle."""
    count = len(textons.places)
    sides, around = lattice.neighbours(_SIDES).tolist(), lattice.neighbours(DIRECTIONS)
    first = int(((lattice.places - np.array(lattice.size) / 2) ** 2).sum(axis=1).argmin())
    chosen = np.full(len(lattice.steps), -1, np.int64)
    used = np.zeros(count, np.int64)
    waiting, seen = deque([first]), {first}
    done = 0
    while waiting:
        node = waiting.popleft()
        errors, level, placed = np.zeros(count), 0.0, 0
        for side, other in enumerate(sides[node]):
            if other < 0:
                continue
            if other not in seen:
                seen.add(other)
                waiting.append(other)
            texton = int(chosen[other])
            if texton >= 0:
                costs = textons.costs[side // 2]
                errors += costs[texton] if side % 2 == 0 else costs[:, texton]
                level += float(textons.levels[side // 2][texton])
                placed += 1
        step = tolerance**2 * level
        prices = errors + step * used / max(1.0, done / count)
        near = chosen[around[node][around[node] >= 0]]
        prices[near[near >= 0]] += _AGAIN * step
        good = np.flatnonzero(prices <= prices.min() + step)
        texton = int(good[rng.integers(len(good))])
        chosen[node] = texton
        used[texton] += 1
        done += 1
        if done % 256 == 0:
            report(Progress(0.5 * done / len(chosen)))
    return chosen


@stage(version=1, check=check_exemplar)
def regularised_patches(
    image: Image,
    source: Positions,
    generators: Vectors,
    steps: Steps,
    vertices: Points,
    regular: Points,
    params: RegularisedPatchesParams,
    rng: np.random.Generator,
) -> RegularisedPatches:
    """Lay the cells of a near-regular exemplar on a regular lattice, and deform the result as the exemplar is.

    The exemplar is seen straightened, so that its cells are equal parallelograms along the generators: the textons.
    Cells of the result are filled in the order in which the lattice grows from the middle, each with a texton whose
    boundary zone resembles those of its neighbours, and blended with them linearly. The vertices are then displaced
    like those of the exemplar, and the texture follows by a multilevel free-form deformation. All is drawn from the
    exemplar itself at once, so that nothing is resampled twice. Textons are compared by all maps and hold no masked
    pixel; see `usable`. Normals keep unit length.

    Parameters
    ----------
    source : for every pixel of the straightened exemplar its place in the exemplar, px, as from `straighten`.
    generators, steps, vertices, regular : the deformed lattice, as from `deformed_lattice`.

    Raises
    ------
    InputError
        there is no lattice; or the exemplar shows no whole cell of it; or a tileable result is smaller than a cell.

    References
    ----------
    [Lin2004]_ appendix A; [Liang2001]_ for the boundary zones; [Lee1996]_ for the deformation. The paper's user
    chooses where textons begin; we cut where all cells are most alike. The paper draws at random from the textons
    within the tolerance of what is there. Ours is counted from the best, and being used as often as textons are on
    average counts as one tolerance more, so that small exemplars are used evenly.
    """
    check_exemplar(params, {"image": image})
    if len(generators) != 2 or not len(steps):
        raise InputError("generators: the exemplar has no lattice to lay textons on")
    exemplar = Exemplar(image, lab_of, 100.0, params.weights)
    origin = regular[0].astype(np.float64) - steps[0] @ generators.astype(np.float64)
    textons = find_textons(
        exemplar.features, source, generators.astype(np.float64), origin, params.zone, rng, exemplar.usable
    )
    if textons is None:
        masked = "" if exemplar.usable is None else " that its mask leaves"
        raise InputError(f"image: the exemplar does not show one whole cell of its lattice{masked}")
    lattice = OutputLattice.of(textons.generators, params.size, params.tileable)
    chosen = _choose(textons, lattice, params.tolerance, rng)

    moves = np.zeros((len(lattice.steps), 2))
    if params.strength > 0:
        given = vertices.astype(np.float64) - regular.astype(np.float64)
        sides = np.array([image.height, image.width])
        inside = ((vertices >= 0) & (vertices <= sides - 1)).all(axis=1)
        own = np.rint(steps @ generators.astype(np.float64) @ np.linalg.inv(textons.generators)).astype(np.int64)
        moves = params.strength * synthesise_displacements(own[inside], given[inside], lattice, rng)
    displacement = _displacement(lattice, moves)
    pixels, match = _laid(exemplar.image, source, textons, lattice, chosen, displacement)
    return RegularisedPatches(
        Image(with_unit_normals(pixels, exemplar.image.channels), exemplar.image.channels),
        match,
        params.tileable,
        displacement.astype(np.float32),
        lattice.generators.astype(np.float32),
    )


def _displacement(lattice: OutputLattice, moves: Float64[np.ndarray, "nodes 2"]) -> Float64[np.ndarray, "H W 2"]:
    """From every pixel of the result to its place in the regular texture, px."""
    size = np.array(lattice.size)
    if not moves.any():
        return np.zeros((*lattice.size, 2))
    regular = lattice.places
    moved = regular + moves
    box = (np.zeros(2), size) if lattice.tileable else (moved.min(axis=0), moved.max(axis=0))
    finest = 0.5 * float(np.hypot(*lattice.generators.T).min())
    warp = fitted(moved, regular, (box[0], box[1].astype(np.float64)), finest, wrap=lattice.tileable)
    grid = np.moveaxis(np.indices(lattice.size), 0, -1).reshape(-1, 2).astype(np.float64)
    return (warp(grid) - grid).reshape(*lattice.size, 2)


def _laid(
    image: Image,
    source: Positions,
    textons: Textons,
    lattice: OutputLattice,
    chosen: Int64[np.ndarray, "nodes"],  # type: ignore[name-defined]
    displacement: Float64[np.ndarray, "H W 2"],
) -> tuple[Float32[np.ndarray, "H W c"], Correspondence]:
    from texloom.stages.kernels.core.threads import run_all, spans
    from texloom.stages.kernels.lattice.textons import lay_textons

    height, width = lattice.size
    pixels = np.zeros((height * width, len(image.channels)), np.float32)
    match = np.zeros((height * width, 2), np.uint32)
    places = np.ascontiguousarray(np.moveaxis(np.indices(lattice.size), 0, -1) + displacement).reshape(-1, 2)
    fixed = (
        np.linalg.inv(lattice.generators), np.zeros(2), lattice.first, lattice.ids, textons.places[chosen],
        textons.generators, textons.origin, textons.zone,
    )  # fmt: skip
    run_all(
        lay_textons,
        [
            (image.pixels, source, places[a:b], *fixed, pixels[a:b], match[a:b])
            for a, b in spans(height * width, -(-height // _ROWS))
        ],
    )
    return pixels.reshape(height, width, -1), match.reshape(height, width, 2)
