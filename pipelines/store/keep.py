"""Computing a result once: the lock of its key is held from the look for its record until that is written."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from texloom.pipelines.store.record import encode_record, record_name
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Store


def keep_record(
    store: Store, stage: str, key: str, work: Callable[[], dict[str, Any]]
) -> tuple[dict[str, Any], bool]:
    """The record of a key, from the store or from ``work``, and whether it is new; no other process computes it.

    A record that is broken, or whose result is, is replaced. `OSError` if it cannot be written.
    """
    name = record_name(stage, key)
    with store.lock(name):
        with contextlib.suppress(BrokenArtifactError):
            record = store.read_record(name)
            if record is not None:
                return store.check_record(record, stage, key).record, False
        record = work()
        store.write_record(name, encode_record(record, name))
    return record, True
