"""The files of a project: complete or absent, bounded, of a known version, and nobody else's."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.printed import next_line
from tests.studio.conftest import ENVIRONMENT, TEXLOOM
from texloom.pipelines.studio.messages.drawings import Drawing
from texloom.pipelines.studio.messages.projects import SCHEMA, Material, ProjectView
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.projects.files import FOLDER, ProjectFiles
from texloom.pipelines.studio.projects.project import Project
from texloom.pipelines.studio.projects.saving import Saver
from texloom.stages.vocabulary.declare import InputError

RECIPE = Recipe(flow="quilting", sources={"exemplar": "folder:moss.png"}, seed=3)
ID = "0123456789abcdef"


def material(name: str = "Moss") -> Material:
    return Material(id=ID, name=name, made=1.0, changed=2.0, draft=RECIPE, tags=("wet",))


def altered(folder: Path, **changes: Any) -> None:
    """Change fields of the file of the material."""
    path = folder / FOLDER / "materials" / f"{ID}.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    files = ProjectFiles(tmp_path)
    assert files.read_view() == ProjectView()
    assert files.read_materials() == ([], [])
    assert list(tmp_path.iterdir()) == []
    files.write_view(ProjectView(view="make", material=ID))
    files.write_material(material())
    again = ProjectFiles(tmp_path)
    assert again.read_view() == ProjectView(view="make", material=ID)
    assert again.read_materials() == ([material()], [])
    assert not list(tmp_path.rglob(".new-*"))


def test_a_newer_project_is_refused_in_one_line_and_left_alone(tmp_path: Path) -> None:
    files = ProjectFiles(tmp_path)
    files.write_view(ProjectView())
    path = tmp_path / FOLDER / "project.json"
    newer = json.dumps({"version": SCHEMA + 1, "view": {"other": 1}})
    path.write_text(newer)
    done = subprocess.run(
        [*TEXLOOM, "studio", str(tmp_path), "--no-browser", "--store", str(tmp_path / "store")],
        capture_output=True, text=True, check=False, env=ENVIRONMENT,
    )  # fmt: skip
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"{FOLDER}/project.json: version {SCHEMA + 1} was written by a newer texloom" in done.stderr
    assert path.read_text() == newer


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"version": SCHEMA + 1}, "was written by a newer texloom"),
        ({"version": "1"}, "version: must be a number"),
        ({"id": "f" * 16}, "id: is that of another file"),
        ({"name": "x" * 65}, "name: "),
        ({"name": "two\nlines"}, "name: "),
        ({"tags": ["x"] * 17}, "tags: "),
        ({"other": 1}, "other: "),
        ({"variants": [{"folder": "../../etc"}]}, "variants.0"),
        ({"draft": {"flow": "x" * 99, "sources": {}}}, "draft.flow"),
    ],
)
def test_materials_that_cannot_be_read_are_told_and_left_alone(
    tmp_path: Path, changes: dict[str, Any], problem: str
) -> None:
    files = ProjectFiles(tmp_path)
    files.write_material(material())
    altered(tmp_path, **changes)
    before = (tmp_path / FOLDER / "materials" / f"{ID}.json").read_bytes()
    materials, problems = files.read_materials()
    assert materials == []
    assert len(problems) == 1
    assert problem in problems[0]
    assert "\n" not in problems[0]
    assert (tmp_path / FOLDER / "materials" / f"{ID}.json").read_bytes() == before


def test_a_folder_outside_of_the_store_is_refused(tmp_path: Path) -> None:
    job = {"id": ID, "name": "x", "recipe": RECIPE.model_dump(), "state": "done"}
    for folder in ("../../etc", "/etc", ".hidden", "a/b", "a\\b"):
        files = ProjectFiles(tmp_path)
        files.write_material(material())
        altered(tmp_path, variants=[{"job": job, "made": 1.0, "folder": folder}])
        assert files.read_materials()[0] == []


@pytest.mark.parametrize("content", [b"", b"{", b"[" * 100_000, b"\xff\xfe", b'"text"', b"[1]"])
def test_no_json_is_told(tmp_path: Path, content: bytes) -> None:
    files = ProjectFiles(tmp_path)
    files.write_material(material())
    (tmp_path / FOLDER / "materials" / f"{ID}.json").write_bytes(content)
    materials, problems = files.read_materials()
    assert materials == []
    assert len(problems) == 1


@pytest.mark.skipif(os.name != "posix", reason="needs links")
@pytest.mark.parametrize("linked", [FOLDER, f"{FOLDER}/materials", f"{FOLDER}/materials/{ID}.json"])
def test_links_are_not_followed(tmp_path: Path, linked: str) -> None:
    project, elsewhere = tmp_path / "project", tmp_path / "elsewhere"
    project.mkdir()
    files = ProjectFiles(project)
    files.write_material(material())
    (project / linked).rename(elsewhere)
    (project / linked).symlink_to(elsewhere)
    if linked.endswith(".json"):
        assert files.read_materials()[0] == []
    else:
        with pytest.raises(InputError, match="link"):
            files.read_materials()
    before = {path: path.read_bytes() for path in tmp_path.glob("elsewhere/**/*") if path.is_file()}
    if linked.endswith(".json"):
        files.write_material(material("Other"))
        assert not (project / linked).is_symlink()
        assert json.loads(elsewhere.read_text())["name"] == "Moss"
    else:
        with pytest.raises(OSError, match="link"):
            files.write_material(material("Other"))
        assert {path: path.read_bytes() for path in before} == before


def test_a_file_of_an_earlier_version_is_read_and_written_as_this_one(tmp_path: Path) -> None:
    files = ProjectFiles(tmp_path)
    files.write_material(material())
    path = tmp_path / FOLDER / "materials" / f"{ID}.json"
    content = json.loads(path.read_text())
    del content["drawing"]
    path.write_text(json.dumps(content | {"version": 1}))
    (read,), problems = files.read_materials()
    assert (read.drawing, problems) == (Drawing(), [])
    files.write_material(read)
    assert json.loads(path.read_text())["version"] == SCHEMA


def test_foreign_files_stay(tmp_path: Path) -> None:
    files = ProjectFiles(tmp_path)
    files.write_material(material())
    for name in ("notes.txt", "x.json", "0.json"):
        (tmp_path / FOLDER / "materials" / name).write_text("mine")
    assert files.read_materials() == ([material()], [])
    files.write_material(material("Other"))
    for name in ("notes.txt", "x.json", "0.json"):
        assert (tmp_path / FOLDER / "materials" / name).read_text() == "mine"


WRITER = """
import sys
from pathlib import Path
from tests.studio.projects.test_files import material
from texloom.pipelines.studio.projects.files import ProjectFiles
files = ProjectFiles(Path(sys.argv[1]))
count = 0
while True:
    count += 1
    files.write_material(material("a" * 30 if count % 2 else "b" * 60))
    if count == 2:
        print("writes", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs a signal that nothing catches")
def test_whoever_is_killed_in_the_middle_leaves_a_whole_file(tmp_path: Path) -> None:
    for _ in range(3):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=ENVIRONMENT,
            cwd=Path(__file__).parents[3],
        )  # fmt: skip
        with writer:
            assert next_line(writer) == "writes\n"
            writer.send_signal(signal.SIGKILL)
        materials, problems = ProjectFiles(tmp_path).read_materials()
        assert problems == []
        assert materials[0].name in ("a" * 30, "b" * 60)
    assert [path.name for path in (tmp_path / FOLDER / "materials").iterdir()] == [f"{ID}.json"]


@pytest.mark.skipif(os.name != "posix", reason="needs locks")
def test_a_second_studio_on_a_project_is_refused(tmp_path: Path) -> None:
    with ProjectFiles(tmp_path).locked():
        done = subprocess.run(
            [*TEXLOOM, "studio", str(tmp_path), "--no-browser", "--store", str(tmp_path / "store")],
            capture_output=True, text=True, check=False, env=ENVIRONMENT,
        )  # fmt: skip
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert "another studio has this project open" in done.stderr
        assert list(tmp_path.iterdir()) == []
    with ProjectFiles(tmp_path).locked():
        pass


@pytest.mark.skipif(os.name != "posix", reason="needs links")
def test_what_cannot_be_saved_is_told_and_saved_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.pipelines.studio.projects.saving._PAUSE", 0.01)
    files = ProjectFiles(tmp_path)
    (tmp_path / FOLDER).write_text("in the way")
    told: list[str] = []

    async def work() -> None:
        saver = Saver(files, told.append)
        project = saver.project = Project(ProjectView(), [], saver.want)
        task = asyncio.create_task(saver.work())
        project.create("Moss", RECIPE)
        project.create("Bark", RECIPE)
        while not told:
            await asyncio.sleep(0.01)
        (tmp_path / FOLDER).unlink()
        while len(told) < 2 or len(files.read_materials()[0]) < 2:
            await asyncio.sleep(0.01)
        task.cancel()

    asyncio.run(asyncio.wait_for(work(), 60))
    assert told[0].startswith("not saved: ")
    assert told[1] == ""
