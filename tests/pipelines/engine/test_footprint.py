"""What a large result takes is told, and refused where there is not as much."""

from __future__ import annotations

from pathlib import Path

import PIL.Image
import pytest

from texloom.pipelines import memory
from texloom.pipelines.engine import footprint, preflight
from texloom.pipelines.engine.executors import executor_choice
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.engine.plan_summary import summary
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError


def opened(flow: str, size: int, store: Path, exemplar: Path | None = None) -> Run:
    sources = {} if exemplar is None else {"exemplar": str(exemplar)}
    return open_run(flow, Overrides(sources, {"size": str(size)}), Store(store))


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


def picture(path: Path, side: int) -> Path:
    PIL.Image.new("L", (side, side)).save(path)
    return path


def test_a_large_exemplar_is_planned_once_before_it_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = opened("quilting", 256, tmp_path / "store", picture(tmp_path / "6144.png", 6144))
    plan, planned = Run.plan, []
    monkeypatch.setattr(Run, "plan", lambda self: planned.append(self) or plan(self))
    monkeypatch.setattr(preflight, "free_space", lambda _: 10**10)
    Preflight(run).check(tmp_path / "out")
    assert "on this machine" in run.notes_before[-1]
    assert planned == [run]


@pytest.mark.parametrize("flow", ["quilting", "self_tuning", "near_regular", "hybrid", "texture_optimisation"])
def test_a_large_exemplar_takes_memory_whatever_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flow: str
) -> None:
    assert opened(flow, 256, tmp_path / "store", picture(tmp_path / "4096.png", 4096)).footprint() is None
    large = picture(tmp_path / "6144.png", 6144)
    taken = opened(flow, 256, tmp_path / "store", large).footprint()
    assert taken is not None
    assert taken.in_memory["scores"] == 140 * 6144**2
    assert 24 * 6144**2 <= taken.in_memory["texture"] <= 120 * 6144**2
    assert not taken.problem
    monkeypatch.setattr(footprint, "machine_memory", lambda: 10**9)
    with pytest.raises(InputError, match=r"steps\.\w+: takes .* of memory or more for pictures of this size"):
        Preflight(opened(flow, 256, tmp_path / "store", large)).check(tmp_path / "out")


@pytest.mark.parametrize("flow", ["quilting", "self_tuning", "near_regular"])
def test_a_small_result_takes_no_disk_of_a_large_one(tmp_path: Path, flow: str) -> None:
    """What is stored of an exemplar of 21 million pixels in colour has 198 MB, a twelfth of what was estimated."""
    run = opened(flow, 256, tmp_path / "store", picture(tmp_path / "large.png", 6144))
    taken = run.footprint()
    assert taken is not None
    assert 4 * 6144**2 <= taken.disk <= 8 * 6144**2
    assert summary(run, run.first_plan).disk < 4e8
    as_large = opened(flow, 8192, tmp_path / "store", picture(tmp_path / "large.png", 6144)).footprint()
    assert as_large is not None
    assert as_large.disk == 85 * 8192**2


def test_the_peak_of_quilting_is_near_its_estimate(tmp_path: Path) -> None:
    """A quarter of the 16384 x 16384 px that take 17.7 GB is too slow here; the estimate is linear."""
    taken = opened("quilting", 256, tmp_path / "store", picture(tmp_path / "large.png", 8192)).footprint()
    assert taken is not None
    assert 17.0e9 < 4 * taken.in_memory["texture"] < 17.7e9
    assert str(taken).endswith("9.4 GB of memory")


def test_what_does_not_fit_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "store"
    monkeypatch.setattr(preflight, "free_space", lambda _: 10**10)
    with pytest.raises(InputError, match=r"--store .*: a result of this size takes up to 34.6 GB of disk"):
        Preflight(opened("self_tuning", 16384, store)).check(tmp_path / "out")
    monkeypatch.setattr(footprint, "machine_memory", lambda: 8 * 10**9)
    with pytest.raises(InputError, match=r"steps\.texture: takes 12\.1 GB of memory or more"):
        Preflight(opened("quilting", 16384, store)).check(tmp_path / "out")
    assert not store.exists()


def test_what_a_large_exemplar_takes_is_told_before_it_runs(tmp_path: Path) -> None:
    large = picture(tmp_path / "large.png", 2048)
    (note,) = opened("self_tuning", 1024, tmp_path / "store", large).notes_before
    assert note.startswith("sources.exemplar: 2048 x 2048 px take about ")
    assert "(--crop 1024x1024) or half the size (--reduce 0.5) takes " in note
    smaller = Overrides({"exemplar": str(large)}, part={"reduce": "0.5"})
    assert not open_run("self_tuning", smaller, Store(tmp_path / "store")).notes_before
    assert not opened("self_tuning", 1024, tmp_path / "store", picture(tmp_path / "small.png", 512)).notes_before


def test_steps_of_a_large_exemplar_follow_one_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executor_choice, "thread_count", lambda: 4)
    monkeypatch.setenv(memory.VARIABLE, "16GB")
    small, large = (picture(tmp_path / f"{side}.png", side) for side in (512, 3000))
    store = tmp_path / "store"
    assert executor_choice.executor_of(opened("self_tuning", 1024, store, small)).slots() == 2
    assert executor_choice.executor_of(opened("self_tuning", 1024, store, large)).slots() == 1
