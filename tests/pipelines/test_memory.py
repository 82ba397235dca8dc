"""The limit on the memory that decoded pictures take, and memory that is freed."""

from __future__ import annotations

import dataclasses
import functools
import gc
import platform
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from tests.pipelines.cli.test_main import texloom
from tests.pipelines.flows import environment, open_run, run_local, write_set
from tests.pipelines.pictures import png
from texloom.pipelines import memory
from texloom.pipelines.errors import format_error, is_resource_error
from texloom.pipelines.media import locate
from texloom.pipelines.media.sources import SourceError, open_source
from texloom.pipelines.memory import memory_limit, parse_memory
from texloom.pipelines.store import codec
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary import declare
from texloom.stages.vocabulary.declare import InputError

FREED = """
import pathlib, threading
import numpy as np
from texloom.pipelines.memory import keep_freed_memory

keep_freed_memory()


def resident():
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * 4096


def fill():
    arrays = [np.ones(20_000_000, np.uint8) for _ in range(3)]


before = resident()
for _ in range(2):
    thread = threading.Thread(target=fill)
    thread.start()
    thread.join()
print(resident() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc")
def test_freed_memory_is_kept_for_all_threads() -> None:
    """Otherwise a third of it at most."""
    done = subprocess.run([sys.executable, "-c", FREED], check=True, capture_output=True, text=True)
    assert 55e6 < int(done.stdout) < 65e6


GROUPS = {
    "a container": ("0::/", {"memory.max": 3000}, 3000),
    "a job": (
        "0::/slurm/job_1/step_0",
        {"slurm/job_1/memory.max": 2000, "slurm/job_1/step_0/memory.max": "max"},
        2000,
    ),
    "version 1": ("4:cpu:/job\n7:memory:/job", {"memory/job/memory.limit_in_bytes": 1000}, 1000),
    "both": ("7:memory:/a\n0::/b", {"memory/a/memory.limit_in_bytes": 2**63, "b/memory.max": 500}, 500),
    "elsewhere": ("0::/../../job", {"job/memory.max": 500}, None),
    "none": ("", {}, None),
}


@pytest.mark.parametrize("case", GROUPS)
def test_limits_of_control_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    inside, limits, expected = GROUPS[case]
    (tmp_path / "cgroup").write_text(inside)
    for name, value in limits.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{value}\n")
    monkeypatch.setattr(memory, "_GROUP", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "_GROUPS", tmp_path)
    whole = memory.machine_memory.__wrapped__()
    assert whole == expected if expected else whole > 2**20


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
def test_the_limit_of_the_shell() -> None:
    code = "from texloom.pipelines.memory import machine_memory; print(machine_memory())"
    command = ["sh", "-c", f"ulimit -v 2000000; exec {sys.executable} -c '{code}'"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment(Path()))
    assert int(done.stdout) == 2_000_000 * 1024


def test_what_failed_holds_no_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether Python looks for cycles or not: it does so by the number of objects, not by their size."""
    stage = find_stage("evaluation.metrics")
    held: list[weakref.ref[np.ndarray]] = []

    @functools.wraps(stage.function)
    def function(*_: Any, **__: Any) -> Any:
        array = np.zeros(1000)
        held.append(weakref.ref(array))
        raise MemoryError

    monkeypatch.setitem(declare.declared, stage.name, dataclasses.replace(stage, function=function))
    run = open_run(write_set(tmp_path))
    gc.disable()
    try:
        told = run_local(run, tmp_path / "out")
        assert set(told.items.values()) == {"scores failed: not enough memory"}
        assert len(held) == 6
        assert not any(one() is not None for one in held)
    finally:
        gc.enable()


def test_a_lack_of_memory_of_opencv_is_told_as_one() -> None:
    import cv2

    lacking, other = cv2.error("OpenCV(5.0.0) /io/alloc.cpp:73"), cv2.error("OpenCV(5.0.0) resize.cpp:3845")
    lacking.code, other.code = -4, -215
    assert (is_resource_error(lacking), format_error(lacking)) == (True, "not enough memory")
    assert not is_resource_error(other)
    assert format_error(cv2.error("std::bad_alloc")) == "not enough memory"


@pytest.mark.parametrize(
    ("text", "problem"), [("much", "must be a size such as 20GB"), ("0GB", "must be more than '0GB'")]
)
def test_wrong_sizes(text: str, problem: str) -> None:
    with pytest.raises(InputError, match=f"^--memory: {problem}"):
        parse_memory(text, "--memory")


def test_the_default_is_a_share_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TEXLOOM_MEMORY", raising=False)
    assert 10**8 < memory_limit() < 10**13
    monkeypatch.setenv("TEXLOOM_MEMORY", "3MB")
    assert memory_limit() == 3 * 10**6


def test_a_small_file_of_many_pixels_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "large.png"
    path.write_bytes(png(np.zeros((2, 2, 3)), 8, shape=(16384, 16384)))
    assert path.stat().st_size < 100
    monkeypatch.setenv("TEXLOOM_MEMORY", "4GB")
    problem = r"large.png: takes up to 5\.9 GB of memory to decode, the limit is 4\.0 GB; make it smaller, or raise"
    with pytest.raises(SourceError, match=problem):
        open_source("exemplar", str(path))
    monkeypatch.setenv("TEXLOOM_MEMORY", "6GB")
    assert open_source("exemplar", str(path)).width == 16384


def test_the_maps_of_a_material_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("albedo", "normal", "height"):
        PIL.Image.new("L" if name == "height" else "RGB", (100, 100)).save(tmp_path / f"{name}.png")
    monkeypatch.setenv("TEXLOOM_MEMORY", "0.7MB")
    assert open_source("one", str(tmp_path / "albedo.png"))
    with pytest.raises(SourceError, match=r"takes up to 780\.0 kB"):
        open_source("all", str(tmp_path))


def exr(path: Path, parts: int) -> Path:
    planes = [{"RGB": np.zeros((64, 64, 3), np.float32)} for _ in range(parts)]
    OpenEXR.File([OpenEXR.Part({}, part, f"part{index}") for index, part in enumerate(planes)]).write(str(path))
    return path


def test_all_parts_of_an_exr_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_MEMORY", "200kB")
    assert open_source("one", str(exr(tmp_path / "one.exr", 1)))
    assert codec.describe(tmp_path / "one.exr")["layers"]
    with pytest.raises(SourceError, match="of memory to decode"):
        open_source("many", str(exr(tmp_path / "many.exr", 10)))
    with pytest.raises(InputError, match=r"many\.exr: takes up to"):
        codec.describe(tmp_path / "many.exr")


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "LA", "P", "1"])
def test_what_is_decoded_is_within_what_was_expected(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "a.png"
    PIL.Image.new(mode, (50, 40)).save(path)
    seen = locate.inspect(str(path))
    assert locate.decode(str(path), seen.digest).pixels.nbytes <= seen.memory <= 64 * 50 * 40


def test_the_option_holds_for_one_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TEXLOOM_MEMORY", raising=False)
    PIL.Image.new("RGB", (300, 300)).save(tmp_path / "a.png")
    options = ("plan", "self_tuning", "--source", f"exemplar={tmp_path / 'a.png'}", "--store", tmp_path / "store")
    refused = texloom(*options, "--memory", "1MB")
    assert (refused.code, refused.out) == (2, "")
    assert "of memory to decode, the limit is 1.0 MB" in refused.err
    assert texloom(*options).code == 0
    wrong = texloom(*options, "--memory", "much")
    assert wrong.code == 2
    assert "--memory: must be a size such as 20GB" in wrong.err
