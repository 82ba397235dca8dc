"""What all messages have in common, and how one is sent."""

from __future__ import annotations

import struct
from typing import Annotated

import pydantic
from pydantic import Field

Side = Annotated[int, Field(ge=2, le=32768)]
"""px"""
CanvasSide = Annotated[int, Field(ge=2, le=2048)]
Share = Annotated[float, Field(ge=0, le=1)]

_LENGTH = struct.Struct("<I")


class Message(pydantic.BaseModel):
    """A message; unknown fields are refused."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


def packed(message: Message, payload: bytes = b"") -> bytes:
    """A message as it is sent: the length of its JSON as 4 bytes, little-endian, the JSON, the payload."""
    header = message.model_dump_json().encode()
    return _LENGTH.pack(len(header)) + header + payload


def unpacked(frame: bytes) -> tuple[bytes, memoryview]:
    """The JSON and the payload of a message; `ValueError` where it is cut."""
    if len(frame) < _LENGTH.size:
        raise ValueError("a message of less than 4 bytes")
    (length,) = _LENGTH.unpack_from(frame)
    payload = _LENGTH.size + length
    if len(frame) < payload:
        raise ValueError("a message that is cut")
    return frame[_LENGTH.size : payload], memoryview(frame)[payload:]
