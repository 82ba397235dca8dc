"""Where the light came from in photographs of one place under several lights."""

import dataclasses
import itertools
import logging
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.kernels.core.elementary_functions import arctan2, cos, sin
from texloom.stages.numerics.matrices import eigenvectors, inverse_of, least_squares, matrix_product, square_sums
from texloom.stages.vocabulary.arrays import Channels, Image
from texloom.stages.vocabulary.declare import Document, InputError, Params, stage
from texloom.stages.vocabulary.frame_stacks import frame_count, frames_of

_LOG = logging.getLogger(__name__)

Directions = Annotated[Float32[np.ndarray, "n 3"], Channels(("x", "y", "z"))]
"""unit vectors towards lights: x right, y up, z towards the camera"""

LEAST = 3
_LEAST_ESTIMATED = 6
_BRIGHT = 0.7  # of the brightest light on the sphere
_SAMPLES = 128  # a side, of the pixels that estimates use
_DARK = 0.05  # of a pixel's brightest value, below which it is in shadow
_LOWEST = 0.15  # z of an estimated light, below which the estimate has failed
_ROUNDS = 30  # of the robust factorisation
_HALF = 3.0  # median errors at which a value counts half


class LightsParams(Params):
    """What is known of the lights; without either they are estimated."""

    directions: Document | None = None
    """file with a list `lights` of [x, y, z] towards the light of each photograph, in the order of their numbers: x
    right, y up, z towards the camera"""
    sphere: tuple[float, float, float] | None = None
    """row and column of the middle, and radius, px, of a chrome sphere in the pictures, which mirrors the lights"""
    invert: bool = False
    """turn estimated lights by half a turn: hills become hollows, which photographs cannot tell apart"""


@dataclasses.dataclass(frozen=True)
class Lights:
    """The lights."""

    directions: Directions
    """towards the light of each photograph"""
    origin: str
    """`given`, `sphere` or `estimated`"""


def check_lights(params: LightsParams, known: Mapping[str, Any]) -> None:
    """There must be a light for each photograph, at least three of them, and one way to know them."""
    image = known.get("image")
    count = None if image is None else frame_count(image.channels)
    if params.directions is not None and params.sphere is not None:
        raise InputError("directions: are given, and so is a sphere; give one of them")
    if count is not None and count < LEAST:
        raise InputError(f"image: {count} photographs; at least {LEAST} under different lights are needed")
    if params.directions is not None:
        listed = _listed(params.directions)
        if count is not None and len(listed) != count:
            raise InputError(f"{params.directions.file}: lights: {len(listed)} for {count} photographs")
    elif params.sphere is None and count is not None and count < _LEAST_ESTIMATED:
        raise InputError(
            f"image: {count} photographs; {_LEAST_ESTIMATED} are needed to estimate lights: give their directions, "
            "--set sources.directions=FILE, or a chrome sphere, --set sources.sphere=ROW,COLUMN,RADIUS"
        )
    if params.sphere is not None and image is not None:
        row, column, radius = params.sphere
        if radius < 2 or not (
            row - radius >= 0
            and row + radius < image.height
            and column - radius >= 0
            and column + radius < image.width
        ):
            raise InputError(f"sphere: [{row:g}, {column:g}], radius {radius:g} px, does not lie in the pictures")


@stage(version=1, check=check_lights)
def lights(image: Image, params: LightsParams) -> Lights:
    """Read the directions of lights from a file or from a chrome sphere, or estimate them.

    The sphere mirrors a light where its normal halves the angle between light and camera.

    Estimates assume lights of equal strength, and a surface that is level on the whole. The photographs are a
    product of normals and lights, which a factorisation with weights for outliers finds but for a linear map. Equal
    strengths leave a rotation or a mirror image; the mean normal fixes one axis, and that slopes have no curl the
    others. Hills and hollows stay ambiguous (``invert``): hills are taken to be brighter. Where the assumptions are
    wrong the whole surface is tilted or flattened, which is the generalised bas-relief ambiguity: a note says so.

    Parameters
    ----------
    image : the photographs as a frame stack.

    Raises
    ------
    InputError
        the file has no such list or another number of lights; there are too few photographs; the sphere does not
        lie in the pictures or shows no light; lights cannot be estimated.

    References
    ----------
    [Hayakawa1994]_ for lights of equal strength; [Belhumeur1999]_ for the ambiguity and its reduction by
    integrability.
    """
    if params.directions is not None:
        return Lights(_unit(np.array(_listed(params.directions))), "given")
    frames = np.stack([frame.color.mean(axis=2) for frame in frames_of(image)], axis=2)
    if params.sphere is not None:
        found = [_mirrored(frames[..., number], params.sphere, number) for number in range(frames.shape[2])]
        return Lights(_unit(np.array(found)), "sphere")
    directions = _unit(_estimated(frames))
    if params.invert:
        directions = directions * np.array([-1, -1, 1], np.float32)
    _LOG.warning(
        "directions of lights are estimates, for lights of equal strength and a surface level on the whole: "
        "slopes may be off by a factor and a tilt, and hills be hollows (--set sources.invert=true; "
        "--set sources.directions=FILE or sources.sphere=ROW,COLUMN,RADIUS are exact)"
    )
    return Lights(directions, "estimated")


def _listed(document: Document) -> list[list[float]]:
    content = document.content
    listed = content.get("lights") if isinstance(content, dict) else content
    is_number = (int, float)
    if not isinstance(listed, list) or not listed:
        raise InputError(f"{document.file}: lights: must be a list of [x, y, z]")
    for number, one in enumerate(listed, 1):
        fits = isinstance(one, list) and len(one) == 3 and all(type(value) in is_number for value in one)
        if not fits or not np.isfinite(one).all() or one[2] <= 0:
            raise InputError(f"{document.file}: lights: {number} must be [x, y, z] with z above 0, got {one!r:.60}")
    return [[float(value) for value in one] for one in listed]


def _unit(vectors: np.ndarray) -> Float32[np.ndarray, "n 3"]:
    return (vectors / np.sqrt(np.square(vectors).sum(axis=1, keepdims=True))).astype(np.float32)


def _mirrored(frame: np.ndarray, sphere: tuple[float, float, float], number: int) -> np.ndarray:
    """Direction of the light whose image in a sphere is the brightest."""
    middle_row, middle_column, radius = sphere
    row, column = np.indices(frame.shape)
    inside = (row - middle_row) ** 2 + (column - middle_column) ** 2 < radius**2
    bright = inside & (frame >= _BRIGHT * frame[inside].max())
    if bright.sum() > inside.sum() / 4:
        raise InputError(f"sphere: shows no light in photograph {number + 1}: a quarter of it is as bright")
    places = np.argwhere(bright).mean(axis=0)
    x, y = float(places[1] - middle_column) / radius, float(middle_row - places[0]) / radius
    z = np.sqrt(max(0.0, 1 - x * x - y * y))
    return np.array([2 * z * x, 2 * z * y, 2 * z * z - 1])


def _estimated(frames: np.ndarray) -> Float64[np.ndarray, "n 3"]:
    step = max(1, -(-max(frames.shape[:2]) // _SAMPLES))
    sample = frames[::step, ::step].astype(np.float64)
    height, width, count = sample.shape
    surface, sources = _factorised(sample.reshape(-1, count))
    squares = [(i, j) for i, j in itertools.combinations_with_replacement(range(3), 2)]
    products = np.stack([sources[:, i] * sources[:, j] * (1 if i == j else 2) for i, j in squares], axis=1)
    solved = least_squares(products, np.ones(count))
    form = np.zeros((3, 3))
    for (i, j), value in zip(squares, solved, strict=True):
        form[i, j] = form[j, i] = value
    values, vectors = eigenvectors(form)
    change = matrix_product(vectors * np.sqrt(np.maximum(values, 1e-3 * values.max())), vectors.T)
    sources = matrix_product(sources, change)
    surface = matrix_product(surface, inverse_of(change))
    sizes = np.sqrt(np.square(surface).sum(axis=1))
    normals = surface / np.maximum(sizes, 1e-12)[:, None]
    axis = np.median(normals, axis=0)
    axis = axis / np.sqrt(np.square(axis).sum())
    first = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    first = first / np.sqrt(np.square(first).sum())
    basis = np.stack([first, np.cross(axis, first), axis], axis=1)
    sources, normals = matrix_product(sources, basis), matrix_product(normals, basis)
    mean = sample.mean(axis=2)
    best, made = np.inf, sources
    for mirror in (1.0, -1.0):
        steep = np.maximum(normals[:, 2], 0.2)
        x, y = (
            (-mirror * normals[:, 0] / steep).reshape(height, width),
            (normals[:, 1] / steep).reshape(height, width),
        )
        curl, angle = _least_curl(x, y)
        if curl < best:
            best = curl
            if _rise(cos(angle) * x + sin(angle) * y, cos(angle) * y - sin(angle) * x, mean) < 0:
                angle += np.pi
            turned = [
                cos(angle) * mirror * sources[:, 0] - sin(angle) * sources[:, 1],
                sin(angle) * mirror * sources[:, 0] + cos(angle) * sources[:, 1],
            ]
            made = np.stack([*turned, sources[:, 2]], axis=1)
    if values[0] <= 0 or made[:, 2].min() < _LOWEST:
        raise InputError(
            "image: the photographs do not tell where their light came from, as normals hardly differ or lights "
            "are not equally strong; give --set sources.directions=FILE or --set sources.sphere=ROW,COLUMN,RADIUS"
        )
    return made


def _factorised(
    values: Float64[np.ndarray, "p n"],
) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "n 3"]]:
    """Factors of which ``values`` are the products, by alternating least squares with weights for outliers."""
    bright = values.max(axis=1, keepdims=True)
    lit = (values > _DARK * bright).astype(np.float64)
    _, vectors = eigenvectors(square_sums(values))
    sources = np.ascontiguousarray(vectors[:, -3:])
    weights = lit
    for _ in range(_ROUNDS):
        surface = _weighted(sources, weights, values)
        sources = _weighted(surface, weights.T, values.T)
        off = np.abs(matrix_product(surface, sources.T) - values) / np.maximum(bright, 1e-12)
        weights = lit / np.square(1 + np.square(off / (_HALF * max(float(np.median(off)), 1e-4))))
    return surface, sources


def _weighted(
    factors: Float64[np.ndarray, "n 3"], weights: Float64[np.ndarray, "p n"], values: Float64[np.ndarray, "p n"]
) -> Float64[np.ndarray, "p 3"]:
    """Least squares of each row of ``values``."""
    squares = np.einsum("pn,ni,nj->pij", weights, factors, factors)
    size = np.einsum("pii->p", squares) + 1e-12
    squares = squares + (1e-9 * size)[:, None, None] * np.eye(3)
    return np.einsum("pij,pj->pi", inverse_of(squares), np.einsum("pn,ni,pn->pi", weights, factors, values))


def _rise(x: Float64[np.ndarray, "h w"], y: Float64[np.ndarray, "h w"], mean: Float64[np.ndarray, "h w"]) -> float:
    """Above 0 where hills are bright on the whole, as light reaches them from more sides."""
    bend = -np.gradient(x, axis=1) - np.gradient(y, axis=0)
    return float((np.clip(bend, -1, 1) * (mean - mean.mean())).sum())


def _least_curl(x: Float64[np.ndarray, "h w"], y: Float64[np.ndarray, "h w"]) -> tuple[float, float]:
    """The share of curl in slopes across and down, if they are turned so that it is least, and that angle."""
    (x_down, x_across), (y_down, y_across) = np.gradient(x), np.gradient(y)
    first, second = x_down - y_across, y_down + x_across
    size = first * first + second * second
    weight = 1 / np.square(1 + size / max(float(np.median(size)), 1e-12))
    sums = [float((weight * one).sum()) for one in (first * first, first * second, second * second)]
    values, vectors = eigenvectors(np.array([[sums[0], sums[1]], [sums[1], sums[2]]]))
    return float(values[0] / max(values[1], 1e-12)), float(arctan2(vectors[1, 0], vectors[0, 0]))
