"""The records of finished steps: their names, and their form.

A record is JSON: ``{"metadata": {"serializer": {"type": SERIALIZER}, ...}, "result": "<JSON of the record>"}``.
That is the form of Prefect, which kept them once. One that names another serializer is foreign, and is not used.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

SERIALIZER = "texloom-artifact"
"""name of the only one that is accepted"""


class ForeignRecordError(Exception):
    """A record that texloom did not write."""


def record_name(stage: str, key: str) -> str:
    """File name of a record and of its lock."""
    return f"{stage.replace('.', '-')}-{key}"


def decode_record(content: bytes) -> dict[str, Any]:
    """The record in a file's content.

    Raises
    ------
    ForeignRecordError
        it names another serializer.
    ValueError, KeyError, TypeError, AttributeError, RecursionError
        it is not a record.
    """
    document = json.loads(content.decode())
    serializer = document["metadata"]["serializer"]
    if document.keys() != {"metadata", "result"} or serializer != {"type": SERIALIZER}:
        raise ForeignRecordError("its record is not one that texloom wrote")
    return dict(json.loads(document["result"]))


def left_out_of(record: Mapping[str, Any]) -> int:
    """Bytes of the files that were left out of a result; 0 where they are there."""
    size = record.get("left_out", 0)
    return size if type(size) is int and size > 0 else 0


def encode_record(record: dict[str, Any], name: str) -> bytes:
    """The content of a file for the record called ``name``."""
    metadata = {"serializer": {"type": SERIALIZER}, "storage_key": name}
    return json.dumps({"metadata": metadata, "result": json.dumps(record)}).encode()
