"""Layers of EXR files as pictures, in a worker."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import yaml

from texloom.pipelines.store import codec
from texloom.pipelines.studio.messages import Layers
from texloom.pipelines.studio.work import Described, LayersWork, Places


def folder_of(places: Places, key: str) -> Path:
    """Where the pictures of an EXR's layers are."""
    return Path(places.scratch) / "layers" / key


def layers(work: LayersWork, places: Places, send: Callable[..., None]) -> None:
    """Write the layers of an EXR as `texloom show --png` does, once, and send what it holds."""
    path = Path(work.file)
    status = path.stat()
    key = hashlib.sha256(f"{path}{status.st_mtime_ns}{status.st_size}".encode()).hexdigest()[:32]
    made = codec.pictures(path, folder_of(places, key))
    about = yaml.safe_dump(codec.describe(path), sort_keys=False, allow_unicode=True, default_flow_style=None)
    send(Described(layers=Layers(key=key, names=tuple(one.stem for one in made), about=about)))
