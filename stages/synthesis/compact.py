"""Inverse texture synthesis: a small texture that holds all that a large one has."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, UInt32
from pydantic import Field

from texloom.stages.analysis.k_coherence import Candidates, KCoherenceParams
from texloom.stages.analysis.tsvq import Leaf, Nodes, TsvqParams
from texloom.stages.arrays import Channels, Correspondence, Image
from texloom.stages.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.common.control import resize_control
from texloom.stages.common.neighbourhoods import Rectangles, inside_at, inside_of
from texloom.stages.common.pyramid import halved_size, resize
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import SIDES
from texloom.stages.synthesis._compaction.start import start
from texloom.stages.synthesis.inverse.level import Level, Matching, Source, Tree, nearest_in

_LONGEST_RUN = 368  # values in a neighbourhood's row up to which distances are exact


class CompactParams(Params):
    """How large, and how well."""

    size: Annotated[tuple[int, int] | Annotated[float, Field(gt=0, lt=1)] | Literal["auto"], SIDES] = "auto"
    """height and width of the compaction, px; a number below 1: that share of the texture's pixels, in a square;
    `auto`: a quarter as many pixels as the texture's neighbourhoods have clusters, in the texture's aspect ratio,
    square for an atlas"""
    solver: Literal["improved", "basic"] = "improved"
    """`improved`: pixels are copied, matches found by k-coherence and clusters; `basic`, for comparison: pixels are
    means, matches found by searching everything; its picture is then copied from the best matches"""
    alpha: float = Field(0.01, ge=1e-6, le=100)
    """weight of the forward term: how much the compaction must look like the texture everywhere, against holding
    all that the texture has"""
    terms: Literal["both", "forward", "inverse"] = "both"
    """`forward`: only that the compaction looks like the texture, so that it need not hold all that it has;
    `inverse`: only that it holds all, so that anything may stand between; both alone are for comparison"""
    seams: float = Field(0.6, ge=0, le=100)
    """price of what is visible where pixels from different places meet; 0 is the paper's: then pixels near the mean
    of many neighbourhoods win and fine detail is lost; 2 keeps all detail and less of what the texture has"""
    spacing: int = Field(2, ge=1, le=8)
    """px between the texture's neighbourhoods that count"""
    coarsest: int = Field(24, ge=8, le=1024)
    """shorter side of the compaction at the first level, px, at least"""
    iterations: int = Field(20, ge=1, le=500)
    """most rounds at a level"""
    tolerance: float = Field(0.002, ge=0, lt=1)
    """a level ends when a round lowers the energy by no more than this share of it"""
    block: int = Field(14, ge=4, le=128)
    """side of the pieces of texture that the first level starts from, px"""
    proportion: float = Field(0.0, ge=0, le=100)
    """how much the first level keeps to the shares that things have in the texture, where 1 is much; 0 is the
    paper's: then rare things take as much room as frequent ones"""
    tileable: bool = False
    """the compaction continues across its borders, so that all of it serves exemplars of `per_pixel`, which use
    little of what lies at a border"""
    start: Literal["cover", "random"] = "cover"
    """`cover`: pieces that together hold most of what the texture has, laid so that they fit; `random`: any, as in
    the paper"""


Origin: TypeAlias = Annotated[UInt32[np.ndarray, "H W 3"], Channels(("texture", "row", "column"))]
"""for every pixel the texture that it comes from, from 0, and the pixel within that"""


@dataclasses.dataclass(frozen=True)
class CompactLevel:
    """The state after a level, from which the next one goes on."""

    source: Correspondence
    """the texture pixel of each compaction pixel, at this level"""
    image: Image
    """the compaction so far"""
    energy: list[dict[str, Any]]
    """the rounds so far; see `Compacted`"""


@dataclasses.dataclass(frozen=True)
class Compacted:
    """The compaction."""

    image: Image
    """all channels of the texture, copied"""
    control: Image | None
    """all channels of the control map, copied at the texture's size; none where there was none"""
    source: Correspondence
    """the texture pixel that each pixel is copied from"""
    origin: Origin | None
    """the texture and its pixel that each pixel is copied from, where several are in an atlas; else none"""
    tileable: bool
    """whether it wraps around"""
    sides: list[int]
    """height and width, px"""
    energy: list[dict[str, Any]]
    """for each round of each level, coarsest first: the level; the compaction's height and width, px; the round;
    the energy and its terms, inverse, forward and seams, weighted, squared CIELAB units a pixel; and the share of
    pixels changed by the choice before it"""


def check_texture(params: CompactParams, known: Mapping[str, Any]) -> None:
    """The compaction must fit in the texture."""
    texture = known.get("texture")
    if texture is None or not isinstance(params.size, tuple):
        return
    if params.size[0] > texture.height or params.size[1] > texture.width:
        raise InputError(
            f"compact: size={params.size[0]}x{params.size[1]} px is larger than the texture of "
            f"{texture.height}x{texture.width} px"
        )


def _automatic(shape: tuple[int, int], clusters: int, least: int) -> tuple[int, int]:
    """A quarter as many pixels as ``clusters``, in the aspect ratio of ``shape`` [Wei2008]_ section 5.

    The shorter side is at least ``least`` px.
    """
    factor = math.sqrt(0.25 * clusters / (shape[0] * shape[1]))
    factor = min(1.0, max(factor, least / min(shape)))
    return max(1, round(shape[0] * factor)), max(1, round(shape[1] * factor))


def _by_share(share: float, pixels: int, shape: tuple[int, int]) -> tuple[int, int]:
    """A square of a share of ``pixels``, its sides whole multiples of 8 px; within ``shape``."""
    side = min(max(8, 8 * round(math.sqrt(share * pixels) / 8)), *shape)
    return side, side


def _level_count(texture: tuple[int, int], size: tuple[int, int], coarsest: int, neighbourhood: int) -> int:
    """Levels, each half as large as the next, down to the least sides of compaction and texture."""
    count = 1
    while (
        min(halved_size(size, count)) >= max(coarsest, neighbourhood)
        and min(halved_size(texture, count)) > 2 * neighbourhood
    ):
        count += 1
    return count


def _doubled(source: Source, size: tuple[int, int], inside: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """The same compaction at twice the resolution."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    coarse = source[:, rows[:, None] // 2, columns // 2]
    finer = 2 * coarse + np.stack(np.broadcast_arrays(rows[:, None] % 2, columns % 2))
    return np.asarray(nearest_in(inside, finer))


def _refine(
    matching: Matching, params: CompactParams, level: int, done: tuple[float, float], count: int, preview: Any
) -> list[dict[str, Any]]:
    rounds: list[dict[str, Any]] = []
    height, width = matching.source.shape[1:]
    basic = params.solver == "basic"
    changed = 1.0
    while True:
        if basic:
            matching.match_inverse(matching.propose_by_search())
            matching.match_forward_by_search()
        else:
            matching.match_inverse(matching.propose_by_centres(height * width))
            matching.match_forward_by_coherence()
        inverse, forward, seams = matching.energy()
        energy = inverse + forward + seams
        rounds.append(
            {
                "level": level, "height": height, "width": width, "round": len(rounds) + 1,
                "energy": energy, "inverse": inverse, "forward": forward, "seams": seams, "changed": changed,
            }
        )  # fmt: skip
        ended = (
            len(rounds) == params.iterations
            or energy == 0
            or (len(rounds) > 1 and rounds[-2]["energy"] - energy <= params.tolerance * energy)
        )
        share = 1.0 if ended else len(rounds) / params.iterations
        report(
            Progress(
                done=done[0] + (done[1] - done[0]) * share,
                scale=level, scales=count, iteration=len(rounds), iterations=params.iterations,
                energy=energy, preview=preview,
            )
        )  # fmt: skip
        if ended:
            return rounds
        if basic:
            matching.average()
        else:
            changed = matching.choose() / (height * width)


@stage(version=2, check=check_texture)
def compact(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    nodes: Nodes,
    leaf: Leaf,
    candidates: Candidates,
    params: CompactParams,
    rng: np.random.Generator,
    control: Image | None = None,
    rectangles: Rectangles | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Compacted:
    """Summarise a texture in a small one, so that every neighbourhood of the texture is found in it and no others.

    Three steps alternate at every level: each neighbourhood of the texture finds the best place in the compaction
    (the inverse match: the centres of its clusters search the whole compaction, the others take their centre's
    place or one that continues a neighbour's match); each neighbourhood of the compaction finds the best place in
    the texture (the forward match, by k-coherence); each pixel is chosen anew among what its surroundings' sources
    resemble, so that the energy falls most.

    Parameters
    ----------
    texture : any number of channels, which are copied together.
    features : what neighbourhoods are compared by, CIELAB units; see `control_features`.
    nodes, leaf : clusters of the neighbourhoods; see `tsvq`. Their side is the neighbourhood's.
    candidates : see `k_coherence`.
    control : copied with the texture; of any size of the same aspect ratio.
    rectangles : of the textures, where ``texture`` is an atlas of several; see `atlas`. What lies between them is
        left out.

    Raises
    ------
    InputError
        the compaction is larger than the texture, or does not hold a neighbourhood.
    ValueError
        inputs that do not belong together.

    Notes
    -----
    Where the paper replaces matches at every step, here a match is kept until a better one is found, so the energy
    never rises within a level. For given matches the cheapest pixel is the candidate nearest to the weighted mean
    of all pixels that are matched with it; alone that favours smooth places. So there is also a price on seams, as
    in [Kwatra2003]_, and pixels are chosen one after the other. Orientation fields are not used.

    References
    ----------
    [Wei2008]_ equation (1), sections 3 to 5; [Kwatra2005]_ for the basic solver.
    """
    check_texture(params, {"texture": texture})
    shape = (texture.height, texture.width)
    neighbourhood = shape[0] - leaf.shape[0] + 1
    expected = (shape[0] - neighbourhood + 1, shape[1] - neighbourhood + 1)
    if features.shape[:2] != shape or leaf.shape != expected or candidates.shape[:2] != expected:
        raise ValueError(
            f"features {features.shape}, leaf {leaf.shape} and candidates {candidates.shape} "
            f"do not belong to a texture of {shape[0]}x{shape[1]} px"
        )
    if features.shape[2] * neighbourhood > _LONGEST_RUN:
        raise InputError(
            f"compact: {features.shape[2]} channels in neighbourhoods of {neighbourhood} px are too many; at most "
            f"{_LONGEST_RUN // neighbourhood} channels can be compared"
        )
    clusters = int((nodes[:, 1] < 0).sum())
    whole = shape if rectangles is None else (min(shape), min(shape))
    inside = inside_of(rectangles, *shape)
    if params.size == "auto":
        size = _automatic(whole, clusters, 2 * neighbourhood)
    elif isinstance(params.size, float):
        size = _by_share(params.size, int(inside.sum()), whole)
    else:
        size = params.size
    if min(size) < neighbourhood:
        raise InputError(
            f"compact: size={size[0]}x{size[1]} px does not hold a neighbourhood of {neighbourhood} px"
        )

    smallest = shape if rectangles is None else (int(rectangles[:, 2].min()), int(rectangles[:, 3].min()))
    count = _level_count(smallest, size, params.coarsest, neighbourhood)
    costs = np.cumsum([0.0] + [16.0**level for level in range(count)])
    seams = 0.0 if params.solver == "basic" else params.seams
    alpha = {"both": params.alpha, "forward": 1.0, "inverse": 0.0}[params.terms]
    source: Source | None = None
    energy: list[dict[str, Any]] = []
    first = 0
    resumed = checkpoints.latest(CompactLevel)
    if resumed is not None:
        first, state = resumed
        source, energy = np.moveaxis(state.source.astype(np.int32), 2, 0), list(state.energy)

    for level in range(first + 1, count + 1):
        halvings = count - level
        here, sides = halved_size(shape, halvings), halved_size(size, halvings)
        data = Level(
            resize(features, *here), neighbourhood, params.spacing,
            Tree(nodes, leaf, candidates) if level == count else None,
            TsvqParams(neighbourhood=neighbourhood), KCoherenceParams(k=candidates.shape[2]),
            inside_at(inside, *here),
        )  # fmt: skip
        small = resize(texture.pixels, *here)
        if source is None:
            source = start(data, sides, params.block, params.start, seams, params.proportion, params.tileable, rng)
        elif level > 1:
            source = _doubled(source, sides, data.inside)
        matching = Matching(
            data, np.ascontiguousarray(source), alpha, seams, float(params.terms != "forward"), params.tileable
        )

        def picture(matching: Matching = matching, small: np.ndarray = small) -> Image:
            return Image(_copied(small, matching.source), texture.channels)

        done = (float(costs[level - 1] / costs[-1]), float(costs[level] / costs[-1]))
        energy += _refine(matching, params, level, done, count, picture)
        source = matching.source if params.solver == "improved" else matching.source_of_forward()
        matching.source = source
        if level < count:
            checkpoints.save(level, CompactLevel(_as_correspondence(source), picture(), list(energy)))
    assert source is not None
    copied = None
    if control is not None:
        copied = Image(_copied(resize_control(control, *shape).pixels, source), control.channels)
    return Compacted(
        image=Image(_copied(texture.pixels, source), texture.channels),
        control=copied,
        source=_as_correspondence(source),
        origin=None if rectangles is None else _origin(source, rectangles),
        tileable=params.tileable,
        sides=list(size),
        energy=energy,
    )


def _origin(source: Source, rectangles: Rectangles) -> Origin:
    row, column, height, width = rectangles.T[:, :, None, None]
    within = (source[0] >= row) & (source[0] < row + height) & (source[1] >= column) & (source[1] < column + width)
    texture = within.argmax(axis=0)
    return np.stack(
        [texture, source[0] - rectangles[texture, 0], source[1] - rectangles[texture, 1]], axis=2
    ).astype(np.uint32)


def _copied(pixels: Float32[np.ndarray, "h w c"], source: Source) -> Float32[np.ndarray, "H W c"]:
    return np.ascontiguousarray(pixels[source[0], source[1]])


def _as_correspondence(source: Source) -> Correspondence:
    return np.ascontiguousarray(np.moveaxis(source, 0, 2).astype(np.uint32))
