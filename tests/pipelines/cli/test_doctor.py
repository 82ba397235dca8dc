"""The state of the installation."""

from __future__ import annotations

import io
import json
import sys
import types
from pathlib import Path

import pytest

from tests.pipelines.cli.test_main import texloom
from texloom.pipelines.cli import doctor
from texloom.pipelines.errors import format_error


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("PREFECT_API_URL", "TEXLOOM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TEXLOOM_STORE", "artifacts")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_report(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "3")
    found = json.loads(texloom("doctor", "--store", "mine", "--json").out)
    assert found["processors"]["threads"] == 3
    assert found["kernels"] == {"folder": str(folder / "kernels"), "compiled": 0, "bytes": 0}
    assert found["store"]["folder"] == str(folder / "mine")
    assert found["store"]["free"] > 0
    assert found["prefect"]["url"] is None
    assert "numba" in found["libraries"]
    assert list(folder.iterdir()) == [], "nothing is written"


def test_formats_that_need_more(monkeypatch: pytest.MonkeyPatch) -> None:
    from texloom.pipelines.media import formats

    monkeypatch.setattr(formats, "missing", lambda kind: "pillow_heif" if kind == "HEIC" else "")
    found = json.loads(texloom("doctor", "--json").out)["formats"]
    assert found["HEIC"] == {"missing": "pillow_heif"}
    assert found["TGA"] == {"missing": None}
    assert "; HEIC needs pillow_heif: pip install 'texloom[photos]'" in doctor._formats(found)


def test_an_opencv_that_is_not_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after another distribution of it was removed, which takes the files of both."""
    monkeypatch.setitem(sys.modules, "cv2", types.ModuleType("cv2"))
    result = texloom("doctor")
    assert result.code == 0
    assert "opencv      not usable" in result.out
    assert "pip install --force-reinstall --no-deps opencv-contrib-python-headless" in result.out
    with pytest.raises(AttributeError) as raised:
        sys.modules["cv2"].resize  # noqa: B018
    assert format_error(raised.value).endswith("`texloom doctor` tells the remedy")


def test_one_screen(folder: Path) -> None:
    (folder / "kernels" / "core").mkdir(parents=True)
    (folder / "kernels" / "core" / "resample.nbi").write_bytes(b"x" * 2_000_000)
    result = texloom("doctor")
    assert result.code == 0
    assert len(result.out.splitlines()) <= 24
    assert "1 compiled, 2.0 MB" in result.out
    assert "store       not there yet" in result.out


def test_a_server_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")
    assert "http://127.0.0.1:9/api does not answer" in texloom("doctor").out


def test_kernels_compiled_ahead(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_WARMED", ("quilting",))
    out = io.StringIO()
    doctor.warm(out)
    assert out.getvalue().startswith("quilting ")
    assert not (folder / "cache" / "texloom" / "store").exists()
