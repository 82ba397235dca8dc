"""EXR, PNG, JSON, HTML and CSV, as the store has them; colour of EXR in the delivery's colour space."""

from __future__ import annotations

from texloom.pipelines.media.writers.registry import WriteJob
from texloom.pipelines.store import codec
from texloom.stages.vocabulary.arrays import Image


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    value, attributes = job.value, None
    if job.path.suffix == ".exr":
        is_image = isinstance(value, Image)
        value = job.delivery.encoded(value) if is_image else value
        attributes = job.delivery.exr_attributes(is_image)
    return {"": codec.export(value, job.hint, job.path, job.provenance, attributes)}
