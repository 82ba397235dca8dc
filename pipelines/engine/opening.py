"""From a request to a run."""

from __future__ import annotations

from pathlib import Path

from texloom.pipelines.engine.destination import placed
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.command_list import only_item
from texloom.pipelines.flow.loader import find_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.flow.seed_sheet import open_flow
from texloom.pipelines.request import RunRequest
from texloom.pipelines.store.location import default_store, shared_store
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError


def open_request(asked: RunRequest) -> tuple[Run, Path]:
    """What a request opens, checked whole, and the folder of its exports."""
    return placed(open_run(asked.flow, asked.overrides, open_store(asked)), asked.out)


def open_store(asked: RunRequest) -> Store:
    """The store of a request, with the shared one that it names."""
    return Store(asked.store or default_store(), shared_store(asked.remote))


def open_run(flow: str, overrides: Overrides, store: Store) -> Run:
    """The flow with what the caller changes, checked whole; with a contact sheet over several seeds."""
    opened = open_flow(find_flow(flow), overrides)
    if overrides.item is not None:
        if not opened.is_set:
            raise InputError(f"--item {overrides.item}: {opened.name} runs over no set here")
        opened = only_item(opened, overrides.item)
    return Run(opened, store)
