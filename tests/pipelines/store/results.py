"""Results in a store, as an engine leaves them."""

from __future__ import annotations

import numpy as np

from texloom.pipelines.store.record import encode_record, record_name
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.analysis.structure.otsu import Otsu
from texloom.stages.lookup.registry import find_stage

STAGE = find_stage("analysis.otsu")
KEY = "0123456789abcdef" * 4


def result(seed: int = 0) -> Otsu:
    """A small result."""
    return Otsu(structure=np.random.default_rng(seed).random((20, 30)) > 0.5, threshold=0.25)


def finished(store: Store, key: str = KEY) -> Artifact:
    """A result with its record."""
    artifact = store.save(STAGE, key, result(), {"params": {"smallest": 3}})
    write_record(store, artifact)
    return artifact


def write_record(store: Store, artifact: Artifact) -> None:
    """Its record alone."""
    name = record_name(artifact.stage, artifact.key)
    store.write_record(name, encode_record(artifact.record, name))
