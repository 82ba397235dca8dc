"""Texture on a surface: per-pixel synthesis over all its charts at once."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32
from pydantic import Field

from texloom.stages.analysis.similarity.appearance_stack import AppearanceStack
from texloom.stages.common.features.control import check_maps, matched_target
from texloom.stages.common.per_pixel.levels import NO_REPETITION
from texloom.stages.common.per_pixel.phases import phases_of
from texloom.stages.common.similarity.appearance import blurred_levels
from texloom.stages.common.surface.faces import Faces
from texloom.stages.common.surface.gutters import nearest_known
from texloom.stages.common.surface.surface_phases import surface_phases
from texloom.stages.common.surface.texels import texels_of
from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.control_maps.known_control import extrapolated, notes_on_target
from texloom.stages.synthesis.per_pixel.per_pixel import ArrangementParams, flat, prepare, style_of
from texloom.stages.synthesis.per_pixel.surface_levels import SurfaceLevels
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Jacobian, Mesh, Vectors
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.normals import turned
from texloom.stages.vocabulary.sizes import format_size

_FARTHEST = 1000.0  # ratio of an exemplar's pixel on the surface and one of the result
_LOG = logging.getLogger(__name__)

_LEVEL_STEP = 1 / 16  # of minification


class OnSurfaceParams(ArrangementParams):
    """How large the texture is on the surface, and how it is arranged."""

    texel_size: float | None = Field(None, gt=0)
    """side of an exemplar's pixel in world units (metres in glTF); null: as large as a pixel of the result is on
    average"""


@dataclasses.dataclass(frozen=True)
class OnSurface:
    """The texture in the surface's texture coordinates."""

    image: Image
    """the exemplar's pixels, all channels; normals are in the tangent space of the texture coordinates. Pixels
    outside the charts continue them"""
    match: Correspondence
    """for every pixel of the result the nearest pixel of the exemplar"""
    jacobian: Jacobian
    """from px of texture to px of the result; outside the charts that of the nearest pixel inside"""
    covered: Bool[np.ndarray, "H W"]
    """the pixels whose centre is in a chart; of several at the same place of the surface the first"""
    texel_size: float
    """side of an exemplar's pixel, world units"""


def check_sources(params: OnSurfaceParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """Control and target must fit the exemplar and each other."""
    check_maps(known)


@stage(version=1, check=check_sources)
def on_surface(
    image: Image,
    appearance: Annotated[Int16[np.ndarray, "levels h w 8"], Channels(tuple(f"c{n}" for n in range(8)))],
    basis: Int16[np.ndarray, "levels 64 8"],
    candidates: Int32[np.ndarray, "levels h w k"],
    toroidal: bool,
    mesh: Mesh,
    chart: Int32[np.ndarray, "*faces"],
    direction: Float32[np.ndarray, "corners 3"],
    height: int,
    width: int,
    params: OnSurfaceParams,
    rng: np.random.Generator,
    control: Image | None = None,
    target: Image | None = None,
    generators: Vectors | None = None,
) -> OnSurface:
    """Make a texture on a surface, without seams between its charts.

    As `per_pixel`, with a Jacobian at every pixel by which distances on the surface and the direction of the
    texture are as wanted, whatever the texture coordinates. A pixel beside a chart is a copy of what lies there on
    the surface, in this chart or another: it is updated whenever pixels of its parity are, so that charts continue
    each other at every level. Pixels at the same place of the surface are equal. Texture that repeats is laid in
    phase over the whole surface.

    Parameters
    ----------
    image : the exemplar; all channels are copied.
    appearance, basis, candidates, toroidal : its analysis, see `appearance_stack`.
    mesh : with texture coordinates, each place of which belongs to one face.
    chart : of each face; faces of a chart are connected in the texture, see `surface_charts`.
    direction : down in the texture at each corner, projected to the surface; see `surface_direction`.
    height, width : of the result, px.
    control : the exemplar's control map, see `per_pixel`.
    target : the control map that the result follows, in texture coordinates.
    generators : the two displacements by which the texture repeats, px, if it does; see `repetition`.

    Raises
    ------
    InputError
        the maps do not fit the exemplar or each other, or no pixel is on the surface.

    References
    ----------
    [LefebvreHoppe2006]_ section 5: synthesis in an atlas, distortion, and jumps between charts;
    [LefebvreHoppe2005]_ and [Wei2008]_ as for `per_pixel`. Unlike there, pixels beside a chart are found by
    unfolding the surface at the nearest place of its border.
    """
    target = matched_target(control, target)
    size = (height, width)
    faces = Faces(mesh, direction, size, 1.0)
    pixel = _mean_pixel(faces)
    if params.texel_size is not None and not pixel / _FARTHEST <= params.texel_size <= pixel * _FARTHEST:
        raise InputError(
            f"texel_size: {params.texel_size:g} is out of proportion to a pixel of the result, {pixel:g} on the "
            f"surface; at most {_FARTHEST:g} times smaller or larger"
        )
    faces.scale = params.texel_size or pixel
    stack = AppearanceStack(appearance, basis, candidates, toroidal)
    distortion = flat((image.height, image.width))
    tables, scale = prepare(image, stack, control, distortion, params.control_weight)
    wanted = None
    if target is not None and scale is not None:
        assert control is not None
        own = scale.of_control(control, image.height, image.width)
        wanted, rare = extrapolated(own, scale.of_control(target, *size), scale.strength)
        for note in notes_on_target(scale.beyond(target), rare):
            _LOG.warning(note)
        wanted = np.ascontiguousarray(wanted / np.float32(scale.strength))
    texels = texels_of(faces, chart, tables.levels)
    style, repetition = style_of(params, tables.levels, int(rng.integers(2**63))), NO_REPETITION
    if generators is not None and len(generators):
        own = phases_of(generators, tables.shape, tables.margin)
        repetition = own.repetition(surface_phases(texels, own.exact))
    levels = SurfaceLevels(tables, style, texels, wanted, repetition)
    levels.run()
    positions, places = levels.positions()
    count = texels[0].flat.size
    covered = _marked(places[:count], size)
    if not covered.any():
        raise InputError(f"size: no pixel of {format_size((height, width))} is on the surface; take a larger size")
    jacobian = np.zeros((*size, 4), np.float32)
    inside = _inside(places[:count], size)
    jacobian[tuple(places[:count][inside].T)] = texels[0].jacobian[0, inside]
    jacobian = jacobian.reshape(-1, 4)[nearest_known(covered)]
    source = _spread(positions, places, size)
    pixels = turned(_pixels(image, source, jacobian, toroidal), image.channels, jacobian)
    limits = image.height - 1, image.width - 1
    match = np.clip(np.floor(source + 0.5), 0, limits).astype(np.uint32)
    return OnSurface(image.elsewhere(pixels), match, jacobian, covered, float(faces.scale))


def _mean_pixel(faces: Faces) -> float:
    """Side of the pixel of mean area, world units."""
    down, across = np.moveaxis(faces.per_pixel[faces.usable], 2, 0)
    first, second = np.moveaxis(faces.pixels[faces.usable, 1:] - faces.pixels[faces.usable, :1], 1, 0)
    pixels = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    area = np.linalg.norm(np.cross(down, across), axis=1) * pixels
    return float(np.sqrt(area.sum() / pixels.sum()))


def _inside(places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.asarray(((places >= 0) & (places < size)).all(axis=1))


def _marked(places: np.ndarray, size: tuple[int, int]) -> Bool[np.ndarray, "H W"]:
    marked = np.zeros(size, bool)
    marked[tuple(places[_inside(places, size)].T)] = True
    return marked


def _spread(positions: np.ndarray, places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The positions, (n, 2), of the first place for each pixel, (H, W, 2); elsewhere of the nearest one."""
    inside = _inside(places, size)
    index, first = np.unique(matrix_product(places[inside], np.array([size[1], 1])), return_index=True)
    source, known = np.zeros((size[0] * size[1], 2)), np.zeros(size, bool)
    source[index] = positions[inside][first]
    known.ravel()[index] = True
    return np.asarray(source[nearest_known(known).ravel()].reshape(*size, 2))


def _pixels(image: Image, source: np.ndarray, jacobian: Jacobian, toroidal: bool) -> Float32[np.ndarray, "H W c"]:
    """The exemplar between its pixels, where texture is minified at the level of detail of the distortion."""
    from texloom.stages.kernels.core.resample import sampled

    a, b, c, d = np.moveaxis(jacobian.astype(np.float64), 2, 0)
    level = np.clip(-0.5 * log2(np.abs(a * d - b * c)), 0, log2(min(image.height, image.width)))
    level = np.rint(level / _LEVEL_STEP) * _LEVEL_STEP  # rounding must not differ between charts
    count = int(np.ceil(level.max())) + 1
    stack = blurred_levels(image.pixels, count, toroidal)
    pixels = sampled(stack[0], source)
    for number in range(1, count):
        share = np.clip(level - (number - 1), 0, 1).astype(np.float32)
        at = np.nonzero(share > 0)
        finer = pixels[at]
        pixels[at] = finer + share[at][:, None] * (sampled(stack[number], source[at]) - finer)
    return pixels
