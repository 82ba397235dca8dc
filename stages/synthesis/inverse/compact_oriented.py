"""Inverse texture synthesis of oriented textures: the compaction holds them in one direction."""

import copy
import dataclasses
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.geometry.jacobians import rotations
from texloom.stages.common.geometry.orientation import signed_angles, smoothed
from texloom.stages.common.grids.pyramid import halved_size, resize
from texloom.stages.common.similarity.neighbourhoods import UNIT
from texloom.stages.kernels.core.elementary_functions import arctan2, cos, phase_of, phasor, sin
from texloom.stages.numerics.filters import interpolated
from texloom.stages.synthesis.inverse.oriented_level import OrientedLevel
from texloom.stages.synthesis.inverse.start import block_starts, lay
from texloom.stages.synthesis.inverse.summary import (
    Copied,
    level_count,
    require_features,
    size_check,
    wanted_size,
)
from texloom.stages.synthesis.reconstruction.oriented_places import Places, interpolated_along
from texloom.stages.vocabulary.arrays import ColorField, Image, Jacobian, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import OddSize, Params, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import SIDES

_CANDIDATES = 8  # random blocks among which each block of the start is chosen
_SEARCH_ROUNDS = 3  # of refinement of an angle
_REFINED_SIDE = 2  # neighbourhoods along the sides of the compaction by which the orientation field is updated
_REFINED_STARTS = 2  # from which that is solved after each update, besides from where it began before
_ANGLE_STEP = 2  # neighbourhoods of the inverse term, along both sides, for each whose angle is refined


class CompactOrientedParams(Params):
    """Size of the compaction, weights and effort; fields of the same names as in `compact` mean the same."""

    size: Annotated[tuple[int, int], SIDES] = (96, 96)
    """size of the compaction, px, as 96 or 128x96 (width x height)"""
    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    alpha: float = Field(0.01, ge=1e-6, le=100)
    """weight of the forward term"""
    seams: float = Field(2.0, ge=0, le=100)
    """weight of the seam cost between pixels from different places"""
    spacing: int = Field(3, ge=1, le=16)
    """px between the texture's neighbourhoods in the inverse term"""
    coarsest: int = Field(24, ge=8, le=1024)
    """shorter side of the compaction at the first level, px, at least"""
    iterations: int = Field(12, ge=1, le=500)
    """maximum iterations at a level"""
    tolerance: float = Field(0.005, ge=0, lt=1)
    """iterations end when one lowers the energy by no more than this share of it"""
    block: int = Field(14, ge=4, le=128)
    """side of the texture blocks that the first level starts from, px"""
    orientation_updates: int = Field(2, ge=0, le=10)
    """updates of the orientation field, each from a small compaction, which is solved again; 0 keeps it as given"""
    samples: int = Field(36, ge=4, le=360)
    """angles tried for a neighbourhood in each of three rounds"""
    within: int = Field(2, ge=1, le=8)
    """px around its match in the compaction in which a rotated neighbourhood is compared"""
    reach: float = Field(8.0, gt=0, le=64)
    """distance over which an updated orientation field is smoothed, px; twice as far at the first update"""


@dataclasses.dataclass(frozen=True)
class CompactedOriented(Copied):
    """The compaction, whose pixels are interpolated at places of the texture, and the orientation field."""

    angle: ScalarMap
    """the texture's updated orientation field with signs that agree between neighbours, radians, 0..2 pi"""
    source_angle: Float32[np.ndarray, "H W"]
    """``angle`` at the source of each compaction pixel"""
    jacobian: Jacobian
    """rotation from the compaction's px to the texture's, at every texture pixel; the ``target_jacobian`` with
    which `per_pixel` and `reconstruct` orient their results like the texture"""
    energy: list[dict[str, Any]]
    """for each iteration: level; height and width of the compaction, px; number of updates of the orientation field
    before (``turned``); iteration (``round``); the energy and its weighted terms, inverse, forward and seams,
    squared CIELAB units per pixel; share of pixels changed since the previous one. The last is of the result"""


@stage(version=5, check=size_check("compact_oriented", "neighbourhood"))
def compact_oriented(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    angle: ScalarMap,
    params: CompactOrientedParams,
    rng: np.random.Generator,
    control: Image | None = None,
) -> CompactedOriented:
    """Summarise an oriented texture in a small compaction of constant orientation.

    Neighbourhoods of the texture are sampled along its orientation field, so that the compaction needs a structure
    in one orientation only. Both matches and the choice of pixels alternate as in `compact`. This is done first for
    a compaction of two neighbourhoods to a side, and the orientation field is updated: each neighbourhood is
    rotated to where that compaction matches it best, among the angles that agree with its neighbours; and it is
    solved again, also from new starts, of which the best continues. Then the compaction is solved for the given
    field and for the updated one of least energy; the better of the two is returned.

    Parameters
    ----------
    texture : the large texture.
    features : planes in which neighbourhoods are compared, CIELAB units; see `control_features`.
    angle : orientation field of the texture, see `orientation_field`; rows of the compaction run along it.
    control : control map copied with the texture; of any size of the same aspect ratio.

    Raises
    ------
    InputError
        the compaction is larger than the texture, or smaller than a neighbourhood.
    ValueError
        ``features`` or ``angle`` does not belong to the texture.

    Notes
    -----
    As in the paper, matches are found by exhaustive search, since clusters and candidates would have to be computed
    again for every orientation field. Neighbourhoods and the compaction's pixels are interpolated between those of
    the texture; ``source`` is the nearest of these. A field that is off by one angle everywhere is as good as the
    true one: the compaction is rotated by it. Unlike in the paper, fields are updated by a smaller compaction: one
    that holds much of the texture holds its wrong directions too.

    References
    ----------
    [Wei2008]_ section 4.2, w E-step; [Paris2004]_ for the smoothing.
    """
    require_features("compact_oriented", features, texture)
    size = wanted_size("compact_oriented", params.size, texture, None, params.neighbourhood)
    shape = features.shape[:2]
    if angle.shape != shape:
        raise ValueError(f"compact_oriented: angle {angle.shape} does not belong to features {features.shape}")
    energy: list[dict[str, Any]] = []
    fields = [signed_angles(angle)]
    if params.orientation_updates:
        fields.append(_refined(features, fields[0], lab_from_linear(texture.color), size, params, rng, energy))
    solved = []
    for number, field in enumerate(fields):
        rounds: list[dict[str, Any]] = []
        update, same = number * params.orientation_updates, copy.deepcopy(rng)
        solver, _ = _solved(features, field, size, None, params, same, update, rounds)
        solved.append((solver.source, field, rounds))
    solved.sort(key=lambda one: one[2][-1]["energy"], reverse=True)
    energy += [line for *_, rounds in solved for line in rounds]
    source, signed, _ = solved[-1]
    rounded = np.rint(source).astype(np.int32)
    nearest = Copied.of(texture, control, np.moveaxis(rounded, 0, 2))
    positive = np.asarray(signed % (2 * np.pi), np.float32)
    source_angle = np.ascontiguousarray(positive[rounded[0], rounded[1]])
    between = dataclasses.replace(nearest, image=interpolated_along(texture, source, rotations(-source_angle)))
    return CompactedOriented(
        **vars(between), angle=positive, source_angle=source_angle, jacobian=rotations(positive), energy=energy
    )


def _refined(
    features: Float32[np.ndarray, "h w c"],
    signed: ScalarMap,
    guide: ColorField,
    size: tuple[int, int],
    params: CompactOrientedParams,
    rng: np.random.Generator,
    energy: list[dict[str, Any]],
) -> ScalarMap:
    """The orientation field of least energy among the given one and its updates; appends to ``energy``.

    In a small compaction, neighbourhoods of different directions have to share their matches.
    """
    side = _REFINED_SIDE * params.neighbourhood
    small = (min(size[0], side), min(size[1], side))
    solver, coarsest = _solved(features, signed, small, None, params, rng, 0, energy)
    solved = [(energy[-1]["energy"], signed)]
    for update in range(1, params.orientation_updates + 1):
        # errors are smooth at first, and a field that is smoothed farther passes over wrong minima
        field = _updated_orientation(solver, guide, params, params.reach * (2 if update == 1 else 1))
        # Few blocks fit in, and where they cannot join, no field that is found makes up for it.
        tried = []
        for start in (coarsest, *[None] * _REFINED_STARTS):
            rounds: list[dict[str, Any]] = []
            tried.append((*_solved(features, field, small, start, params, rng, update, rounds), rounds))
        solver, coarsest, rounds = min(tried, key=lambda one: one[2][-1]["energy"])
        energy += rounds
        solved.append((rounds[-1]["energy"], field))
    field = min(solved, key=lambda one: one[0])[1]
    # One angle everywhere would only rotate the compaction.
    turn = phase_of(phasor((field - signed).astype(np.float64)).mean())
    return field - np.float32(turn)


def _solved(
    features: Float32[np.ndarray, "h w c"],
    signed: ScalarMap,
    size: tuple[int, int],
    source: Places | None,
    params: CompactOrientedParams,
    rng: np.random.Generator,
    update: int,
    energy: list[dict[str, Any]],
) -> tuple[OrientedLevel, Places]:
    """Solve all levels, from ``source`` or from blocks: the last level, and the sources of the first."""
    least = max(params.coarsest, params.neighbourhood)
    levels = level_count(features.shape[:2], 4 * params.neighbourhood, size, least)
    for level in range(1, levels + 1):
        shape, sides = (halved_size(whole, levels - level) for whole in (features.shape[:2], size))
        angle, planes = _resized_angle(signed, *shape), resize(features, *shape)
        if source is None:
            source = _start(planes, angle, sides, params.block, rng)
        elif level > 1:
            source = _doubled(source, sides, angle)
        spacing = max(1, params.spacing if level == levels else params.spacing - 1)
        solver = OrientedLevel(planes, angle, source, params.neighbourhood, spacing, params.alpha, params.seams)
        _solve(solver, params, level, update, energy)
        source = solver.source
        if level == 1:
            coarsest = source.copy()
        done = (update + level / levels) / (params.orientation_updates + 1)
        report(Progress(done, scale=level, scales=levels, energy=energy[-1]["energy"]))
    return solver, coarsest


def _resized_angle(angle: ScalarMap, height: int, width: int) -> Float32[np.ndarray, "H W"]:
    if angle.shape == (height, width):
        return angle
    return _angles(resize(_vectors(angle), height, width, bilinear=True))


def _offset_in_frame(angle: ScalarMap, origin: np.ndarray, offset: np.ndarray) -> Float32[np.ndarray, "2 ..."]:
    """Places in the texture at ``offset`` from ``origin`` in the frame there; both (2, ...), the result clipped."""
    at = np.clip(np.rint(origin).astype(int), 0, np.array(angle.shape).reshape(2, *[1] * (origin.ndim - 1)) - 1)
    sine, cosine = sin(angle[at[0], at[1]]), cos(angle[at[0], at[1]])
    row = origin[0] + offset[0] * cosine + offset[1] * sine
    column = origin[1] - offset[0] * sine + offset[1] * cosine
    return np.stack([np.clip(row, 0, angle.shape[0] - 1), np.clip(column, 0, angle.shape[1] - 1)]).astype(
        np.float32
    )


def _start(
    features: Float32[np.ndarray, "h w c"],
    angle: ScalarMap,
    size: tuple[int, int],
    block: int,
    rng: np.random.Generator,
) -> Places:
    """Oriented blocks of the texture, each the random candidate that differs least from those before it."""
    block = min(block, *angle.shape, *size)
    (rows, height), (columns, width) = (block_starts(side, block) for side in size)
    edge = min(block, (min(angle.shape) - 1) // 2)
    limits = np.array(angle.shape)[:, None] - edge
    origin = rng.integers(edge, limits, (2, _CANDIDATES * rows.size * columns.size))[:, :, None, None]
    offset = np.indices((height, width))[:, None] - block // 2
    shape = (2, origin.shape[1], height, width)
    origin, offset = np.broadcast_to(origin, shape), np.broadcast_to(offset, shape)
    blocks = np.moveaxis(np.rint(_offset_in_frame(angle, origin, offset)).astype(np.int32), 1, 0)

    def choose(number: int, joints: np.ndarray) -> int:
        first = number * _CANDIDATES
        return first + int(joints[first : first + _CANDIDATES].argmin())

    return lay(UNIT * features, blocks, rows, columns, size, choose).astype(np.float32)


def _doubled(source: Places, size: tuple[int, int], angle: ScalarMap) -> Float32[np.ndarray, "2 finer_H finer_W"]:
    """The same compaction at twice the resolution."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    coarse = 2.0 * source[:, rows[:, None] // 2, columns // 2] + 0.5
    offset = np.stack(np.broadcast_arrays((rows % 2)[:, None] - 0.5, columns % 2 - 0.5))
    return _offset_in_frame(angle, coarse, offset)


def _solve(
    solver: OrientedLevel, params: CompactOrientedParams, level: int, updates: int, energy: list[dict[str, Any]]
) -> None:
    """Alternate choice of pixels and matches until the energy hardly falls; appends to ``energy``."""
    height, width = solver.source.shape[1:]
    changed, last, has_searched = 1.0, np.inf, True
    for number in range(1, params.iterations + 1):
        inverse, forward, seams = solver.energy()
        total = inverse + forward + seams
        energy.append(
            {
                "level": level, "height": height, "width": width, "turned": updates, "round": number,
                "energy": total, "inverse": inverse, "forward": forward, "seams": seams, "changed": changed,
            }
        )  # fmt: skip
        is_slow = last - total <= params.tolerance * total
        if (is_slow and has_searched) or number == params.iterations:
            return
        last = total
        changed = solver.choose() / solver.source[0].size
        # A search takes most of the time, and pixels move nearly as well after every second one.
        has_searched = is_slow or not has_searched
        solver.match(has_searched)


def _updated_orientation(
    solver: OrientedLevel, guide: ColorField, params: CompactOrientedParams, reach: float
) -> ScalarMap:
    """The orientation field at which the compaction matches the texture best, smoothed over ``reach`` px."""

    chosen = np.arange(len(solver.places)).reshape(solver.grid)[::_ANGLE_STEP, ::_ANGLE_STEP]
    rows, columns = np.moveaxis(solver.places[chosen], 2, 0)
    step = _ANGLE_STEP * params.spacing
    near = np.ascontiguousarray(guide[rows, columns])
    mean = _angles(smoothed(_vectors(solver.angle[rows, columns]), near, reach / step, 200.0))
    best = solver.best_angles(chosen.ravel(), mean.ravel(), params.samples, _SEARCH_ROUNDS, params.within).reshape(
        chosen.shape
    )
    filtered = smoothed(_vectors(best), near, reach / step, 12.0)
    # The grid begins at the middle of the first neighbourhood.
    at = (np.indices(solver.angle.shape, np.float32) - params.neighbourhood // 2) / np.float32(step)
    return _angles(interpolated(filtered, at[0], at[1]))


def _vectors(angle: ScalarMap) -> Float32[np.ndarray, "h w 2"]:
    """Directions, not orientations: opposite ones cancel."""
    return np.stack([cos(angle), sin(angle)], axis=2).astype(np.float32)


def _angles(vectors: Float32[np.ndarray, "h w 2"]) -> ScalarMap:
    return np.asarray(arctan2(vectors[..., 1], vectors[..., 0]), np.float32)
