"""The limit on the memory that decoded pictures take, and memory that is freed."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from tests.pipelines.cli.test_main import texloom
from tests.pipelines.pictures import png
from texloom.pipelines.media import locate
from texloom.pipelines.media.sources import SourceError, open_source
from texloom.pipelines.memory import memory_limit, parse_memory
from texloom.pipelines.store import codec
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
