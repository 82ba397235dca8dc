"""Which writer a file name selects. Nothing heavy is imported."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import logging
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from texloom.pipelines.errors import refused
from texloom.pipelines.media.delivery import AS_IS, Delivery
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Wraps

Takes = Literal[
    "array", "data", "picture", "image", "value",
    "html", "csv", "mtlx", "tsx", "tres", "asset", "meta", "glsl", "hlsl", "gdshader", "osl",
]  # fmt: skip

_ROOM = "texloom.pipelines.media.writers"
_LOG = logging.getLogger(__name__)
_EIGHT_BITS = (".jpg", ".webp", ".dzi")
_REMEDIES = {"OpenImageIO": "openimageio is not installed; pip install 'texloom[tx]'"}
"""of modules that are not installed"""


@dataclasses.dataclass(frozen=True)
class Writer:
    """A kind of file."""

    suffix: str
    takes: Takes
    """``array``: any array; ``data``: one that is no `Image`; ``picture``: one with rows and columns; ``image``: an
    `Image`; the others: that type"""
    module: str
    """its ``write(job)`` writes a `WriteJob` and returns names to digests"""
    needs: str = ""
    """a module that must be installed"""
    companions: str = ""
    """what the name of the folder of its other files ends in, after the file's name without suffix"""

    @property
    def full_module(self) -> str:
        """Where `write` is defined."""
        return f"{_ROOM}.{self.module}"

    def check_installed(self, where: str) -> None:
        """`InputError` at the place ``where`` if what it needs is missing; nothing is imported."""
        if self.needs and importlib.util.find_spec(self.needs) is None:
            raise refused(f"{where}: {_REMEDIES[self.needs]}")


@dataclasses.dataclass(frozen=True)
class WriteJob:
    """A file to write."""

    path: Path
    value: Any
    hint: Any
    """the type of ``value``"""
    provenance: Mapping[str, Any]
    delivery: Delivery = AS_IS
    mesh: np.ndarray | None = None
    """a `texloom.stages.vocabulary.arrays.Mesh` on which the image lies; None: a plane"""
    bits: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """role to the bits of what the map is made from, where they are known; 32 of floats"""

    @property
    def wraps(self) -> Wraps:
        """How the value continues across its borders; of other arrays than images nothing is known."""
        return self.value.wraps if isinstance(self.value, Image) else Wraps()


HEX_TILED = ".hex.mtlx"
"""what the name of a MaterialX document of hex-tiled maps ends in"""

MODELS = (".glb", ".usda", ".mtlx")
"""what the names of files end in whose picture may lie on a mesh"""

WRITERS = (
    Writer(".exr", "array", "plain"),
    Writer(".data.png", "data", "data_png"),
    Writer(".data.dds", "data", "data_png"),
    Writer(".png", "picture", "plain"),
    Writer(".json", "value", "plain"),
    Writer(".html", "html", "plain"),
    Writer(".csv", "csv", "plain"),
    Writer(".glsl", "glsl", "plain"),
    Writer(".hlsl", "hlsl", "plain"),
    Writer(".gdshader", "gdshader", "plain"),
    Writer(".osl", "osl", "plain"),
    Writer(".wang.mtlx", "mtlx", "plain"),
    Writer(".tsx", "tsx", "plain"),
    Writer(".tres", "tres", "plain"),
    Writer(".asset", "asset", "plain"),
    Writer(".meta", "meta", "plain"),
    Writer(".jpg", "picture", "pictures"),
    Writer(".webp", "picture", "pictures"),
    Writer(".tif", "picture", "pictures"),
    Writer(".tga", "picture", "pictures"),
    Writer(".dds", "picture", "pictures"),
    Writer(".hdr", "picture", "pictures"),
    Writer(".slopes.tx", "picture", "tx", "OpenImageIO"),
    Writer(".tx", "picture", "tx", "OpenImageIO"),
    Writer(HEX_TILED, "image", "documents", companions="_hex_maps"),
    Writer(".mtlx", "image", "documents", companions="_maps"),
    Writer(".usda", "image", "documents", companions="_maps"),
    Writer(".glb", "image", "glb"),
    Writer(".dzi", "image", "dzi", companions="_files"),
)
SUFFIXES = tuple(writer.suffix for writer in WRITERS if writer.suffix.count(".") == 1)


@lru_cache
def writer_of(file: str) -> Writer | None:
    """The writer that the end of a file's name selects."""
    return next((writer for writer in WRITERS if file.endswith(writer.suffix)), None)


def write(job: WriteJob) -> dict[str, str]:
    """Write a job; the digests (SHA-256) of its files.

    Returns
    -------
    name to digest: an empty name for the file itself, paths relative to its folder for its companions.

    Raises
    ------
    texloom.pipelines.store.codec.ArtifactError
        The value cannot be written in this form.
    OSError
        A file cannot be written.
    """
    writer = writer_of(job.path.name)
    if writer is None:
        raise refused(f"{job.path}: no writer for '{job.path.suffix}'; {', '.join(SUFFIXES)} can be written")
    writer.check_installed(str(job.path))
    if writer.suffix in _EIGHT_BITS and (bits := job.bits.get("albedo", 8)) > 8:
        _LOG.warning("colour of %d bits has 8 in %s; .png, .tif and .exr hold more", bits, writer.suffix)
    written: dict[str, str] = importlib.import_module(writer.full_module).write(job)
    return written
