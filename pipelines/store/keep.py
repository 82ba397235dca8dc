"""Computing a result once: the lock of its key is held from the look for its record until that is written."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from texloom.pipelines.store.exchange import Exchange
from texloom.pipelines.store.record import encode_record, left_out_of, record_name
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Store


def keep_record(
    store: Store, stage: str, key: str, work: Callable[[], dict[str, Any]], exchange: Exchange | None = None
) -> tuple[dict[str, Any], bool]:
    """The record of a key, from the store or from ``work``, and whether it is new; no other process computes it.

    A record that is broken, or whose result is, is replaced. `OSError` if it cannot be written.

    Parameters
    ----------
    exchange : with a shared store, which is asked before ``work`` is called, and receives what that has made.
    """
    name = record_name(stage, key)
    with store.lock(name):
        with contextlib.suppress(BrokenArtifactError):
            record = store.read_record(name)
            if record is not None and not left_out_of(record):  # else somebody needs it whole
                return store.check_record(record, stage, key).record, False
        shared = None if exchange is None else exchange.fetch(store)
        record = work() if shared is None else shared.record
        store.write_record(name, encode_record(record, name))
    if exchange is not None and shared is None:
        exchange.upload(store)
    return record, shared is None
