"""PNG of data with 16 bits, DDS with 8: 0..1 as they are, not sRGB; one to four planes, grey, RGB or with alpha."""

from __future__ import annotations

import hashlib

import numpy as np

from texloom.pipelines.media.writers.encodings import encoded
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.outputs import prepared
from texloom.pipelines.store.png_file import png
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.arrays import Image


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    if isinstance(job.value, Image):
        raise ArtifactError(f"{job.path}: an image is colour; export it as .png")
    planes = prepared(job.value, Hint.of(job.hint)).planes()
    if len(planes) > 4:
        raise ArtifactError(f"{job.path}: a file holds at most 4 planes, not {len(planes)}; export it as .exr")
    values = np.stack(planes, axis=2).astype(np.float64)
    if not ((values >= 0) & (values <= 1)).all():
        raise ArtifactError(f"{job.path}: values lie outside of 0..1; export it as .exr")
    if job.path.suffix == ".dds":
        content = encoded(np.rint(values * 255).astype(np.uint8), job.path, 8)
    else:
        content = png(np.rint(values * 65535).astype(np.uint16), job.provenance)
    write_atomically(job.path, content)
    return {"": hashlib.sha256(content).hexdigest()}
