"""Textures for renderers, by OpenImageIO: tiled, mip-mapped, with wrap modes and the name of the colour space.

``NAME.tx`` holds an image's colour and alpha in half floats, or another array's planes in floats, as data.
``NAME.slopes.tx`` holds six channels for bump mapping of a height field, as ``maketx --bumpslopes`` does, which
fails on pictures in memory (OpenImageIO 3.2): height, slopes along s and t per pixel by Sobel's filter, their
squares and their product, whose averages in the smaller levels give the roughness of what is not resolved.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import channels_of
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store import exr
from texloom.pipelines.store.atomic import atomic_path, file_digest, owned_file
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.outputs import prepared
from texloom.pipelines.store.png_file import LARGE
from texloom.pipelines.store.types import Hint
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.scratch import bands, empty

_TILE = 64  # px
_INCH = 0.0254  # m
_HEIGHT = "height"
_SLOPES = ("b0_h", "b1_dhds", "b2_dhdt", "b3_dhds2", "b4_dhdt2", "b5_dh2dsdt")


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    slopes = job.path.name.endswith(".slopes.tx")
    if not isinstance(job.value, Image):
        planes = prepared(job.value, Hint.of(job.hint)).planes()
        if slopes and len(planes) != 1:
            raise ArtifactError(f"{job.path}: slopes are made from one plane of heights, got {len(planes)}")
        values, is_color = np.stack(planes, axis=2).astype(np.float32), False
    elif slopes:
        name = _HEIGHT if _HEIGHT in job.value.channels else job.value.channels[0]
        if name == "R":
            raise ArtifactError(
                f"{job.path}: slopes are made from heights, but the image has none and is in colour"
            )
        place = job.value.channels.index(name)
        values, is_color = job.value.pixels[..., place : place + 1], False
    else:
        image = job.delivery.encoded(job.value)
        names = channels_of("albedo", image.channels)
        places = [image.channels.index(name) for name in names]
        is_first = places == list(range(len(places)))  # then large images are not copied
        values, is_color = image.pixels[..., : len(places)] if is_first else image.pixels[..., places], True
    digest = write_texture(job.path, values, job.delivery, is_color, job.wraps, slopes)
    return {"": digest}


def write_texture(
    path: Path, values: np.ndarray, delivery: Delivery, is_color: bool, wraps: Wraps, slopes: bool = False
) -> str:
    """Write a texture file; its digest (SHA-256).

    Parameters
    ----------
    values : float32, (h, w, c); ``c`` is 1 for ``slopes``.
    is_color : linear colour, kept in half floats; other values are data in floats.
    wraps : lookups beyond borders where it wraps go on at the opposite ones, else they take the pixels there.
    slopes : whether heights become channels for bump mapping.
    """
    import OpenImageIO

    if slopes:
        values = _slopes(values[..., 0], wraps)
    height, width, count = values.shape
    spec = OpenImageIO.ImageSpec(width, height, count, "float")
    if slopes:
        spec.channelnames = _SLOPES
    config = OpenImageIO.ImageSpec(width, height, count, "half" if is_color else "float")
    config.tile_width = config.tile_height = _TILE
    modes = ["periodic" if wraps_there else "clamp" for wraps_there in (wraps.across, wraps.down)]
    settings: dict[str, Any] = {
        "wrapmodes": ",".join(modes),
        "colorInteropID": delivery.color_space if is_color else "data",
        "compression": "zip",
        "maketx:fileformatname": "openexr",
        "maketx:filtername": "lanczos3" if is_color else "box",
        "maketx:hash": 1,
        "maketx:oiio_options": 1,
        "Software": "texloom",
        "DateTime": "",
    }
    if delivery.texel_size is not None:
        density = _INCH / delivery.texel_size
        settings |= {"XResolution": density, "YResolution": density, "ResolutionUnit": "in"}
    for name, value in settings.items():
        config.attribute(name, value)
    OpenImageIO.attribute("threads", thread_count())
    with atomic_path(path) as temporary, contextlib.ExitStack() as stack:
        source: Any
        if height * width > LARGE:  # from a file, of which it reads some tiles at a time
            file = stack.enter_context(owned_file(path.parent))
            planes = {name: values[..., place] for place, name in enumerate(spec.channelnames)}
            exr.write(file, {"image": planes}, {}, "NO")
            source = str(file)
        else:
            source = OpenImageIO.ImageBuf(spec)
            source.set_pixels(OpenImageIO.ROI(), np.ascontiguousarray(values))
        if not OpenImageIO.ImageBufAlgo.make_texture(OpenImageIO.MakeTxTexture, source, str(temporary), config):
            raise ArtifactError(f"{path}: {OpenImageIO.geterror().splitlines()[0] or 'OpenImageIO failed'}")
        return file_digest(temporary)


def _slopes(height: np.ndarray, wraps: Wraps) -> np.ndarray:
    """The channels for bump mapping, float32, (h, w, 6)."""
    slopes = empty((*height.shape, len(_SLOPES)), np.float32)
    last = len(height) - 1
    for band in bands(len(height), height, slopes):
        rows = np.arange(band.start - 1, band.stop + 1)
        rows = rows % len(height) if wraps.down else rows.clip(0, last)
        padded = np.pad(height[rows], ((0, 0), (1, 1)), mode="wrap" if wraps.across else "edge")
        across, down = (padded[:, 2:] - padded[:, :-2]) / 2, (padded[2:] - padded[:-2]) / 2
        ds = (across[:-2] + 2 * across[1:-1] + across[2:]) / 4
        dt = (down[:, :-2] + 2 * down[:, 1:-1] + down[:, 2:]) / 4
        slopes[band] = np.stack([height[band], ds, dt, ds * ds, dt * dt, ds * dt], axis=2)
    return slopes
