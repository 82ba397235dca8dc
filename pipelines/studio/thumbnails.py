"""Small pictures of results: a lit sphere of a material, or the texture itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from texloom.pipelines.media.material_set import holds_maps
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store.png_file import png
from texloom.pipelines.studio.decoding import reduced
from texloom.pipelines.studio.work import Encoded, Places, ThumbnailWork
from texloom.stages.evaluation.lit_preview import LitPreviewParams, light_directions, lit
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

SIDE = 192
"""px"""
_FINER = 2  # of the sphere before it is reduced, so that its border is smooth
_RELIEF = 0.02  # height of white over black as a share of the side, as of `lit_preview`
_FILES = ("texture.png", "texture.exr", "preview.png", "corners.png")


def send(work: ThumbnailWork, places: Places, send: Callable[..., None]) -> None:
    """Send what a run has exported: the material on a sphere, or the picture; `InputError` where it has neither."""
    folder = Path(work.folder)
    if (folder / "maps").is_dir() and holds_maps(folder / "maps"):
        image = open_source("result", str(folder / "maps")).read()
        if len(set(image.channels) - set("RGBAY")) > 0:
            send(Encoded(), png(sphere(image, SIDE)))
            return
    file = next((name for name in _FILES if (folder / name).is_file()), None)
    if file is None:
        file = next((path.name for path in sorted(folder.glob("*.png"))), None)
    if file is None:
        raise InputError("there is no picture of this result")
    send(Encoded(), png(reduced(open_source("result", str(folder / file)), SIDE, places)))


def sphere(image: Image, side: int) -> UInt8[np.ndarray, "side side 4"]:
    """A material on a sphere, lit from the upper left.

    Parameters
    ----------
    image : its maps; the half of the sphere that is seen shows all of it.
    side : of the picture, px.

    Returns
    -------
    R G B A, sRGB; A is 0 beside the sphere.
    """
    fine = _FINER * side
    channels = [np.ascontiguousarray(plane) for plane in np.moveaxis(image.pixels, 2, 0)]  # it takes four at most
    planes = np.stack([cv2.resize(one, (fine, fine), interpolation=cv2.INTER_AREA) for one in channels], axis=2)
    place = (np.arange(fine, dtype=np.float32) + 0.5) / fine * 2 - 1
    across, up = np.meshgrid(place * 1.02, -place * 1.02)
    toward = np.sqrt(np.maximum(1 - across**2 - up**2, 0)).astype(np.float32)
    is_inside = across**2 + up**2 < 1
    rows = (0.5 - np.arcsin(np.clip(up, -1, 1)) / np.pi) * fine
    columns = (0.5 + np.arctan2(across, np.maximum(toward, 1e-6)) / np.pi) * fine
    taken = planes[np.clip(rows, 0, fine - 1).astype(int), np.clip(columns, 0, fine - 1).astype(int)]
    bumps = _bumps(Image(planes, image.channels))
    bump = bumps[np.clip(rows, 0, fine - 1).astype(int), np.clip(columns, 0, fine - 1).astype(int)]
    normal = np.stack([across, up, toward], axis=2).astype(np.float32)
    east = np.stack([toward, np.zeros_like(toward), -across], axis=2) + np.array([1e-6, 0, 0], np.float32)
    east /= np.linalg.norm(east, axis=2, keepdims=True)
    north = np.cross(normal, east)
    turned = bump[..., :1] * east + bump[..., 1:2] * north + bump[..., 2:] * normal
    turned /= np.maximum(np.linalg.norm(turned, axis=2, keepdims=True), 1e-6)
    keep = [index for index, name in enumerate(image.channels) if name not in NORMAL]
    shown = Image(
        np.concatenate([taken[..., keep], turned], axis=2).astype(np.float32),
        (*(image.channels[index] for index in keep), *NORMAL),
    )
    light = light_directions(1, 40.0)[0]
    radiance = np.clip(lit(shown, light, LitPreviewParams(ambient=0.35)), 0, 1)
    colors = np.concatenate([radiance * is_inside[..., None], is_inside[..., None]], axis=2).astype(np.float32)
    colors = cv2.resize(colors, (side, side), interpolation=cv2.INTER_AREA)
    alpha = colors[..., 3:]
    straight = Image(np.clip(colors[..., :3] / np.maximum(alpha, 1e-6), 0, 1).astype(np.float32), ("R", "G", "B"))
    return np.concatenate([straight.srgb, np.rint(255 * alpha).astype(np.uint8)], axis=2)


def _bumps(image: Image) -> Float32[np.ndarray, "h w 3"]:
    """The normals of a plane of the material; from the height map where it has none."""
    planes = dict(zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True))
    if set(NORMAL) <= set(planes):
        return np.stack([planes[name] for name in NORMAL], axis=2)
    normal = np.zeros((image.height, image.width, 3), np.float32)
    normal[..., 2] = 1
    if "height" in planes:
        down, across = np.gradient(planes["height"] * np.float32(_RELIEF * image.height))
        normal[..., 0], normal[..., 1] = -across, down
    return normal
