"""A material under a moving light."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.normals import NORMAL, unit

_GAP = 8  # px between pictures
_BACKGROUND = 0.02
_MIN_ROUGHNESS = 0.05  # a mirror would not show a point light
_REFLECTANCE = 0.08  # at normal incidence, of a dielectric with specular 1

Planes = Mapping[str, ScalarMap]


class LitPreviewParams(Params):
    """Lights, and the part that is shown."""

    lights: int = Field(4, ge=1, le=16)
    """pictures side by side; lit from directions clockwise from the upper left"""
    elevation: float = Field(35.0, gt=0, le=90)
    """of the light above the plane, degrees"""
    side: int = Field(512, ge=16, le=4096)
    """longest side of a picture, px; larger ones are cropped at the right and bottom"""
    brightness: float = Field(1.6, gt=0, le=100)
    """radiance of a white surface that faces the light"""
    ambient: float = Field(0.25, ge=0, le=10)
    """ambient light on the same scale, attenuated by `ao`"""
    roughness: float = Field(0.7, ge=0, le=1)
    """where the material has no roughness map"""
    relief: float = Field(0.02, ge=0, le=1)
    """height of white over black as a share of the picture's shorter side; for materials with a height map but no
    normal map"""


@dataclasses.dataclass(frozen=True)
class LitPreview:
    """The pictures in one."""

    image: Image
    """R G B, linear light; a column for each light, the exemplar in the first row if it is given"""


@stage(version=1, in_bands=True)
def lit_preview(image: Image, params: LitPreviewParams, exemplar: Image | None = None) -> LitPreview:
    """Light a material from several sides.

    Each pixel reflects as a rough plane, diffuse after Lambert and specular after Cook and Torrance with the GGX
    distribution, seen straight on; there are no shadows. Channels that count: colour, ``normal.X`` ``normal.Y``
    ``normal.Z`` or else ``height``, ``roughness``, ``metallic``, ``specular`` (grey or ``.R`` ``.G`` ``.B``),
    ``ao`` and ``emissive.R`` ``.G`` ``.B``. Any may be missing.

    Parameters
    ----------
    image : the material.
    exemplar : what it was made from, shown above it under the same lights.

    References
    ----------
    [Walter2007]_ equations 20, 33 and 34 for the distribution and the shadowing; [Schlick1994]_ for the Fresnel
    term; [Burley2012]_ for roughness squared and the reflectance of dielectrics.
    """
    rows = [one.elsewhere(one.pixels[: params.side, : params.side]) for one in (exemplar, image) if one is not None]
    height = sum(shown.height for shown in rows) + _GAP * (len(rows) - 1)
    width = max(shown.width for shown in rows)
    pixels = np.full((height, (width + _GAP) * params.lights - _GAP, 3), _BACKGROUND, np.float32)
    top = 0
    for shown in rows:
        for place, light in enumerate(light_directions(params.lights, params.elevation)):
            left = place * (width + _GAP)
            pixels[top : top + shown.height, left : left + shown.width] = lit(shown, light, params)
        top += shown.height + _GAP
    return LitPreview(Image(pixels, ("R", "G", "B")))


def light_directions(count: int, elevation: float) -> Float32[np.ndarray, "n 3"]:
    """Unit vectors towards the light, clockwise from the upper left; x right, y up, z towards the viewer."""
    turns = np.deg2rad(135 - 360 * np.arange(count) / count)
    up = np.deg2rad(elevation)
    flat = np.stack([np.cos(turns), np.sin(turns)], axis=1) * np.cos(up)
    return np.concatenate([flat, np.full((count, 1), np.sin(up))], axis=1).astype(np.float32)


def lit(image: Image, light: Float32[np.ndarray, "3"], params: LitPreviewParams) -> Float32[np.ndarray, "h w 3"]:
    """Radiance towards the viewer; ``light`` is the unit vector towards the light."""
    planes = dict(zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True))
    color = image.color
    normal = _normals(planes, params.relief)
    half = light + np.array([0, 0, 1], np.float32)
    half = half / np.linalg.norm(half)
    # Cosines between n, the normal; l, the light; v, the viewer; h, halfway between these.
    nl = np.clip(normal @ light, 0, 1)
    nv = np.clip(normal[..., 2], 1e-4, 1)
    nh = np.clip(normal @ half, 0, 1)

    roughness = planes.get("roughness", np.full(nl.shape, params.roughness, np.float32))
    width2 = np.clip(roughness, _MIN_ROUGHNESS, 1) ** 4  # of the distribution, squared
    distribution = width2 / (np.pi * (nh**2 * (width2 - 1) + 1) ** 2)
    shadowing = 0.5 / np.maximum(
        nl * np.sqrt(nv**2 * (1 - width2) + width2) + nv * np.sqrt(nl**2 * (1 - width2) + width2), 1e-6
    )
    metallic = planes.get("metallic", np.zeros_like(nl))[..., None]
    straight = _REFLECTANCE * _specular(planes, nl) * (1 - metallic) + color * metallic
    fresnel = straight + (1 - straight) * (1 - half[2]) ** 5
    diffuse = color * (1 - metallic)
    # Light of brightness 1 gives white a radiance of 1: pi is cancelled in both terms.
    reflected = (1 - fresnel) * diffuse + np.pi * (distribution * shadowing)[..., None] * fresnel
    occlusion = planes.get("ao", np.ones_like(nl))[..., None]
    radiance = params.brightness * nl[..., None] * reflected + params.ambient * occlusion * (diffuse + straight)
    if "emissive.R" in planes:
        radiance = radiance + np.stack([planes[f"emissive.{letter}"] for letter in "RGB"], axis=2)
    return np.asarray(radiance, np.float32)


def _specular(planes: Planes, like: ScalarMap) -> Float32[np.ndarray, "h w c"]:
    if "specular.R" in planes:
        return np.stack([planes[f"specular.{letter}"] for letter in "RGB"], axis=2)
    return planes.get("specular", np.full_like(like, 0.5))[..., None]


def _normals(planes: Planes, relief: float) -> Float32[np.ndarray, "h w 3"]:
    """Unit normals, from the height map where there is no normal map."""
    if set(NORMAL) <= set(planes):
        return unit(np.stack([planes[name] for name in NORMAL], axis=2))
    first = next(iter(planes.values()))
    normal = np.zeros((*first.shape, 3), np.float32)
    normal[..., 2] = 1
    if "height" in planes:
        down, across = np.gradient(planes["height"] * np.float32(relief * min(first.shape)))
        normal[..., 0], normal[..., 1] = -across, down
    return unit(normal)
