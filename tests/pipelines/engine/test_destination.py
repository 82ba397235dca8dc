"""Where exports go: a folder named after picture and flow, or one picture; and what is never replaced."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

import texloom
from texloom.pipelines.cli import main as cli
from texloom.pipelines.media.sources import open_source
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: cut
sources: {exemplar: REQUIRED, mask: optional}
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 8}}
exports: {texture.exr: part.image, texture.png: part.image}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXLOOM_STORE", str(tmp_path / "store"))
    (tmp_path / "cut.yaml").write_text(FLOW.replace("REQUIRED", "required"))
    (tmp_path / "library").mkdir()
    for name in ("library/a.png", "library/b.png", "moss.png"):
        cv2.imwrite(name, rng.integers(0, 256, (16, 16, 3), np.uint8))
    return tmp_path


def run(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code and output of ``texloom run cut.yaml ...``."""
    capsys.readouterr()
    code = cli.texloom.main(["run", "cut.yaml", *shlex.split(line)], prog_name="texloom", standalone_mode=False)
    return code or 0, *capsys.readouterr()


def made(folder: str) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*") if path.is_file())


def names() -> set[str]:
    return {path.name for path in Path().iterdir()}


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("moss.png", "moss_cut"),
        ("texloom:bricks", "bricks_cut"),
        ("moss.png --seeds 2", "moss_cut"),
        ("'library/*.png'", "library_cut"),
        ("library", "library_cut"),
        ("library/a.png library/b.png", "library_cut"),
    ],
)
def test_results_stand_where_one_is(line: str, place: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = names()
    code, out, _ = run(f"{line} --json", capsys)
    assert code == 0
    assert names() - before - {"store"} == {place}
    assert {Path(path).parts[0] for path in json.loads(out)["exports"].values()} == {place}


def test_arrays_are_named_as_their_source(rng: np.random.Generator) -> None:
    done = texloom.run("cut.yaml", {"exemplar": rng.random((16, 16, 3))})
    assert {str(path) for path in done.exports.values()} == {"exemplar_cut/texture.exr", "exemplar_cut/texture.png"}


def test_one_picture_is_the_main_result_alone(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("one.png", "made/One picture.exr", "one.tif"):
        code, out, _ = run(f"moss.png -o {shlex.quote(name)} --json", capsys)
        assert code == 0
        assert json.loads(out)["exports"] == {Path(name).name: name}
    assert made("made") == ["One picture.exr"]
    assert open_source("x", "one.tif").read().pixels.shape == (8, 8, 3)
    assert texloom.run("cut.yaml", {"exemplar": "moss.png"}, out="two.png").exports == {"two.png": Path("two.png")}
    Path("folder.png").mkdir()
    assert run("moss.png -o folder.png", capsys)[0] == 0
    assert made("folder.png") == ["texture.exr", "texture.png"]


def test_one_picture_may_be_of_a_whole_set(capsys: pytest.CaptureFixture[str]) -> None:
    gathered = "\n  sheet: {stage: evaluation.contact_sheet, gather: {images: exemplar}}\nexports: "
    flow = FLOW.replace("REQUIRED", "{each: required}").replace("\nexports: ", gathered)
    Path("cut.yaml").write_text(flow.replace(": part.image", ": sheet.image"))
    assert run("library -o both.png", capsys)[0] == 0
    assert {path.name for path in Path().glob("*.png")} == {"moss.png", "both.png"}


@pytest.mark.parametrize(
    ("line", "exported", "message"),
    [
        ("library", "texture", "--out one.png: the flow runs over a set; give a folder for its pictures"),
        ("moss.png", "a", "--out one.png: cut has no main result texture.*; give a folder for a.exr, a.png"),
    ],
)
def test_what_has_no_one_picture_is_refused(
    line: str, exported: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    flow = FLOW.replace("REQUIRED", "required").replace("texture.", f"{exported}.")
    Path("cut.yaml").write_text(flow)
    with pytest.raises(InputError) as caught:
        run(f"{line} -o one.png", capsys)
    assert str(caught.value) == message
    assert not Path("store").exists()


@pytest.mark.parametrize("out", ["", "-o out", "-o made.png"])
def test_a_run_replaces_what_texloom_wrote(out: str, capsys: pytest.CaptureFixture[str]) -> None:
    for size in (8, 4, 4, 8):
        assert run(f"moss.png {out} --set part.size={size}", capsys)[0] == 0
    files = [path for path in Path().rglob("*.png") if path.parts[0] in ("moss_cut", "out", "made.png")]
    assert [open_source("x", str(path)).read().height for path in files] == [8]


@pytest.mark.parametrize("out", ["", "-o out", "-o made.png"])
def test_a_file_of_somebody_else_is_never_replaced(out: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"moss.png {out}", capsys)[0] == 0
    (file,) = (path for path in Path().rglob("*.png") if path.parts[0] in ("moss_cut", "out", "made.png"))
    file.write_bytes(Path("moss.png").read_bytes())
    before = file.read_bytes()
    for line in (f"moss.png {out}", f"moss.png {out} --set part.size=4"):
        with pytest.raises(InputError, match=f"{file} was not written by texloom, or was changed since"):
            run(line, capsys)
        name = out.removeprefix("-o ") or None
        with pytest.raises(InputError, match="give another place, or force=True"):
            texloom.run("cut.yaml", {"exemplar": "moss.png"}, {"part.size": 4}, out=name)
    assert file.read_bytes() == before
    assert run(f"moss.png {out} --force", capsys)[0] == 0
    assert open_source("x", str(file)).read().height == 8


def test_pictures_in_a_folder_of_maps_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    line = "moss.png -o out --layout blender"
    assert run(line, capsys)[0] == run(line, capsys)[0] == 0
    theirs = Path("out/maps/moss_base_color.png")
    assert theirs.is_file()
    theirs.write_bytes(Path("library/a.png").read_bytes())
    with pytest.raises(InputError, match=r"moss_base_color\.png was not written by texloom"):
        run(line, capsys)
    assert theirs.read_bytes() == Path("library/a.png").read_bytes()


def test_farm_lines_name_the_picture(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    words = ["commands", "cut.yaml", "moss.png", "-o", "one.png", "--force"]
    cli.texloom.main(words, prog_name="texloom", standalone_mode=False)
    assert capsys.readouterr().out.strip().endswith(f"--out {folder}/one.png --force")
