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
_NUMBERS = struct.Struct("<II")


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


def numbered(number: int, received: int, frame: bytes = b"") -> bytes:
    """A message as it goes over the socket: two numbers of 4 bytes, little-endian, before it.

    Parameters
    ----------
    number : of the message among all that this side sends, from 1 on, rising; 0 for one that is not repeated, or
        where there is none.
    received : the number of the last message of the other side that has arrived.
    """
    return _NUMBERS.pack(number, received) + frame


def without_numbers(sent: bytes) -> tuple[int, int, bytes]:
    """What `numbered` put together; `ValueError` where it is cut."""
    if len(sent) < _NUMBERS.size:
        raise ValueError("less than two numbers")
    return *_NUMBERS.unpack_from(sent), sent[_NUMBERS.size :]
