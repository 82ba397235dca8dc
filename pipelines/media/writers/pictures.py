"""JPEG, WebP, TGA, DDS, TIFF and Radiance HDR.

JPEG (quality 95, no alpha), WebP (lossless), TGA (run lengths) and DDS (uncompressed, without mipmaps) hold the
8-bit picture that PNG does; of a frame stack, WebP is an animation of all frames. TIFF holds an image's colour
and alpha as 16-bit sRGB, and other arrays of one, three or four planes as 32-bit floats. HDR holds linear colour
of Rec.709 primaries without alpha, or other arrays of one or three planes, with 8 bits of precision.
"""

from __future__ import annotations

import hashlib
import io
import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from texloom.pipelines.media.material_export import channels_of, codes_of
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.outputs import prepared
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.animation import animated_webp
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.frame_stacks import frame_count, frames_of
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)
_MAX_SIDE = {".jpg": 65500, ".webp": 16383, ".tga": 65535, ".dds": 65535}  # px
_OPTIONS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    ".jpg": ("JPEG", {"quality": 95, "subsampling": 0}),
    ".webp": ("WebP", {"lossless": True, "quality": 50}),
    ".tga": ("TGA", {"compression": "tga_rle"}),
    ".dds": ("DDS", {}),
}
_HDR_LIMIT = 2.0**126


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    content = {".tif": _tiff, ".hdr": _hdr}.get(job.path.suffix, _eight_bits)(job)
    write_atomically(job.path, content)
    return {"": hashlib.sha256(content).hexdigest()}


def _eight_bits(job: WriteJob) -> bytes:
    import PIL.Image

    output = prepared(job.value, Hint.of(job.hint))
    levels = output.picture()
    if levels is None:
        raise ArtifactError(f"{job.path}: is no picture; export it as .exr")
    largest = _MAX_SIDE[job.path.suffix]
    if max(levels.shape[:2]) > largest:
        raise ArtifactError(
            f"{job.path}: {format_size(levels.shape)}, {job.path.suffix} holds at most {largest} px a side"
        )
    output.clipped.tell("colour")
    picture = PIL.Image.fromarray(levels)
    if job.path.suffix == ".webp" and isinstance(job.value, Image) and frame_count(job.value.channels) > 1:
        return animated_webp([frame.srgb for frame in frames_of(job.value)])
    if job.path.suffix == ".jpg":
        if levels.ndim == 3 and levels.shape[2] in (2, 4) and (dropped := float((levels[..., -1] < 255).mean())):
            _LOG.warning("alpha is dropped, which JPEG cannot hold; %.1f %% of the pixels have some", 100 * dropped)
        picture = picture.convert("L" if levels.ndim == 2 or levels.shape[2] == 2 else "RGB")
    kind, options = _OPTIONS[job.path.suffix]
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


def _tiff(job: WriteJob) -> bytes:
    if isinstance(job.value, Image):
        names = channels_of("albedo", job.value.channels)
        names = ["Y"] if names == ["Y"] * 3 else names
        levels = codes_of(job.value, names, "albedo", 16, directx=False)
    else:
        array = prepared(job.value, Hint.of(job.hint))
        levels = np.stack([plane.astype(np.float32) for plane in array.planes()], axis=2)
        if levels.shape[2] not in (1, 3, 4):
            raise ArtifactError(
                f"{job.path}: TIFF holds 1, 3 or 4 planes, not {levels.shape[2]}; export it as .exr"
            )
    order = [0] if levels.shape[2] == 1 else [2, 1, 0, *range(3, levels.shape[2])]
    return _encoded(job, np.ascontiguousarray(levels[..., order]))


def _hdr(job: WriteJob) -> bytes:
    if isinstance(job.value, Image):
        names = channels_of("albedo", job.value.channels)
        planes = [job.value.pixels[..., job.value.channels.index(name)] for name in names if name != "A"]
    else:
        planes = list(prepared(job.value, Hint.of(job.hint)).planes())
    if len(planes) not in (1, 3):
        raise ArtifactError(f"{job.path}: HDR holds 1 or 3 planes, not {len(planes)}; export it as .exr")
    light = np.stack([np.asarray(plane, np.float32) for plane in (planes * 3)[:3][::-1]], axis=2)
    largest = float(np.abs(light).max(initial=0))
    if not largest < _HDR_LIMIT:
        raise ArtifactError(f"{job.path}: HDR holds values up to 2^126; export it as .exr")
    if below := np.count_nonzero(light < 0):
        share = max(100 * below / light.size, 0.1)
        _LOG.warning("HDR: %.1f %% of the values are negative and were set to 0; use .exr, which holds them", share)
    return _encoded(job, np.maximum(light, 0))


def _encoded(job: WriteJob, levels: np.ndarray) -> bytes:
    import cv2

    done, content = cv2.imencode(job.path.suffix, levels)
    if not done:
        raise ArtifactError(f"{job.path}: the file could not be made")
    return bytes(content)
