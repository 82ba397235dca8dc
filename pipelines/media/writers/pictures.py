"""JPEG, WebP and TIFF.

JPEG (quality 95, no alpha) and WebP (lossless) hold the 8-bit picture that PNG does; of a frame stack, WebP is an
animation of all frames. TIFF holds an image's colour
and alpha as 16-bit sRGB, and other arrays of one, three or four planes as 32-bit floats.
"""

from __future__ import annotations

import hashlib
import io
import logging

import numpy as np

from texloom.pipelines.media.material_export import channels_of, codes_of
from texloom.pipelines.media.writers.registry import Job
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.outputs import prepared
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.animation import animated_webp
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.frame_stacks import frame_count, frames_of
from texloom.stages.vocabulary.sizes import format_size

_LOG = logging.getLogger(__name__)
_MAX_SIDE = {".jpg": 65500, ".webp": 16383}  # px
_OPTIONS = {
    ".jpg": ("JPEG", {"quality": 95, "subsampling": 0}),
    ".webp": ("WebP", {"lossless": True, "quality": 50}),
}


def write(job: Job) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    content = _tiff(job) if job.path.suffix == ".tif" else _eight_bits(job)
    write_atomically(job.path, content)
    return {"": hashlib.sha256(content).hexdigest()}


def _eight_bits(job: Job) -> bytes:
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


def _tiff(job: Job) -> bytes:
    import cv2

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
    done, content = cv2.imencode(".tif", np.ascontiguousarray(levels[..., order]))
    if not done:
        raise ArtifactError(f"{job.path}: a TIFF could not be made")
    return bytes(content)
