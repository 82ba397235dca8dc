"""Inverse texture synthesis of textures that turn: the compaction holds them in one direction."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import ColorField, Correspondence, Image, Jacobian, ScalarMap
from texloom.stages.color import lab_from_linear
from texloom.stages.common.control import resize_bilinear
from texloom.stages.common.neighbourhoods import UNIT
from texloom.stages.common.orientation import doubled, length_of, smoothed
from texloom.stages.common.pyramid import halved_size, resize
from texloom.stages.declare import OddSize, Params, stage
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import SIDES
from texloom.stages.synthesis._compaction.oriented import Costs, TurnedLevel
from texloom.stages.synthesis._compaction.start import begins, lay
from texloom.stages.synthesis._compaction.summary import Copied, require_features, wanted_size
from texloom.stages.synthesis.inverse.level import Source

_TRIES = 8  # random pieces that each piece of the start is chosen from


class CompactOrientedParams(Params):
    """How large, and how well; what is called as in `compact` means the same."""

    size: Annotated[tuple[int, int], SIDES] = (96, 96)
    """height and width of the compaction, px"""
    neighbourhood: OddSize = 7
    """side of the neighbourhoods that are compared, px"""
    alpha: float = Field(0.01, ge=1e-6, le=100)
    """weight of the forward term"""
    seams: float = Field(2.0, ge=0, le=100)
    """price of what is visible where pixels from different places meet"""
    spacing: int = Field(3, ge=1, le=16)
    """px between the texture's neighbourhoods that count"""
    coarsest: int = Field(24, ge=8, le=1024)
    """shorter side of the compaction at the first level, px, at least"""
    iterations: int = Field(12, ge=1, le=500)
    """most rounds at a level, and after each time that directions have changed"""
    tolerance: float = Field(0.005, ge=0, lt=1)
    """rounds end when one lowers the energy by no more than this share of it"""
    block: int = Field(14, ge=4, le=128)
    """side of the pieces of texture that the first level starts from, px"""
    turns: int = Field(2, ge=0, le=10)
    """times that directions are improved at the last level; 0 keeps them as given"""
    samples: int = Field(36, ge=4, le=360)
    """angles that are tried for a neighbourhood in each of three rounds"""
    reach: float = Field(4.0, gt=0, le=64)
    """px over which improved directions are averaged"""


@dataclasses.dataclass(frozen=True)
class CompactedOriented:
    """The compaction and the directions."""

    image: Image
    """all channels of the texture, copied"""
    control: Image | None
    """all channels of the control map, copied at the texture's size; none where there was none"""
    source: Correspondence
    """the texture pixel that each pixel is copied from"""
    angle: ScalarMap
    """the texture's improved directions, radians, 0..2 pi; a whole turn, as far as neighbours allow"""
    turn: Float32[np.ndarray, "H W"]
    """of each compaction pixel the direction that its source has in the texture, radians, 0..2 pi"""
    jacobian: Jacobian
    """from the compaction's px to the texture's, a turn, at every texture pixel; as ``target_jacobian`` of
    `per_pixel` it lets what is made of the compaction run as the texture does"""
    energy: list[dict[str, Any]]
    """for each round: the level; the times that directions have been improved; the round; the energy and its terms,
    inverse, forward and seams, weighted, squared CIELAB units a pixel; the share of pixels changed before it"""


def check_size(params: CompactOrientedParams, known: Mapping[str, Any]) -> None:
    """The compaction must fit in the texture."""
    if known.get("texture") is not None:
        wanted_size("compact_oriented", params.size, known["texture"], None, params.neighbourhood)


@stage(version=2, check=check_size)
def compact_oriented(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    angle: ScalarMap,
    params: CompactOrientedParams,
    rng: np.random.Generator,
    control: Image | None = None,
) -> CompactedOriented:
    """Summarise a texture that turns in a small one that does not.

    Neighbourhoods of the texture are read along its own directions, so that the compaction needs what turns only
    once. Both matches and the choice of pixels alternate as in `compact`. At the last level, directions are
    improved too: each neighbourhood is turned until the compaction holds it best, among the angles that agree with
    its neighbours.

    Parameters
    ----------
    features : what neighbourhoods are compared by, CIELAB units; see `control_features`.
    angle : directions of the texture, see `orientation_field`; rows of the compaction run along them.
    control : copied with the texture; of any size of the same aspect ratio.

    Raises
    ------
    InputError
        the compaction is larger than the texture, or does not hold a neighbourhood.
    ValueError
        inputs that do not belong together.

    Notes
    -----
    As in the paper all matches are sought by searching everything, as clusters and similarity sets would have to
    be made anew with every change of directions. Directions without sign are made whole turns first, along the way
    on which neighbours agree best. Neighbourhoods between pixels are interpolated; pixels are copied whole.

    References
    ----------
    [Wei2008]_ section 4.2, w E-step; [Paris2004]_ for the smoothing.
    """
    require_features("compact_oriented", features, texture)
    size = wanted_size("compact_oriented", params.size, texture, None, params.neighbourhood)
    shape = features.shape[:2]
    if angle.shape != shape:
        raise ValueError(f"compact_oriented: angle {angle.shape} does not belong to features {features.shape}")
    turn = whole_turns(angle)
    guide = lab_from_linear(texture.color)
    count = 1
    while (
        min(halved_size(size, count)) >= params.coarsest
        and min(halved_size(shape, count)) > 4 * params.neighbourhood
    ):
        count += 1
    energy: list[dict[str, Any]] = []
    source: Source | None = None
    for level in range(1, count + 1):
        here, sides = halved_size(shape, count - level), halved_size(size, count - level)
        frames = _resized(turn, *here)
        planes = resize(features, *here)
        if source is None:
            given = _start(planes, frames, sides, params.block, rng)
        else:
            given = _doubled(source, sides, frames)
        solver = TurnedLevel(
            planes, frames, given, params.neighbourhood,
            max(1, params.spacing if level == count else params.spacing - 1), Costs(params.alpha, params.seams),
        )  # fmt: skip
        improved = params.turns if level == count else 0
        for time in range(improved + 1):
            if time > 0:
                solver.face(_improved(solver, guide, params))
            _refine(solver, params, level, time, energy)
            done = (level - 1 + (time + 1) / (improved + 1)) / count
            report(Progress(done, scale=level, scales=count, energy=energy[-1]["energy"]))
        source, turn = solver.source, turn if level < count else solver.turn
    assert source is not None
    copied = Copied.of(texture, control, np.moveaxis(source, 0, 2))
    whole = np.asarray(turn % (2 * np.pi), np.float32)
    carried = np.ascontiguousarray(whole[source[0], source[1]])
    sine, cosine = np.sin(whole), np.cos(whole)
    jacobian = np.stack([cosine, sine, -sine, cosine], axis=2)
    return CompactedOriented(copied.image, copied.control, copied.source, whole, carried, jacobian, energy)


def whole_turns(angle: ScalarMap) -> ScalarMap:
    """Directions without sign as angles of a whole turn, so that neighbours point the same way where they can.

    Signs are handed on from pixel to pixel along the tree on whose branches directions differ least, also from
    those around: so it keeps away from the middles of whirls, across which signs would be wrong.
    """
    import cv2
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    height, width = angle.shape
    step = max(1, max(height, width) // 128)
    coarse = angle[::step, ::step].astype(np.float64)
    number = np.arange(coarse.size).reshape(coarse.shape)
    one = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    other = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    flat = coarse.ravel()
    around = cv2.blur(doubled(angle, np.ones_like(angle)), (4 * step + 1, 4 * step + 1))
    agreed = length_of(around)[::step, ::step].ravel()
    doubt = 1.001 - np.abs(np.cos(flat[one] - flat[other])) * np.minimum(agreed[one], agreed[other])
    tree = minimum_spanning_tree(coo_array((doubt, (one, other)), (flat.size, flat.size)).tocsr())
    order, before = breadth_first_order(tree, 0, directed=False)
    for place in order[1:]:
        if np.cos(flat[place] - flat[before[place]]) < 0:
            flat[place] += np.pi
    signed = cv2.resize(
        np.dstack([np.cos(flat), np.sin(flat)]).reshape(*coarse.shape, 2), (width, height),
        interpolation=cv2.INTER_NEAREST,
    )  # fmt: skip
    against = np.cos(angle) * signed[..., 0] + np.sin(angle) * signed[..., 1] < 0
    return np.asarray(np.where(against, angle + np.pi, angle), np.float32)


def _resized(turn: ScalarMap, height: int, width: int) -> Float32[np.ndarray, "H W"]:
    if turn.shape == (height, width):
        return turn
    planes = resize_bilinear(np.stack([np.cos(turn), np.sin(turn)], axis=2).astype(np.float32), height, width)
    return np.asarray(np.arctan2(planes[..., 1], planes[..., 0]), np.float32)


def _framed(turn: ScalarMap, origin: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Texture pixels that lie ``offset`` from ``origin`` in its frame; both (2, ...), the result clipped."""
    at = np.clip(np.rint(origin).astype(int), 0, np.array(turn.shape).reshape(2, *[1] * (origin.ndim - 1)) - 1)
    sine, cosine = np.sin(turn[at[0], at[1]]), np.cos(turn[at[0], at[1]])
    row = origin[0] + offset[0] * cosine + offset[1] * sine
    column = origin[1] - offset[0] * sine + offset[1] * cosine
    return np.stack(
        [np.clip(np.rint(row), 0, turn.shape[0] - 1), np.clip(np.rint(column), 0, turn.shape[1] - 1)]
    ).astype(np.int32)


def _start(
    features: Float32[np.ndarray, "h w c"],
    turn: ScalarMap,
    size: tuple[int, int],
    block: int,
    rng: np.random.Generator,
) -> Source:
    """Turned pieces of the texture, each the one of some random ones that goes best with those before it."""
    block = min(block, *turn.shape, *size)
    (rows, height), (columns, width) = (begins(side, block) for side in size)
    edge = min(block, (min(turn.shape) - 1) // 2)
    limits = np.array(turn.shape)[:, None] - edge
    origin = rng.integers(edge, limits, (2, _TRIES * rows.size * columns.size))[:, :, None, None]
    offset = np.indices((height, width))[:, None] - block // 2
    shape = (2, origin.shape[1], height, width)
    pieces = np.moveaxis(_framed(turn, np.broadcast_to(origin, shape), np.broadcast_to(offset, shape)), 1, 0)

    def choose(number: int, joints: np.ndarray) -> int:
        return number * _TRIES + int(joints[number * _TRIES : (number + 1) * _TRIES].argmin())

    return lay(UNIT * features, pieces, rows, columns, size, choose)


def _doubled(source: Source, size: tuple[int, int], turn: ScalarMap) -> np.ndarray:
    """The same compaction at twice the resolution."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    coarse = 2.0 * source[:, rows[:, None] // 2, columns // 2] + 0.5
    offset = np.stack(np.broadcast_arrays((rows % 2)[:, None] - 0.5, columns % 2 - 0.5))
    return _framed(turn, coarse, offset)


def _refine(
    solver: TurnedLevel, params: CompactOrientedParams, level: int, turned: int, energy: list[dict[str, Any]]
) -> None:
    """Rounds of choice and match until the energy hardly falls; what they cost is added to ``energy``."""
    changed = 1.0
    last = np.inf
    for number in range(1, params.iterations + 1):
        inverse, forward, seams = solver.energy()
        total = inverse + forward + seams
        energy.append(
            {
                "level": level, "turned": turned, "round": number, "energy": total, "inverse": inverse,
                "forward": forward, "seams": seams, "changed": changed,
            }
        )  # fmt: skip
        if last - total <= params.tolerance * total or number == params.iterations:
            return
        last = total
        changed = solver.choose() / solver.source[0].size
        solver.match()


def _improved(solver: TurnedLevel, guide: ColorField, params: CompactOrientedParams) -> ScalarMap:
    """Directions at which the compaction holds the texture better, smoothed."""
    vectors = np.stack([np.cos(solver.turn), np.sin(solver.turn)], axis=2)
    around = smoothed(vectors, guide, params.reach, 200.0)
    mean = np.arctan2(around[..., 1], around[..., 0])[solver.places[:, 0], solver.places[:, 1]]
    found = solver.better_turns(mean.astype(np.float32), params.samples, 3).reshape(solver.grid)
    height, width = solver.turn.shape
    # the grid begins in the middle of the first neighbourhood
    rows, columns = (
        np.clip((np.arange(side) - params.neighbourhood // 2) / params.spacing, 0, count - 1)
        for side, count in zip((height, width), solver.grid, strict=True)
    )
    finer = found[np.rint(rows).astype(int)[:, None], np.rint(columns).astype(int)]
    filtered = smoothed(np.stack([np.cos(finer), np.sin(finer)], axis=2), guide, params.reach, 12.0)
    return np.asarray(np.arctan2(filtered[..., 1], filtered[..., 0]), np.float32)
