"""Normals and albedo from photographs of one place under several lights."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field

from texloom.stages.analysis.relief.added_maps import with_map
from texloom.stages.analysis.relief.lights import Directions
from texloom.stages.numerics.matrices import determinant, inverse_of
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import MapFacts
from texloom.stages.vocabulary.frame_stacks import frames_of
from texloom.stages.vocabulary.normals import NORMAL, unit

_MOST_TRIPLES = 120
_LEAST_VOLUME = 0.05  # of three lights, which near one plane tell no normal
_NEAR = 3  # px, side of the window whose median normal counts as one more photograph
_PIECES = 64


class PhotometricStereoParams(Params):
    """How exact brightness is."""

    noise: float = Field(0.01, gt=0, le=1)
    """deviation of brightness that is no error, as a share of a white surface's; more for grainy photographs"""


@dataclasses.dataclass(frozen=True)
class PhotometricStereo:
    """The surface."""

    image: Image
    """its albedo, with channels `normal.X`, `normal.Y`, `normal.Z`: green points up"""
    used: ScalarMap
    """share of the photographs by which a pixel was decided, 0..1: without shadows and highlights"""


@stage(version=1)
def photometric_stereo(image: Image, lights: Directions, params: PhotometricStereoParams) -> PhotometricStereo:
    """Fit a matt surface to the brightness of each pixel under each light.

    Brightness is the cosine between normal and light, and 0 in the surface's own shadow. Of the normals that three
    lights give, the one that most photographs agree with is taken, then refined by least squares in which outliers,
    such as cast shadows and highlights, lose their weight. This is done twice: the second time the median of the
    first normals around a pixel counts as one more photograph. Albedo follows per channel, with the same weights.

    Parameters
    ----------
    image : the photographs as a frame stack, from one place, all with the same exposure.
    lights : unit vectors towards the light of each, see `lights`.

    Raises
    ------
    InputError
        the lights lie near one plane.
    ValueError
        there are more or fewer lights than photographs.

    References
    ----------
    [Woodham1980]_ for the method; [IkehataWipf2012]_ for outliers as sparse errors. The search is ours.
    """
    import cv2

    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.relief.lambertian import fit_lambertian

    frames = frames_of(image)
    if len(frames) != len(lights):
        raise ValueError(f"{len(lights)} lights for {len(frames)} photographs")
    sources = lights.astype(np.float64)
    triples = _triples(sources)
    colors = [frame.color for frame in frames]
    brightness = np.stack([color.mean(axis=2) for color in colors], axis=2)
    normals = np.empty((image.height, image.width, 3), np.float32)
    weights = np.empty(brightness.shape, np.float32)
    vectors = np.zeros_like(normals)
    for _ in range(2):
        around = cv2.medianBlur(vectors, _NEAR)
        given = (brightness, sources, triples, inverse_of(sources[triples]), params.noise, around, normals, weights)
        run_spans(fit_lambertian, given, image.height, _PIECES)
        vectors = unit(normals)
    shade = np.maximum(np.einsum("hwi,ni->hwn", vectors, lights), 0)
    total = np.einsum("hwn,hwn,hwn->hw", weights, shade, shade)
    albedo = np.zeros_like(colors[0])
    for number, color in enumerate(colors):
        albedo += (weights[..., number] * shade[..., number])[..., None] * color
    albedo /= np.maximum(total, np.float32(1e-6))[..., None]
    first = frames[0]
    surface = first.with_pixels(np.ascontiguousarray(albedo), ("R", "G", "B"))
    used = weights.mean(axis=2)
    return PhotometricStereo(with_map(surface, "normal", vectors, NORMAL, MapFacts(green="up")), used)


def _triples(sources: Float64[np.ndarray, "n 3"]) -> Int64[np.ndarray, "m 3"]:
    """Lights, three at a time, that are not near one plane; of many, some of equal distance in their order."""
    listed = np.array(list(itertools.combinations(range(len(sources)), 3)), np.int64)
    good = listed[np.abs(determinant(sources[listed])) > _LEAST_VOLUME]
    if not len(good):
        raise InputError("lights: all lie near one plane and tell no normals; one from another side is needed")
    return good[np.arange(min(len(good), _MOST_TRIPLES)) * len(good) // min(len(good), _MOST_TRIPLES)]
