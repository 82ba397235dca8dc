"""Deep Zoom pyramids of images, see `texloom.pipelines.media.deep_zoom`."""

from __future__ import annotations

import numpy as np

from texloom.pipelines.media.deep_zoom import write_deep_zoom
from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store.preview import colors_of
from texloom.stages.vocabulary.scratch import release


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    image = job.value
    count = len(colors_of(image.channels))

    def read(rows: slice, columns: slice) -> np.ndarray:
        pixels: np.ndarray = image.pixels[rows, columns, :count].copy()
        release(image.pixels)
        return pixels

    return write_deep_zoom(job.path, image.height, image.width, read)
