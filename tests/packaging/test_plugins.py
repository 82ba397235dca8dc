"""Stages and flows of other packages: installed, or in a folder under development."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.packaging.test_packaging import build
from tests.pipelines.cli.test_main import assert_refused, texloom
from tests.pipelines.flows import environment, paint
from texloom.pipelines.cli.check_stage import check_stage
from texloom.stages.lookup.plugins import VARIABLE

PLUGIN = ROOT / "tests" / "plugin"
SMALL = (
    "--size",
    "24",
    "--set",
    "texture.iterations=2",
    "--set",
    "texture.patch_size=5",
    "--set",
    "texture.levels=1",
)


def command(python: Path | str, folder: Path, *words: str, plugins: Path | None = None) -> str:
    """What ``texloom`` prints, run by an interpreter in a folder."""
    variables = environment(folder) | ({} if plugins is None else {VARIABLE: str(plugins)})
    variables["PYTHONPATH"] = ""
    done = subprocess.run(
        [str(python), "-m", "texloom", *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=variables,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def plan(folder: Path, plugins: Path) -> dict[str, str]:
    """The keys of the steps."""
    printed = command(sys.executable, folder, "plan", "gpdm", "a.png", *SMALL, "--json", plugins=plugins)
    return {step["name"]: step["key"] for step in json.loads(printed)["steps"]}


def test_an_installed_package_in_a_fresh_environment(tmp_path: Path) -> None:
    shutil.copytree(PLUGIN, tmp_path / "source", ignore=shutil.ignore_patterns("__pycache__"))
    build(tmp_path / "source", tmp_path / "dist", "build_wheel")
    wheels = build(ROOT, tmp_path / "dist", "build_wheel")
    venv.create(tmp_path / "fresh", symlinks=True)
    variables = {"base": str(tmp_path / "fresh"), "platbase": str(tmp_path / "fresh")}
    site = Path(sysconfig.get_path("purelib", "venv", variables))
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:  # as installers do
            archive.extractall(site)
    (site / "needed.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    python = Path(sysconfig.get_path("scripts", "venv", variables)) / "python"
    paint(tmp_path / "a.png")
    assert "[texloom-gpdm 0.3.0]" in command(python, tmp_path, "stages")
    listed = " ".join(command(python, tmp_path, "flows").partition("Of plug-ins")[2].split())
    assert "distributed as the exemplar's. [texloom-gpdm 0.3.0]" in listed
    explained = command(python, tmp_path, "stages", "gpdm")
    assert explained.startswith("texloom_gpdm.gpdm (version 1, of texloom-gpdm 0.3.0)\n")
    report = json.loads(command(python, tmp_path, "run", "gpdm", "a.png", *SMALL, "--out", "out", "--json"))
    assert [step["state"] for step in report["steps"]] == ["ran", "ran"]
    again = json.loads(command(python, tmp_path, "run", "gpdm", "a.png", *SMALL, "--out", "out", "--json"))
    assert [step["state"] for step in again["steps"]] == ["cached", "cached"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"texture.exr", "texture.png", "scores.json"}


def test_a_comparison_names_the_plugin_of_a_method(tmp_path: Path) -> None:
    paint(tmp_path / "a.png")
    words = ("compare", "gpdm", "quilting", "--over", "a.png", "--size", "24", "--set", "gpdm_texture.iterations=2")
    more = ("--set", "gpdm_texture.patch_size=5", "--set", "gpdm_texture.levels=1", "--report", "page.html")
    command(sys.executable, tmp_path, *words, *more, plugins=PLUGIN)
    table = json.loads((tmp_path / "page.json").read_text())
    origins = {line["method"]: line["origin"] for line in table["leaderboard"]}
    assert origins == {"gpdm": "texloom-gpdm 0.3.0", "quilting": None}
    assert ">texloom-gpdm 0.3.0<" in (tmp_path / "page.html").read_text()


def test_keys_follow_code_and_version_of_a_folder_under_development(tmp_path: Path) -> None:
    folder = tmp_path / "plugin"
    shutil.copytree(PLUGIN, folder, ignore=shutil.ignore_patterns("__pycache__"))
    paint(tmp_path / "a.png")
    first = plan(tmp_path, folder)
    assert plan(tmp_path, folder) == first
    helper = folder / "src" / "texloom_gpdm" / "projections.py"
    helper.write_text(helper.read_text() + "\n# a comment\n")
    assert plan(tmp_path, folder) == first
    helper.write_text(helper.read_text().replace("[::-1, ::-1]", "[::-1, ::1]"))
    other = plan(tmp_path, folder)
    assert other["texture"] != first["texture"]
    project = folder / "pyproject.toml"
    project.write_text(project.read_text().replace("0.3.0", "0.3.1"))
    assert plan(tmp_path, folder)["texture"] not in (first["texture"], other["texture"])


BAD = '''
import dataclasses

import numpy as np

from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import Params, stage


class BadParams(Params):
    size: tuple[int, int] = (32, 32)
    tileable: bool = False


@dataclasses.dataclass(frozen=True)
class Bad:
    image: Image
    """the texture"""
    match: Correspondence
    """where it comes from"""


calls = []


@stage(version=1)
def bad(image: Image, params: BadParams, rng: np.random.Generator) -> Bad:
    """Copy the upper left corner."""
    calls.append(1)
    height, width = params.size
    if image.height < 8:
        raise IndexError(image.height)
    match = (np.indices((height, width)).transpose(1, 2, 0) % image.height).astype(np.uint32)
    pixels = image.pixels[match[..., 0], match[..., 1]].copy()
    pixels[..., :3] = np.linspace(0, 1, width)[:, None]
    pixels[0, 0, 0] = len(calls)
    image.pixels[0, 0] = 0
    return Bad(Image(pixels, image.channels), match)
'''


def package(folder: Path, name: str, text: str) -> Path:
    """A folder under development with one stage, ``NAME.bad``."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text("")
    (folder / name / "bad.py").write_text(text)
    project = f'[project]\nname = "{name}"\n[project.entry-points."texloom.stages"]\nbad = "{name}.bad"\n'
    (folder / "pyproject.toml").write_text(project)
    return folder


@pytest.fixture(autouse=True)
def _path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])


def test_faults_of_a_stage_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(package(tmp_path, "faulty_stage", BAD)))
    found = {check.name: check for check in check_stage("faulty_stage.bad")}
    failed = {name for name, check in found.items() if check.state == "failed"}
    assert failed == {
        *("documentation", "same bits", "inputs unchanged", "masks", "tiling", "bad input"),
    }
    assert found["documentation"].detail == "not documented: inputs.image, params.size, params.tileable"
    assert "IndexError" in found["bad input"].detail
    assert "copies of transparent ones" in found["masks"].detail
    result = texloom("check-stage", "faulty_stage.bad", "--json")
    assert result.code == 1
    assert {check["name"] for check in json.loads(result.out) if check["state"] == "failed"} == failed


def test_a_sound_stage_passes() -> None:
    states = {check.name: check.state for check in check_stage("otsu")}
    assert "failed" not in states.values()
    assert texloom("check-stage", "otsu").code == 0
    assert_refused(texloom("check-stage", "otsy"), "no stage 'otsy'; did you mean 'analysis.otsu'?")


def test_the_template_of_the_documentation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "plugins.md").read_text()
    blocks = {kind: re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL) for kind in ("toml", "python", "yaml")}
    folder = tmp_path / "src" / "my_method"
    (folder / "flows").mkdir(parents=True)
    for kind, path in {
        "toml": tmp_path / "pyproject.toml",
        "python": folder / "swap.py",
        "yaml": folder / "flows" / "swap.yaml",
    }.items():
        block = blocks[kind]
        assert block is not None
        path.write_text(block[1])
    for path in (folder, folder / "flows"):
        (path / "__init__.py").write_text("")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert {check.name: check.state for check in check_stage("swap")} == {
        **dict.fromkeys(("documentation", "result", "same bits", "seed", "inputs unchanged"), "passed"),
        **dict.fromkeys(("masks", "maps", "bad input"), "passed"),
        "tiling": "skipped",
    }
    assert texloom("flows", "swap").code == 0


def test_plugins_that_cannot_be_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "missing"))
    assert_refused(texloom("stages"), f"{VARIABLE}: {tmp_path / 'missing'}: pyproject.toml: No such file")
    folders = [
        package(tmp_path / "raises", "raising_stage", "raise RuntimeError('no licence\\nfor this')"),
        package(tmp_path / "empty", "empty_stage", ""),
    ]
    monkeypatch.setenv(VARIABLE, os.pathsep.join(map(str, folders)))
    listed = texloom("stages")
    assert listed.code == 0
    assert "cannot be imported: RuntimeError: no licence for this" in listed.out
    wrong = "stage empty_stage.bad of empty_stage development: its module declares no stage of its name"
    assert_refused(texloom("stages", "empty_stage.bad"), wrong)
    (tmp_path / "empty" / "pyproject.toml").write_text("[project")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "empty" / "."))
    assert_refused(texloom("stages"), "pyproject.toml: must be TOML with a name and entry points")


BREAKING = '''
import dataclasses
import sys
from pathlib import Path

import numpy as np

from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage


class BadParams(Params):
    fault: str = "none"


@dataclasses.dataclass(frozen=True)
class Bad:
    image: Image
    """the texture"""
    height: ScalarMap
    """of the surface"""


@dataclasses.dataclass(frozen=True)
class Other:
    image: Image
    """the texture"""


@stage(version=1)
def bad(image: Image, params: BadParams) -> Bad:
    """Break the contract."""
    with Path("calls").open("a") as calls:
        calls.write("x")
    height = np.zeros((image.height, image.width), np.float32)
    pixels = np.full_like(image.pixels, np.nan)
    match params.fault:
        case "exit":
            sys.exit(3)
        case "interrupt":
            raise KeyboardInterrupt
        case "class":
            return Other(image)
        case "nothing":
            return None
        case "dtype":
            return Bad(image, height.astype(np.float64))
        case "shape":
            return Bad(image, height[0])
        case "value":
            return Bad(image, [[1.0], [1.0, 2.0]])
        case "lacking":
            return Bad(image, None)
        case "mask":
            return Bad(image, np.ma.masked_less(height, 1))
        case "nan":
            return Bad(Image(pixels, image.channels), height)
    return Bad(image, height)
'''
_OF = "stage breaking_stage.bad of breaking_stage development"
FAULTS = {
    "exit": f"{_OF} ended by sys.exit(3), which only a program may do",
    "interrupt": f"{_OF} ended by KeyboardInterrupt, which only a program may do",
    "class": f"{_OF} returned Other Other(image=",
    "nothing": f"{_OF} returned NoneType nothing, declared is Bad",
    "dtype": f"{_OF}: output 'height': float64 of shape (24, 24) is not float32 (h w)",
    "shape": f"{_OF}: output 'height': float32 of shape (24,) is not float32 (h w)",
    "value": f"{_OF}: output 'height': ",
    "lacking": f"{_OF}: output 'height': object of shape () is not float32 (h w)",
    "mask": f"{_OF}: output 'height': a masked array, whose mask would be lost, came",
    "nan": f"{_OF}: output 'image': has values that are NaN or infinite; declared is an image",
}


def _broken(folder: Path, fault: str, *words: str) -> subprocess.CompletedProcess[str]:
    """A run of the plug-in's stage in a folder."""
    flow = f"steps: {{a: {{stage: breaking_stage.bad, inputs: {{image: s}}, params: {{fault: {fault}}}}}}}\n"
    (folder / "flow.yaml").write_text(f"sources: {{s: a.png}}\n{flow}exports: {{a.png: a.image}}\n")
    variables = environment(folder) | {VARIABLE: str(folder / "plugin")}
    command = [sys.executable, "-m", "texloom", "run", "flow.yaml", "--out", "out", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, env=variables)


@pytest.mark.parametrize(
    ("fault", "runner"),
    [*((fault, "local") for fault in FAULTS), *((fault, "processes") for fault in ("exit", "interrupt", "dtype"))],
)
def test_a_stage_that_breaks_its_contract_fails_once(tmp_path: Path, fault: str, runner: str) -> None:
    package(tmp_path / "plugin", "breaking_stage", BREAKING)
    paint(tmp_path / "a.png", 24)
    done = _broken(tmp_path, fault, "--runner", runner)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert last.startswith("texloom: flow.yaml: steps.a: failed: ")
    assert FAULTS[fault] in last
    assert (tmp_path / "calls").read_text() == "x"


def test_checking_a_stage_that_ends_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = BREAKING.replace('"none"', '"exit"')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, str(package(tmp_path / "plugin", "ending_stage", text)))
    failed = {check.name: check.detail for check in check_stage("ending_stage.bad") if check.state == "failed"}
    assert "SystemExit: 3" in failed["same bits"]


@pytest.mark.parametrize("statement", ["import sys; sys.exit(3)", "raise KeyboardInterrupt"])
def test_a_package_that_ends_the_program_when_it_is_imported(tmp_path: Path, statement: str) -> None:
    package(tmp_path / "plugin", "breaking_stage", statement)
    paint(tmp_path / "a.png", 24)
    done = _broken(tmp_path, "none")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "stage breaking_stage.bad of breaking_stage development: cannot be imported: " in line
