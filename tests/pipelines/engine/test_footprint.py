"""What a large result takes is told, and refused where there is not as much."""

from __future__ import annotations

from pathlib import Path

import pytest

from texloom.pipelines import memory
from texloom.pipelines.api import open_run
from texloom.pipelines.engine import footprint, run
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.declare import InputError


def opened(flow: str, size: int, store: Path) -> Run:
    return open_run(flow, Overrides(params={"size": str(size)}), Store(store))


def test_small_results_are_not_estimated(tmp_path: Path) -> None:
    assert opened("self_tuning", 4096, tmp_path).footprint() is None


def test_steps_in_bands_take_disk_and_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(memory.VARIABLE, "4GB")
    taken = opened("self_tuning", 16384, tmp_path).footprint()
    assert taken is not None
    assert not taken.in_memory
    assert not taken.problem
    assert taken.memory < 3e9
    assert 2e10 < taken.disk < 5e10
    material = opened("materials", 16384, tmp_path).footprint()
    assert material is not None
    assert not material.in_memory
    assert material.disk > 2 * taken.disk  # of seven channels, and their gradients integrated
    larger = opened("self_tuning", 32768, tmp_path).footprint()
    assert larger is not None
    assert larger.disk == 4 * taken.disk
    assert larger.memory == taken.memory


def test_what_does_not_fit_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "store"
    monkeypatch.setattr(run, "free_space", lambda _: 10**10)
    with pytest.raises(InputError, match=r"--store .*: a result of this size takes up to 32.5 GB of disk"):
        opened("self_tuning", 16384, store).check(tmp_path / "out")
    monkeypatch.setattr(footprint, "machine_memory", lambda: 8 * 10**9)
    with pytest.raises(InputError, match=r"steps\.texture: takes 26\.8 GB of memory or more"):
        opened("quilting", 16384, store).check(tmp_path / "out")
    assert not store.exists()
