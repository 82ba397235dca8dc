"""Regularised patch-based synthesis: textons on a regular lattice, deformed like the exemplar's lattice."""

import dataclasses
from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.analysis.regularity.deformed_lattice import Points, Steps
from texloom.stages.analysis.regularity.straighten import Positions
from texloom.stages.common.geometry.free_form_deformation import fitted
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.exemplar_textons import Textons, find_textons
from texloom.stages.synthesis.near_regular.lattice_deformation import synthesise_displacements
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice, torus_of
from texloom.stages.synthesis.near_regular.texton_choice import TextonChoice
from texloom.stages.synthesis.stitching.exemplar import Exemplar, Stitched, StitchingParams, check_exemplar, lab_of
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Vectors
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.normals import with_unit_normals
from texloom.stages.vocabulary.progress import Progress, part, report
from texloom.stages.vocabulary.tileable import Tileable

_MIN_SIDE = 8  # px of an exemplar's shorter side
_ROWS = 16  # of the result computed at a time


class RegularisedPatchesParams(StitchingParams):
    """Size of the result, choice of textons, and deformation of the lattice."""

    tileable: Tileable = NOWHERE
    """the result continues across its borders; the lattice is stretched and sheared a little to fit"""
    strength: float = Field(1.0, ge=0, le=2)
    """deformation of the result's lattice: 0 leaves it regular, 1 deforms it as much as the exemplar's"""
    zone: float = Field(0.1, gt=0, le=0.5)
    """width of the boundary zone in which neighbours are compared and blended, as a share of a cell's side"""
    tolerance: float = Field(0.1, ge=0, le=1)
    """textons whose distance to their neighbours in the boundary zone exceeds the minimum by at most this share of
    the zone's mean colour are drawn from; 0 takes the best, higher values use the exemplar more evenly"""


@dataclasses.dataclass(frozen=True)
class RegularisedPatches(Stitched):
    """The texture, interpolated, with rounded ``match``."""

    displacement: Annotated[Float32[np.ndarray, "H W 2"], Channels(("row", "column"))]
    """from every pixel of the result to its position in the undeformed result, px"""
    generators: Vectors
    """of the result's lattice before the deformation, px"""


@stage(version=2, check=partial(check_exemplar, min_side=_MIN_SIDE))
def regularised_patches(
    image: Image,
    source: Positions,
    generators: Vectors,
    steps: Steps,
    vertices: Points,
    regular: Points,
    params: RegularisedPatchesParams,
    rng: np.random.Generator,
    courses: bool = False,
) -> RegularisedPatches:
    """Lay the cells of a near-regular exemplar on a regular lattice, and deform it like the exemplar's.

    Textons are the cells of the straightened exemplar, cut along its joints: see `near_regular`. Cells of the
    result are filled in the order in which the lattice grows from the middle, each with a texton whose boundary
    zone is similar to those of its neighbours, and blended with them linearly. The vertices are then displaced
    like those of the exemplar, and the texture follows by a multilevel free-form deformation. Results are
    sampled from the exemplar in one step. Textons are compared by all maps and contain no masked pixel; see
    `usable`. Normals keep unit length.

    Parameters
    ----------
    image : the exemplar; all channels are sampled together.
    source : for every pixel of the straightened exemplar its position in the exemplar, px; see `straighten`.
    generators, steps, vertices, regular : the deformed lattice; see `deformed_lattice`.
    courses : textons may begin anywhere along the second generator; see `deformed_lattice`.

    Raises
    ------
    InputError
        there is no lattice; the exemplar shows no whole cell of it, is smaller than 8 x 8 px or holds values that
        are not finite; ``weights`` names a map that it lacks; a tileable result is smaller than a cell.

    References
    ----------
    [Lin2004]_ appendix A; [Liang2001]_ for the boundary zones; [Lee1996]_ for the deformation. The paper's user
    chooses where textons, which are parallelograms, begin; ours have any outline, along which cells are most
    similar. The paper draws at random from all textons within the tolerance. Ours is relative to the best texton,
    and average use costs one tolerance, so that small exemplars are used evenly.
    """
    if len(generators) != 2 or not len(steps):
        raise InputError("generators: the exemplar has no lattice to lay textons on")
    exemplar = Exemplar(image, lab_of, 100.0, params.weights)
    origin = regular[0].astype(np.float64) - matrix_product(steps[0], generators.astype(np.float64))
    textons = find_textons(
        exemplar.features, source, generators.astype(np.float64), origin, params.zone, rng, exemplar.usable, courses
    )
    if textons is None:
        masked = "" if exemplar.usable is None else " that its mask leaves"
        raise InputError(f"image: the exemplar does not show one whole cell of its lattice{masked}")
    report(Progress(0.4))
    is_torus, size = bool(params.tileable), params.size
    if is_torus:
        size = torus_of(textons.generators, params.size, params.tileable)
    lattice = OutputLattice.of(textons.generators, size, is_torus)
    with part(0.4, 0.5):
        chosen = TextonChoice(textons, lattice, params.tolerance, rng).run()

    moves = np.zeros((len(lattice.steps), 2))
    if params.strength > 0:
        exemplar_moves = vertices.astype(np.float64) - regular.astype(np.float64)
        inside = ((vertices >= 0) & (vertices <= np.array(exemplar.shape) - 1)).all(axis=1)
        moves = params.strength * synthesise_displacements(
            steps[inside].astype(np.int64), exemplar_moves[inside], lattice, rng
        )
    report(Progress(0.6))
    displacement = _displacement(lattice, moves)
    report(Progress(0.85))
    pixels, match = _sampled(exemplar.image, source, textons, lattice, chosen, displacement)
    report(Progress(1.0))
    whole = np.s_[: params.size[0], : params.size[1]]
    pixels, match, displacement = (np.ascontiguousarray(plane[whole]) for plane in (pixels, match, displacement))
    return RegularisedPatches(
        exemplar.image.elsewhere(with_unit_normals(pixels, exemplar.image.channels)).wrapping(params.tileable),
        match,
        displacement.astype(np.float32),
        lattice.generators.astype(np.float32),
    )


def _displacement(lattice: OutputLattice, moves: Float64[np.ndarray, "nodes 2"]) -> Float64[np.ndarray, "H W 2"]:
    """From every pixel of the result to its position in the undeformed result, px."""
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


def _sampled(
    image: Image,
    source: Positions,
    textons: Textons,
    lattice: OutputLattice,
    chosen: Int64[np.ndarray, "nodes"],  # type: ignore[name-defined]
    displacement: Float64[np.ndarray, "H W 2"],
) -> tuple[Float32[np.ndarray, "H W c"], Correspondence]:
    from texloom.stages.kernels.core.threads import run_all, spans
    from texloom.stages.kernels.lattice.textons import LatticeNodes, TextonPlaces, lay_textons

    height, width = lattice.size
    pixels = np.zeros((height * width, len(image.channels)), np.float32)
    match = np.zeros((height * width, 2), np.uint32)
    places = np.ascontiguousarray(np.moveaxis(np.indices(lattice.size), 0, -1) + displacement).reshape(-1, 2)
    fixed = (
        LatticeNodes(inverse_of(lattice.generators), np.zeros(2), lattice.first, lattice.ids),
        TextonPlaces(
            textons.places[chosen], textons.generators, textons.origin, textons.blend.cells, textons.blend.weights
        ),
    )
    run_all(
        lay_textons,
        [
            (image.pixels, source, places[a:b], *fixed, pixels[a:b], match[a:b])
            for a, b in spans(height * width, -(-height // _ROWS))
        ],
    )
    return pixels.reshape(height, width, -1), match.reshape(height, width, 2)
