"""How many workers share a machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from texloom.pipelines import memory
from texloom.pipelines.engine.executors.executor_choice import worker_count
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.kernels.core.threads import sharing


@pytest.mark.parametrize(
    ("items", "size", "limit", "expected"),
    [
        (20, 64, "64GB", 16),  # a thread each
        (11, 64, "64GB", 11),
        (3, 64, "64GB", 8),  # whose steps use two threads each
        (20, 4096, "32GB", 6),  # what fits into the memory
        (20, 4096, "1GB", 1),
    ],
)
def test_workers_by_the_number_and_size_of_items(
    items: int, size: int, limit: str, expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(memory.VARIABLE, limit)
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(items):
        Image.fromarray(np.full((40, 40), number, np.uint8)).save(folder / f"{number}.png")
    overrides = Overrides(params={"size": str(size)}, pictures=[str(folder)])
    with sharing(16):
        assert worker_count(open_run("self_tuning", overrides, Store(tmp_path / "store"))) == expected
