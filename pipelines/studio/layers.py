"""What EXR files hold, from their headers."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import codec, exr
from texloom.pipelines.store.capture import capture_output
from texloom.pipelines.studio.messages.runs import ExrContents, Layer
from texloom.pipelines.studio.work import LayersRead, LayersWork
from texloom.stages.vocabulary.declare import InputError

_TOGETHER = ({*"RGB"}, {*"Y"}, {*"Lab"}, {"row", "column"})
"""channels that make one picture"""


@dataclasses.dataclass(frozen=True)
class ExrLayer:
    """What is shown as one picture."""

    name: str
    part: str
    channels: tuple[str, ...]
    size: tuple[int, int]


def layers_of(path: Path) -> list[ExrLayer]:
    """Colours and positions, and every other channel by itself; `InputError` where it cannot be read."""
    headers = _headers(path)
    found = []
    for header in headers:
        part = header.get("name", "image")
        groups: dict[str, list[str]] = {}
        for channel in header["channels"]:
            if (channel.xSampling, channel.ySampling) == (1, 1):
                groups.setdefault(codec.layer_of(part, channel.name), []).append(channel.name)
        size = exr.data_size(header)
        for layer, channels in groups.items():
            names = {channel.rpartition(".")[2] for channel in channels}
            label = f"{part}.{layer}" if len(headers) > 1 and part != layer else layer
            if any(together <= names for together in _TOGETHER):
                found.append(ExrLayer(label, part, tuple(channels), size))
            else:
                found += [ExrLayer(_of(label, channel), part, (channel,), size) for channel in channels]
    return found


def _of(label: str, channel: str) -> str:
    last = channel.rpartition(".")[2]
    return label if label.rpartition(".")[2] == last else f"{label}.{last}"


def _headers(path: Path) -> list[dict[str, Any]]:
    try:
        with capture_output():
            return [header for header in exr.read_headers(path) if exr.is_flat(header)]
    except ValueError as error:
        raise InputError(f"{path.name}: {error}") from None


def layers(work: LayersWork, send: Callable[..., None]) -> None:
    """Send what an EXR holds, or how large another picture is."""
    path = Path(work.file)
    if path.suffix.lower() != ".exr":
        source = open_source("picture", work.file)
        one = Layer(name=source.picture, height=source.height, width=source.width)
        send(LayersRead(layers=ExrContents(key=source.digest[:32], layers=(one,), about="")))
        return
    status = path.stat()
    key = hashlib.sha256(f"{path}{status.st_mtime_ns}{status.st_size}".encode()).hexdigest()[:32]
    known = layers_of(path)
    about: dict[str, Any] = {
        "layers": [
            {"name": one.name, "height": one.size[0], "width": one.size[1], "channels": list(one.channels)}
            for one in known
        ]
    }
    header = _headers(path)[0] if known else {}
    for name in ("provenance", "scalars"):
        if f"texloom.{name}" in header:
            about[name] = json.loads(header[f"texloom.{name}"])
    told = tuple(Layer(name=one.name, height=one.size[0], width=one.size[1]) for one in known)
    text = yaml.safe_dump(about, sort_keys=False, allow_unicode=True, default_flow_style=None)
    send(LayersRead(layers=ExrContents(key=key, layers=told, about=text)))
