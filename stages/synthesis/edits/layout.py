"""A rough collage as a layout: what of it is kept, and what guides the rest."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from pydantic import Field

from texloom.stages.common.grids.pyramid import resize, scale_sizes, scaled
from texloom.stages.common.grids.size_checks import check_patch
from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point, places
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.numerics.filters import padded
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.edits.collage_phase import CollagePhase
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.match_search import Effort, Search
from texloom.stages.synthesis.optimisation.vote import pad_torus
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Mask, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import (
    USABLE,
    FilledExemplar,
    fill_excluded,
    nearest_valid,
    valid_pixels,
    without_usable,
)
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_PATCH = 10  # px
_COARSEST, _RATIO = 35, 1.6  # first scale of the search for the layout's pixels in the exemplar, and scales' ratio
_EFFORT = Effort(sweeps=8, tries=8, fill_tries=0, tolerance=0.002)
_EXACT = 6.0  # squared CIELAB units per pixel, up to which a patch is one of the exemplar; compressed copies differ
_JOINT = 2.5  # times the differences around it, above which that of a patch is one across a joint
_AROUND = 41  # px of the window around it
_SHARE = 0.35  # quantile of the differences in that window that counts
_STEP = 4  # px of the grid that the quantile is taken on
_MIN_EXTENT = 32  # px of the diagonal of a joint's bounding box
_MIN_KEPT = 9  # px of the side of what is kept
_GAP = 32  # px between exemplar and layout in one picture, at least
_MIN_UPRIGHT = 0.8  # share of a collage's pixels that are neither turned nor scaled, for a lattice to hold there
_COARSE_BLUR = 1 / 12  # of the exemplar's shorter side: standard deviation of what guides at strength 0
_FINE_BLUR = 3.0  # px, at strength 1


class LayoutParams(Params):
    """How much of the collage is kept."""

    strength: float = Field(0.5, ge=0, le=1)
    """0: only the coarse colours and structure guide a new texture; 1: the collage stays as it is but for its
    joints; between: that share of the collage is kept, from the middles of its pieces outwards, and the rest is
    guided the more finely"""
    tileable: Tileable = NOWHERE
    """the collage is to continue across its borders, which become joints where it does not"""


@dataclasses.dataclass(frozen=True)
class CollageLayout:
    """What the optimisation takes to rectify the collage."""

    image: Image
    """the exemplar and, to its right, the collage, in phase with its lattice; a channel `usable` is 0 between them,
    and where the collage is not kept"""
    start: Correspondence
    """for every pixel of the collage its source in ``image``: itself where it is kept, else in the exemplar"""
    keep: Mask
    """true where the collage is kept"""
    joints: Mask
    """true at joints and where nothing is laid"""
    generators: Vectors
    """the exemplar's lattice, px, if the collage can follow it; else no rows"""
    exemplar_guide: Annotated[Float32[np.ndarray, "rows columns k"], Channels(("L", "a", "b", "detail"))]
    """coarse colour, and strength of the finer detail, of ``image``, CIELAB units"""
    target_guide: Annotated[Float32[np.ndarray, "H W k"], Channels(("L", "a", "b", "detail"))]
    """the same of the collage; NaN where nothing is laid"""


def check_layout(params: LayoutParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """Exemplar and layout must contain more than one patch, and something must be laid."""
    image, layout = known.get("image"), known.get("layout")
    for one in (image, layout):
        if one is not None:
            check_patch(one, 2 * _PATCH)
    if isinstance(layout, Image):
        try:
            valid_pixels(layout)
        except InputError:
            raise InputError("layout: all of it is transparent") from None


def outlines(params: LayoutParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """Exemplar and layout beside each other, without what a lattice adds; the start has the layout's size."""
    image, layout = known.get("image"), known.get("layout")
    if image is None or layout is None:
        return {}
    kept = tuple(name for name in image.channels if name != USABLE)
    height, width = max(image.height, layout.height), image.width + _GAP + layout.width
    sizes = {"start": layout, "keep": layout, "target_guide": layout}
    return {
        "image": Outline(height, width, (*kept, USABLE)),
        **{name: Outline(one.height, one.width) for name, one in sizes.items()},
    }


@stage(version=1, check=check_layout, outlines=outlines)
def layout(
    image: Image,
    layout: Image,
    params: LayoutParams,
    rng: np.random.Generator,
    pieces: Int32[np.ndarray, "H W"] | None = None,
    generators: Vectors | None = None,
) -> CollageLayout:
    """Find the joints of a collage, and decide by ``strength`` what of it is kept and how the rest is guided.

    Each patch of the collage is searched in the exemplar. Where it is there, it lies inside a piece; where it is
    much less similar than most, it lies across a joint. What is kept is laid beside the exemplar, so that also
    pieces that were turned or scaled continue in themselves.

    Where the exemplar has a lattice, and nearly all of the collage is neither turned nor scaled, all that is
    synthesised has the phase of most of the collage. Pieces that are out of phase by more than half a cell times
    ``strength`` squared are not kept but guide what replaces them.

    Parameters
    ----------
    image : the exemplar.
    layout : the collage, of the result's size; transparent where nothing is laid. Of maps that it lacks, the
        exemplar's are taken where its colours were found.
    pieces : number of the piece of each pixel, negative where nothing is laid, if that is known; see `collage`.
    generators : of the exemplar's lattice, px, two rows, or one, at right angles to courses; none or no rows where
        it has none.

    Raises
    ------
    InputError
        exemplar or layout is too small, or nothing is laid.

    References
    ----------
    [Zhou2024]_ for the idea of rectifying a collage, [Barnes2009]_ for the search. The rest is ours.
    """
    compared = FilledExemplar.of(image)
    exemplar = compared.image
    laid, filled = valid_pixels(layout), fill_excluded(layout)
    match, difference = _found(compared, filled, params.tileable, rng)
    sources = correspondence.to_pixels(match, _PATCH, params.tileable)
    complete = _with_maps(filled, exemplar, sources)
    joints = _joints(difference, layout, pieces, params.tileable)
    if laid is not None:
        joints |= ~laid
        sources = _continued(sources, laid, (image.height, image.width))
    lattice, corner = np.zeros((0, 2), np.float32), np.array([0, image.width + _GAP])
    fixed = joints
    if generators is not None and len(generators):
        phase = CollagePhase(generators, sources, ~joints)
        if phase.upright >= _MIN_UPRIGHT:
            lattice, corner = generators, phase.corner(image.width + _GAP)
            fixed = joints | (phase.error > 0.5 * params.strength**2)
    keep = _kept(fixed, params)
    start = sources.copy()
    start[keep] = np.argwhere(keep) + corner
    joined = _beside(without_usable(image), complete, compared.valid, keep, corner)
    own, target = (
        _guide(one, _blur(image, params.strength), wrap)
        for one, wrap in ((exemplar, NOWHERE), (filled, params.tileable))
    )
    guide = np.zeros((joined.height, joined.width, own.shape[2]), np.float32)
    guide[: image.height, : image.width], guide[corner[0] :, corner[1] :][: layout.height] = own, target
    if laid is not None:
        target = np.where(laid[..., None], target, np.float32(np.nan))
    return CollageLayout(joined, start.astype(np.uint32), keep, joints, lattice, guide, target)


def _found(
    exemplar: FilledExemplar, layout: Image, wrap: Wraps, rng: np.random.Generator
) -> tuple[Patches, Float32[np.ndarray, "p q"]]:
    """The most similar exemplar patch of every patch of the layout, and their squared difference per pixel."""
    from texloom.stages.kernels.patchmatch.search import Target, match_distances

    planes, usable = [exemplar.lab, lab_from_linear(layout.color)], exemplar.valid
    extra = wrap.where_open(_PATCH - 1)
    match: Patches | None = None
    factors = scale_sizes(exemplar.image.height, exemplar.image.width, _COARSEST, _RATIO)
    least = 2 * _PATCH / min(layout.height, layout.width)
    factors = [factor for factor in factors if factor >= least] or [1.0]
    before = 1.0
    for number, factor in enumerate(factors):
        sides = [[scaled(side, factor) for side in plane.shape[:2]] for plane in planes]
        own, target = (
            fixed_point(resize(plane, side[0], side[1])) for plane, side in zip(planes, sides, strict=True)
        )
        if wrap:
            target = pad_torus(target, 3, _PATCH, wrap)
        patches = (sides[1][0] - extra[0], sides[1][1] - extra[1])
        free = places(sides[0][0], sides[0][1], _PATCH)
        if match is None:
            match = np.stack([rng.integers(0, count, patches) for count in free]).astype(np.int32)
        else:
            match = correspondence.rescale(match, patches, free, factor / before)
        allowed = None if usable is None else Allowed(usable, sides[0][0], sides[0][1], _PATCH)
        if allowed is not None and allowed.places.any():
            match = allowed.moved(match)
        search = Search(own, 3, _PATCH, free, patches, wrap, 0.0, 1.0, allowed)
        for _ in range(2):
            search.step(target, match, _EFFORT, rng)
        before = factor
        report(Progress((number + 1) / len(factors)))
    assert match is not None
    matches = Target(target, match[0], match[1], np.empty(match.shape[1:], np.int64), search.active)
    run_spans(match_distances, (search.shape, matches, own), match.shape[1], 16)
    return match, (matches.distance / (UNIT**2 * _PATCH**2)).astype(np.float32)


def _joints(
    difference: Float32[np.ndarray, "p q"], layout: Image, pieces: Int32[np.ndarray, "H W"] | None, wrap: Wraps
) -> Mask:
    """Pixels in the middle of patches that lie across a joint."""
    if pieces is None:
        across = _unlike(difference, wrap)
    else:
        edges = [(0, beyond) for beyond in wrap.where_closed(_PATCH - 1)]
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(pieces, edges, mode="wrap"), (_PATCH, _PATCH))
        across = windows.min(axis=(2, 3)) != windows.max(axis=(2, 3))
    middle = _PATCH // 2
    for axis in (0, 1):
        if wrap[axis]:
            # Whatever goes on across the border unlike the exemplar is a joint.
            border = (slice(1 - _PATCH, None), slice(None))[:: 1 if axis == 0 else -1]
            across[border] |= difference[border] > _EXACT
    for axis, side in enumerate((layout.height, layout.width)):
        if wrap[axis]:
            across = np.roll(across, middle, axis=axis)
        else:
            ends = (middle, side - across.shape[axis] - middle)
            across = np.pad(across, [ends if axis == padded else (0, 0) for padded in (0, 1)], mode="edge")
    return across


def _unlike(difference: Float32[np.ndarray, "p q"], wrap: Wraps) -> Mask:
    """Patches that are much less similar to the exemplar than those around them, which may be turned or scaled."""
    import cv2

    ndimage = loaded("scipy.ndimage")
    some = np.ascontiguousarray(difference[::_STEP, ::_STEP])
    size, radius = some.shape, _AROUND // _STEP // 2 + 1
    some = padded(some, radius, wrap.modes("edge"))  # the filter has one mode for both axes
    usual = ndimage.percentile_filter(some, 100 * _SHARE, _AROUND // _STEP)
    usual = usual[radius : radius + size[0], radius : radius + size[1]]
    usual = resize(usual[..., None], difference.shape[0], difference.shape[1], bilinear=True)[..., 0]
    across = (difference > np.maximum(_EXACT, _JOINT * usual)).astype(np.uint8)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(across, connectivity=8)
    long = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) >= _MIN_EXTENT
    long[0] = False
    return np.asarray(long[labels])


def _kept(joints: Mask, params: LayoutParams) -> Mask:
    """The share ``strength`` of the pixels without joints that are farthest from them, without slivers."""
    import cv2

    ndimage = loaded("scipy.ndimage")
    if params.strength == 0 or joints.all():
        return np.zeros_like(joints)
    height, width = joints.shape
    down, across = (side if around else 0 for side, around in zip(joints.shape, params.tileable, strict=True))
    padding = ((down, down), (across, across))
    inner = slice(padding[0][0], padding[0][0] + height), slice(padding[1][0], padding[1][0] + width)
    padded = np.pad(joints, padding, mode="wrap")
    keep = ~padded
    if params.strength < 1 and joints.any():
        distance = ndimage.distance_transform_edt(keep)
        keep = distance > np.quantile(distance[inner][~joints], 1 - params.strength)
    square = np.ones((_MIN_KEPT, _MIN_KEPT), np.uint8)
    keep = np.pad(keep, _MIN_KEPT, mode="edge").astype(np.uint8)
    keep = cv2.morphologyEx(keep, cv2.MORPH_OPEN, square)[_MIN_KEPT:-_MIN_KEPT, _MIN_KEPT:-_MIN_KEPT]
    return np.ascontiguousarray(keep[inner] == 1)


def _continued(sources: np.ndarray, laid: Mask, shape: tuple[int, int]) -> np.ndarray:
    """Sources where nothing is laid: those of the nearest piece, as the exemplar continues there, mirrored."""
    row, column = nearest_valid(laid)
    nearest = np.stack([row, column], axis=2)
    beyond = np.moveaxis(np.indices(laid.shape), 0, 2) - nearest
    places = sources[row, column].astype(np.int64) + beyond
    period = 2 * np.array(shape) - 2
    places = np.abs((places + np.array(shape) - 1) % period - (np.array(shape) - 1))
    return np.where(laid[..., None], sources, places).astype(np.uint32)


def _with_maps(layout: Image, exemplar: Image, sources: Correspondence) -> Image:
    """The layout with the channels of the exemplar."""
    if "Y" in exemplar.channels and "R" in layout.channels:
        _LOG.warning(
            "the layout's colours are dropped, as the exemplar is grey; give an exemplar in colour to keep them"
        )
    elif "R" in exemplar.channels and "Y" in layout.channels:
        _LOG.warning("the layout is grey, taken as three equal channels, as the exemplar is in colour")
    planes = exemplar.pixels[sources[..., 0], sources[..., 1]]
    grey = matrix_product(layout.color, np.array([0.2126, 0.7152, 0.0722], np.float32))
    for index, name in enumerate(exemplar.channels):
        if name in layout.channels:
            planes[..., index] = layout.pixels[..., layout.channels.index(name)]
        elif name in ("R", "G", "B"):
            planes[..., index] = layout.color[..., "RGB".index(name)]
        elif name == "Y":
            planes[..., index] = grey
    return exemplar.elsewhere(planes)


def _beside(
    image: Image, layout: Image, usable: Mask | None, keep: Bool[np.ndarray, "H W"], corner: Int64[np.ndarray, "2"]
) -> Image:
    """Exemplar and layout, which begins at ``corner``, in one picture, with `usable`."""
    height = max(image.height, corner[0] + layout.height)
    pixels = np.zeros((height, corner[1] + layout.width, len(image.channels) + 1), np.float32)
    pixels[: image.height, : image.width, :-1] = image.pixels
    pixels[: image.height, : image.width, -1] = 1 if usable is None else usable
    pixels[corner[0] :, corner[1] :][: layout.height, :, :-1] = layout.pixels
    pixels[corner[0] :, corner[1] :][: layout.height, :, -1] = keep
    return image.elsewhere(pixels, (*image.channels, USABLE))


def _blur(image: Image, strength: float) -> float:
    """Standard deviation of the blur whose result guides, px."""
    coarse = max(_FINE_BLUR, _COARSE_BLUR * min(image.height, image.width))
    return float(coarse ** (1 - strength) * _FINE_BLUR**strength)


def _guide(image: Image, sigma: float, wrap: Wraps) -> Float32[np.ndarray, "h w 4"]:
    """Colour after a blur, and the deviation of lightness from it."""
    ndimage = loaded("scipy.ndimage")
    mode = wrap.modes("nearest")
    lab = lab_from_linear(image.color)
    coarse = np.stack(
        [ndimage.gaussian_filter(plane, sigma, mode=mode) for plane in np.moveaxis(lab, 2, 0)], axis=2
    )
    detail = np.sqrt(ndimage.gaussian_filter((lab[..., 0] - coarse[..., 0]) ** 2, sigma, mode=mode))
    return np.concatenate([coarse, detail[..., None]], axis=2).astype(np.float32)
