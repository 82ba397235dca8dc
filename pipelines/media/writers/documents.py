"""MaterialX and USD documents as single exports: the maps are PNGs in a folder beside the document."""

from __future__ import annotations

import dataclasses
import hashlib

from texloom.pipelines.media.conventions import SEPARATE
from texloom.pipelines.media.material_export import with_unit_normals
from texloom.pipelines.media.materialx import document
from texloom.pipelines.media.writers import usda
from texloom.pipelines.media.writers.layouts import bound_maps, material_name, write_maps_of
from texloom.pipelines.media.writers.registry import HEX_TILED, WriteJob, writer_of
from texloom.pipelines.store.atomic import write_atomically
from texloom.stages.common.surface.mesh import width_of


def write(job: WriteJob) -> dict[str, str]:
    """See `texloom.pipelines.media.writers.registry.write`."""
    writer = writer_of(job.path.name)
    stem = job.path.name.removesuffix(writer.suffix if writer else job.path.suffix)
    name = material_name(stem)
    room = f"{stem}{writer.companions if writer else ''}"
    image = with_unit_normals(job.value, 16)
    whole = dataclasses.replace(job.delivery, udim=None)
    files, written = write_maps_of(image, job.path.parent / room, name, SEPARATE, whole, job.provenance, job.bits)
    maps = bound_maps(image, SEPARATE, {part: f"{room}/{file}" for part, file in files.items()})
    size = whole.size(image.height, image.width)
    if job.path.name.endswith(HEX_TILED):
        text = document(name, maps, is_hex_tiled=True)
    elif job.path.suffix == ".mtlx" and job.mesh is not None:
        text = document(name, maps, width=width_of(job.mesh))
    elif job.path.suffix == ".mtlx":
        text = document(name, maps, size, wraps=image.wraps)
    else:
        text = usda.stage(name, maps, image, whole, mesh=job.mesh)
    content = text.encode()
    write_atomically(job.path, content)
    return {"": hashlib.sha256(content).hexdigest()} | {
        f"{room}/{file}": digest for file, digest in written.items()
    }
