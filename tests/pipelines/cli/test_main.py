"""The command line: exit codes, output, reports and files."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import PIL.Image
import pytest

from tests.conftest import ROOT
from tests.pipelines.flows import environment, write_set
from tests.pipelines.pictures import png
from texloom.pipelines import api
from texloom.pipelines.cli import main as cli
from texloom.pipelines.cli import run_commands
from texloom.pipelines.engine import keys as fingerprint
from texloom.pipelines.flow.shipped import GROUPS, flow_catalogue, shipped_flows
from texloom.pipelines.store import codec
from texloom.stages.common.per_pixel import device
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary import declare
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.progress import Progress, report

STEPS = [
    *("margins", "tone", "offsets", "lattice", "parts", "edges", "structure"),
    *("distance", "guidance", "start", "texture", "scores"),
]
SMALL = ["--set", "start.size=64", "--set", "texture.preset=fast"]

FLOW = """
flow: contours
sources: {exemplar: wall.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  distance: {stage: analysis.signed_distance, inputs: {structure: structure.structure}}
exports:
  distance.exr: distance.pixels
  structure.png: structure.structure
  threshold.json: structure.threshold
"""


@dataclasses.dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def report(self) -> dict[str, Any]:
        report: dict[str, Any] = json.loads(self.out)
        return report

    @property
    def states(self) -> dict[str, str]:
        steps = self.report["steps"]
        return {step["name"]: step["state"] for step in steps if step["state"] != "skipped"}


def texloom(*arguments: object) -> Result:
    """Runs the command in this process."""
    out, err = io.StringIO(), io.StringIO()
    interrupt_before = signal.getsignal(signal.SIGINT)
    try:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(sys, "argv", ["texloom", *map(str, arguments)])
            patched.setenv("PYTHONSAFEPATH", "1")  # the command sets it for the rest of its process
            with (
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
                pytest.raises(SystemExit) as stopped,
            ):
                cli.main()
    finally:
        signal.signal(signal.SIGINT, interrupt_before)  # after an interrupted run it is the system's
    assert isinstance(stopped.value.code, int)
    return Result(stopped.value.code, out.getvalue(), err.getvalue())


_OURS = ("PREFECT_API_URL", "TEXLOOM_STORE", "COVERAGE_PROCESS_START")


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in _OURS:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, in which there is nothing."""
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, a project with FLOW as flow.yaml, its exemplar wall.png, and grey.png."""
    (tmp_path / "artifacts").mkdir()
    (tmp_path / "flow.yaml").write_text(FLOW)
    save(tmp_path / "wall.png", blobs())
    save(tmp_path / "grey.png", blobs(channels=1))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blobs(height: int = 48, width: int = 56, channels: int = 3) -> np.ndarray:
    """Smooth coloured noise, 0..255."""
    noise = np.random.default_rng(5).normal(size=(height, width, channels))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0).reshape(noise.shape)
    levels: np.ndarray = np.rint(255 * (smooth - smooth.min()) / np.ptp(smooth))
    return levels.astype(np.uint8)


def save(path: Path, values: np.ndarray) -> None:
    PIL.Image.fromarray(values[..., 0] if values.shape[2] == 1 else values).save(path)


def save_exr(path: Path, values: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(values)}).write(str(path))


def tree(folder: Path) -> dict[str, tuple[int, int]]:
    """The files and folders in a folder, with sizes and times."""
    return {
        str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns) for path in folder.rglob("*")
    }


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_refused(result: Result, message: str) -> None:
    """Exit code 2 and exactly one line."""
    assert (result.code, result.out) == (2, ""), result
    assert result.err.endswith("\n")
    line = result.err.removesuffix("\n")
    assert line.isprintable()
    assert line.startswith("texloom")
    assert message in line


# -- wrong pictures


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures that no texture can be made from."""
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "words.png").write_text("not a picture\n" * 20)
    (folder / "empty.png").touch()
    (folder / "folder.png").mkdir()
    save(folder / "one.png", blobs(1, 1))
    save(folder / "nine.png", blobs(9, 9))
    save(folder / "flat.png", blobs(5, 300))
    save(folder / "small.png", blobs(16, 16))
    save(folder / "whole.png", blobs(200, 200))
    content = (folder / "whole.png").read_bytes()
    (folder / "cut.png").write_bytes(content[: len(content) // 2])
    (folder / "huge.png").write_bytes(png(np.zeros((1, 1, 3)), 8, shape=(50_000, 50_000)))
    (folder / "none.png").write_bytes(png(np.zeros((1, 1, 3)), 8, shape=(0, 0)))
    pixels = np.full((40, 40, 3), 0.5, np.float32)
    save_exr(folder / "whole.exr", pixels)
    (folder / "cut.exr").write_bytes((folder / "whole.exr").read_bytes()[:300])
    pixels[3, 4] = np.nan
    save_exr(folder / "nan.exr", pixels)
    pixels[3, 4] = np.inf
    save_exr(folder / "inf.exr", pixels)
    return folder


WRONG_PICTURES = {
    "gone.png": "no such file",
    "words.png": "is not a picture that can be read",
    "empty.png": "is empty",
    "folder.png": "is a folder",
    "one.png": "is too small: 1 x 1 px",
    "nine.png": "9 x 9 px",
    "flat.png": "300 x 5 px",
    "cut.png": "is a truncated or broken PNG file",
    "huge.png": "is too large: 50000 x 50000 px",
    "none.png": "is a truncated or broken PNG file",
    "cut.exr": "is a truncated or broken EXR file",
    "nan.exr": "1 of 1600 values NaN or infinite",
    "inf.exr": "1 of 1600 values NaN or infinite",
}


@pytest.mark.parametrize(("name", "message"), WRONG_PICTURES.items(), ids=WRONG_PICTURES)
def test_wrong_pictures(wrong: Path, empty: Path, name: str, message: str) -> None:
    result = texloom("run", "self_tuning", *SMALL, "--source", f"exemplar={wrong / name}")
    assert_refused(result, message)
    assert name in result.err or "steps." in result.err
    assert list(empty.iterdir()) == []


def test_plan_reports_errors_of_headers(wrong: Path, empty: Path) -> None:
    for name in ("gone.png", "words.png", "one.png", "nine.png", "huge.png", "none.png"):
        assert_refused(texloom("plan", "self_tuning", "--source", f"exemplar={wrong / name}"), WRONG_PICTURES[name])
    assert list(empty.iterdir()) == []


def test_an_exemplar_smaller_than_a_patch(wrong: Path, empty: Path) -> None:
    small = ["--source", f"exemplar={wrong / 'small.png'}", "--set", "texture.patch_size=16"]
    result = texloom("run", "self_tuning", *SMALL, *small)
    assert_refused(result, "steps.texture: image: 16 x 16 px is too small for patches of 16 px")
    assert list(empty.iterdir()) == []


# -- wrong commands and flows


WRONG_COMMANDS = {
    "rnu": "No such command 'rnu'. Did you mean 'run'?",
    "help": "No such command 'help'. See texloom --help.",
    "quilting mine.png": "quilting is a flow: texloom run quilting",
    "run mine.png": "mine.png: is a picture, not a flow, as in: texloom run self_tuning mine.png",
    "run self_tunning": "self_tunning: no such flow; did you mean 'self_tuning'?",
    "run zzz": "zzz: no such flow; `texloom flows` lists those that ship",
    "run self_tuning --sett a.b=1": "No such option",
    "run self_tuning --set start.size": "is not of the form PARAM=VALUE",
    "run self_tuning --set =1": "is not of the form PARAM=VALUE",
    "run self_tuning --set sise=1": ("--set sise: self_tuning has no such param; did you mean 'size'?"),
    "run self_tuning --set occurrence=3": "self_tuning has no such param; did you mean 'texture.occurrence'?",
    "run contour_report --size 64": (
        "--size: contour_report has no such param; it has one_off and those of its steps, as STEP.PARAM"
    ),
    "run quilting --preset fast": (
        "--preset: quilting has no such param; it has size, tileable and those of its steps, as STEP.PARAM"
    ),
    "run self_tuning --seed 1 --seeds 0-3": "--seed and a range of --seeds say the same; give one of them",
    "run self_tuning --size 64 --set size=64": "--size and --set size=... say the same; give one of them",
    "compare quilting self_tuning --over skimage:brick --set start.size=64": (
        "--set start.size: quilting has no step 'start'; name that of one, as self_tuning_start.size"
    ),
    "compare quilting self_tuning --over skimage:brick --preset fast": (
        "--preset: quilting has no such param; name that of one step, as self_tuning_texture.preset"
    ),
    "run rectify": "sources.exemplar: required, as in: texloom run rectify exemplar.png --source layout=layout.png",
    "run revise mine.png": "sources.exemplar: required, as in: texloom run revise mine.png --source exemplar=",
    "run rectify 'my moss.png'": "as in: texloom run rectify 'my moss.png' --source layout=layout.png",
    "plan resynthesise a.png --source target=t.png": (
        "sources.control: required, as in: "
        "texloom run resynthesise a.png --source control=control.png --source target=t.png"
    ),
    "run energy_curve --source control=c.png": (
        "sources.texture: required, as in: texloom run energy_curve texture.png --source control=c.png"
    ),
    "run self_tuning --set texture.occurrence=1 --set ' texture.occurrence=2'": (
        "'--set': 'texture.occurrence' is given twice: '1' and '2'"
    ),
    "plan self_tuning --set start.size=64 --set start.size=64": "'--set': 'start.size' is given twice",
    "compare quilting --over *.png --set a.b=1 --set a.b=2": "'--set': 'a.b' is given twice",
    "run self_tuning --source exemplar=a.png --source exemplar=b.png": (
        "'--source': 'exemplar' is given twice: 'a.png' and 'b.png'"
    ),
    "run self_tuning --source exemplar=": "is not of the form NAME=PATH",
    "run self_tuning a.png --source exemplar=b.png": "a.png is given as 'exemplar' too; give one of them",
    "plan self_tuning gone.png": "gone.png: no such file",
    "run self_tuning --source exampler=a": "did you mean 'exemplar'?",
    "run self_tuning --source exemplar=skimage:brik": "did you mean 'skimage:brick'?",
    "run self_tuning --source exemplar=https://example.org/a.png": "sources.exemplar",
    "run self_tuning --set textur.ratio=2": "no step 'textur'; did you mean 'texture'?",
    "run self_tuning --set texture.occurence=2": (
        "--set texture.occurence: no such param; did you mean 'occurrence'?"
    ),
    "run self_tuning --set texture.patch_size=big": "--set texture.patch_size: ",
    "run self_tuning --set texture.preset=best": "'kaspar2015', 'default' or 'fast'",
    "run self_tuning --set start.size=0": "--set start.size: ",
    "run self_tuning --set start.size=[64,96]": (
        "--set start.size: must be N or WIDTHxHEIGHT, got the list [64, 96]; write 96x64 or 64x96"
    ),
    "run self_tuning --size 64,96": "--size: must be N or WIDTHxHEIGHT, got the list [64, 96]; write 96x64 or",
    "run self_tuning --size wide": "--size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got 'wide'",
    "run self_tuning --size 1024*512": "--size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got '1024*512'",
    "run self_tuning --size 1e3": "--size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got '1e3'",
    "run self_tuning --size 1:30": "--size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got '1:30'",
    "run self_tuning --size 0x200": "--size: the width should be greater than or equal to 16, got 0",
    "run self_tuning --size 512x5": "--size: the height should be greater than or equal to 16, got 5",
    "run self_tuning --size ''": "--size: the value is empty",
    "plan quilting --size 64 x 48": "48: no such picture; a size is written --size N or --size WIDTHxHEIGHT",
    "plan quilting 64x48": "64x48: no such picture; a size is written --size N or --size WIDTHxHEIGHT",
    "plan quilting skimage:brick ''": "PICTURE: the name is empty; give a file, a folder or a pattern",
    "plan quilting -": "-: pictures are not read from standard input; give a file",
    "run quilting --out ''": "Invalid value for '--out' / '-o': the path is empty",
    "run quilting --store ''": "Invalid value for '--store': the path is empty",
    "run self_tuning --set size=wide": "--set size: must be N or WIDTHxHEIGHT",
    "run self_tuning --export edges.png=edges.strenght": (
        "--export edges.png: edges.strenght: step 'edges' has no output 'strenght'; did you mean 'strength'?"
    ),
    "run self_tuning --export edges.bmp=edges.strength": "'.', '_' and '-' that ends in .exr, .png, ",
    "run self_tuning --export ../edges.png=edges.strength": "--export ../edges.png: must be a file name of ",
    "run self_tuning --export offsets.png=lattice.generators": "export it as .exr",
    "run self_tuning --set start.size=[64,64,3]": (
        "--set start.size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got [64, 64, 3]"
    ),
    "run inverse --size 64x": ("--size: input should be N or WIDTHxHEIGHT, a valid number, or 'auto', got '64x'"),
    "run inverse --size 1.5": "--size: input should be less than 1, got 1.5",
    "run inverse --size 0": "--size: input should be greater than or equal to 1, got 0",
    "run per_pixel_control --set compaction=-3": (
        "--set compaction: input should be greater than or equal to 1, got -3"
    ),
    "run per_pixel --size 300 --tileable": (
        "steps.texture: size: 300 x 300 px cannot be tileable with 6 levels, which takes multiples of 64; "
        "320x320 can"
    ),
    "run per_pixel_control texloom:plaster --source control=texloom:plaster_labels "
    "--source target=texloom:plaster_target --size 300 --tileable": (
        "steps.result: size: 300 x 300 px cannot be tileable with 3 levels, which takes multiples of 8; 304x304 can"
    ),
    "run self_tuning --set start.size=[64]": (
        "--set start.size: must be N or WIDTHxHEIGHT, as 512 or 768x512, got [64]"
    ),
    # its own example is a pattern that matches nothing here
    "run joint_compaction": (
        "; give yours, as with --source 'texture=FOLDER/*_texture.png' --source 'control=FOLDER/*_control.png'"
    ),
    "run joint_compaction a.png": (
        "--source texture: takes a folder or a quoted pattern, as 'textures/*.png', got '"
    ),
    f"run photo_to_texture --set surface.geometry={ROOT / 'docs/pictures/contours.webp'}": (
        "--set surface.geometry: "
    ),
    "run self_tuning --set start.size=10x1000000000": "--set start.size: ",
    "run self_tuning --set start.size=40000": "--set start.size",
    "run self_tuning --set 'start.size=!!python/tuple [64,64]'": "tags (!!python/tuple)",
    "run self_tuning --set 'start.size=[&a 64,*a]'": "aliases (*a) are not allowed",
    "run self_tuning --seed -1": "--seed: must be a whole number",
    "run self_tuning --seed seven": "'--seed'",
    "run self_tuning --set edges.model=gone.yml": "gone.yml: no such file",
    "run self_tuning --runner dsk": "--runner: no runner 'dsk'; did you mean 'dask'?",
    "run self_tuning --runner prefect": "--runner: no runner 'prefect'; there are local",
    "run self_tuning --store ~nobody.of.this.name/x": "a home folder that is not known",
    "plan self_tuning --set texture.occurence=2": "did you mean 'occurrence'?",
    "stages ostu": "no stage 'ostu'; did you mean 'analysis.otsu'?",
    "show gone.exr": "gone.exr: no such file",
    "store ls --store gone": "--store gone: no store there",
    "store verify": "cache/texloom/store: no store there",
    "store prune": "cache/texloom/store: no store there",
    "store prune --days -1": "'--days'",
    "store limit": "cache/texloom/store: no store there",
    "run self_tuning --seeds 5-2": "5-2: the first seed is larger than the last",
    "run self_tuning --seeds 0": "0: must be from 1 to 1000 seeds",
    "store limit much": "SIZE: must be a size such as 20GB, 500MB or 4GiB, got 'much'; none removes the limit",
    "store limit 20": "SIZE: 20 has no unit; give 20GB, or 20B for bytes",
    "store limit -5GB": "No such option",
    "run 'self\ntuning'": "self\\ntuning: no such flow",
    "run quilting.yaml": "quilting.yaml: no such flow; did you mean 'quilting'?",
    f"plan quilting {300 * 'a'}": f"PICTURE: '{79 * 'a'}...: cannot be read: File name too long",
}


@pytest.mark.parametrize(("command", "message"), WRONG_COMMANDS.items(), ids=map(repr, WRONG_COMMANDS))
def test_wrong_commands(empty: Path, command: str, message: str) -> None:
    assert_refused(texloom(*shlex.split(command)), message)
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize("name", ["-lead.png", "--lead.png"])
def test_a_file_that_begins_with_a_dash(empty: Path, name: str) -> None:
    assert "write ./" not in texloom("run", "quilting", name).err
    save(empty / name, blobs())
    assert_refused(texloom("run", "quilting", name), f". For a file, write ./{name}")
    assert texloom("plan", "quilting", f"./{name}").code == 0


@pytest.mark.parametrize("command", ["run", "plan"])
def test_a_flow_is_suggested(empty: Path, command: str) -> None:
    result = texloom(command)
    assert (result.code, result.out) == (2, "")
    assert "texloom run self_tuning mine.png" in result.err
    named = re.findall(r"^    (\w+)  ", result.err, re.MULTILINE)
    assert set(named) <= set(shipped_flows())
    assert len(named) >= 5
    assert len(result.err.splitlines()) <= 20


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        *(("TEXLOOM_THREADS", value, f"TEXLOOM_THREADS: got {value!r}, want") for value in ("abc", "0", "-3")),
        ("TEXLOOM_DEVICE", "cuda", "TEXLOOM_DEVICE: got 'cuda', want cpu, gpu or auto"),
    ],
)
def test_a_wrong_environment(
    empty: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: str, message: str
) -> None:
    save(empty / "a.png", blobs())
    before = tree(empty)
    monkeypatch.setenv(name, value)
    assert_refused(texloom("run", "self_tuning"), message)
    assert_refused(texloom("compare", "quilting", "hybrid", "--over", "*.png"), message)
    assert tree(empty) == before


def test_settings_of_numba_beside_the_pictures_are_refused(empty: Path) -> None:
    """Numba reads this file of the working folder whenever it is imported, whoever wrote it."""
    save(empty / "a.png", blobs())
    (empty / ".numba_config.yaml").write_text("opt: 0\n")
    before = tree(empty)
    for command in (("run", "quilting"), ("compare", "quilting", "hybrid", "--over", "*.png"), ("studio",)):
        assert_refused(texloom(*command), ".numba_config.yaml: Numba would obey this file")
    assert tree(empty) == before


def test_numba_still_reads_the_file_that_is_refused() -> None:
    from numba.core import config

    assert config._config_fname == ".numba_config.yaml"


def test_a_gpu_that_is_not_there(empty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "gpu_problem", lambda: "there is none")
    monkeypatch.setenv("TEXLOOM_DEVICE", "gpu")
    for command in ("run", "plan"):
        assert_refused(texloom(command, "per_pixel"), "TEXLOOM_DEVICE: gpu, but there is none")
    monkeypatch.setenv("TEXLOOM_DEVICE", "auto")
    assert texloom("plan", "per_pixel").code == 0
    assert list(empty.iterdir()) == []


WRONG_FLOWS = {  # change of FLOW => error
    "analysis.otsu => analysis.ostu": "did you mean 'analysis.otsu'?",
    "{image: exemplar} => {image: exemplar}, params: {finset: 1}": "did you mean 'finest'?",
    "{image: exemplar} => {image: exemplar}, params: {finest: wide}": "got 'wide'",
    "steps:\n => steps:\n  a: {stage: synthesis.initialise, inputs: {image: a.image}}\n": "steps: a cycle: a <- a",
    "contours => !!python/name:os.getcwd ''": "tags (!!python/name:os.getcwd) are not allowed",
    "contours => &a [x]\nseed: [*a, *a]": "aliases (*a) are not allowed",
    f"contours => {'[' * 5000}": "nested too deeply",
    "distance.pixels => edges.strength\n  lines.exr: distance.nothing": "has no output 'nothing'",
}


@pytest.mark.parametrize("change", WRONG_FLOWS, ids=lambda change: repr(change[:60]))
def test_wrong_flows(empty: Path, tmp_path: Path, change: str) -> None:
    old, new = change.split(" => ")
    assert old in FLOW
    path = tmp_path / "wrong.yaml"
    path.write_text(FLOW.replace(old, new, 1))
    result = texloom("run", path)
    assert_refused(result, WRONG_FLOWS[change])
    assert f"{path}: " in result.err
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize("option", ["--store", "--out"])
def test_folders_below_a_file(folder: Path, option: str) -> None:
    before = tree(folder)
    for place in ("flow.yaml", "flow.yaml/inside", "flow.yaml/far/inside"):
        result = texloom("run", "flow.yaml", *("--store", "store", "--out", "out"), option, place)
        assert_refused(result, "is not a folder")
        assert result.err.startswith(f"texloom: {option} ")
    assert tree(folder) == before


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: (folder / "structure.png").mkdir(), "structure.png is a folder"),
        (lambda folder: shutil.move(folder / "wall.png", folder / "structure.png"), "would replace a source"),
    ],
    ids=["a folder in the way", "the exemplar has the name of an export"],
)
def test_exports_that_cannot_be_written(folder: Path, make: Callable[[Path], Any], message: str) -> None:
    (folder / "mine").mkdir()
    shutil.copy("wall.png", "mine")
    make(folder / "mine")
    source = next(path for path in ("mine/wall.png", "mine/structure.png") if Path(path).is_file())
    before = tree(folder)
    assert_refused(texloom("run", "flow.yaml", "--source", f"exemplar={source}", "--out", "mine"), message)
    assert tree(folder) == before


MAPS = "mkdir -p lib/moss && cp wall.png lib/moss/moss_albedo.png && cp grey.png lib/moss/height.png"
GEOMETRY = ["--set", "surface.geometry=threshold.json"]
SOURCE, HEIGHT = "a source of the flow", "out/height.png"
# a shell command that prepares the folder, options, the file that an export would replace, and what that is
REPLACED: dict[str, tuple[str, list[str], str, str]] = {
    "map of an item": (MAPS, ["--source", "exemplar=lib/*", "--out", "lib"], "lib/moss/height.png", SOURCE),
    "map that YAML names": (
        f"{MAPS} && mkdir sets && cd sets && "
        r"printf 'albedo: ../lib/moss/moss_albedo.png\nheight: ../lib/moss/height.png\n' > moss.yaml",
        ["--source", "exemplar=sets/*.yaml", "--out", "lib"],
        "lib/moss/height.png",
        SOURCE,
    ),
    "map of the only set": (
        MAPS,
        ["--source", "exemplar=lib/moss", "--out", "lib/moss"],
        "lib/moss/height.png",
        SOURCE,
    ),
    "flow": ("mv flow.yaml threshold.json", ["--out", "."], "threshold.json", "the flow file"),
    "hard link": ("mkdir out && ln wall.png out/height.png", ["--out", "out"], HEIGHT, SOURCE),
    "link": ("mkdir out && ln -s ../wall.png out/height.png", ["--out", "out"], HEIGHT, SOURCE),
    "linked folder": (
        "mv wall.png height.png && ln -s . out",
        ["--source", "exemplar=height.png", "--out", "out"],
        HEIGHT,
        SOURCE,
    ),
    "file of a param": (
        "echo {} > threshold.json",
        ["--set", "edges.detector=gradient", "--set", "edges.model=threshold.json", "--out", "."],
        "threshold.json",
        "a file of steps.edges.params.model",
    ),
    "geometry": ("", [*GEOMETRY, "--out", "."], "threshold.json", "a file of steps.surface.params.geometry"),
    "picture of the geometry": (
        "mkdir out && cp grey.png out/height.png",
        [*GEOMETRY, "--out", "out"],
        HEIGHT,
        "a file of steps.surface.params.geometry",
    ),
}


@pytest.mark.parametrize(("prepare", "options", "file", "what"), REPLACED.values(), ids=REPLACED)
def test_exports_that_would_replace_an_input(
    folder: Path, prepare: str, options: list[str], file: str, what: str
) -> None:
    text = FLOW.replace("structure.png", "height.png")
    if "surface" in what:
        step = "  surface: {stage: analysis.jacobian_field, inputs: {image: exemplar}}\n"
        text = text.replace("exports:", f"{step}exports:")
        patch = {"corners": [[4, 4], [4, 50], [40, 50], [40, 4]], "size": "1x1"}
        without = {"without": file} if file == HEIGHT else {}
        Path("threshold.json").write_text(json.dumps({"patches": [patch], **without}))
    Path("flow.yaml").write_text(text)
    subprocess.run(prepare, shell=True, check=True)
    before = contents(folder)
    flow = "flow.yaml" if Path("flow.yaml").exists() else "threshold.json"
    for command in ("plan", "run"):
        assert_refused(texloom(command, flow, *options), f"{file} would replace {what}; give another folder")
    assert contents(folder) == before


def test_maps_that_would_replace_what_is_read(folder: Path) -> None:
    Path("flow.yaml").write_text(FLOW.replace("structure.png: structure.structure", "maps/: exemplar"))
    Path("maps").mkdir()
    Path("maps/albedo.png").hardlink_to("wall.png")
    before = tree(folder)
    assert_refused(texloom("run", "flow.yaml", "--out", "."), "maps would replace a source of the flow")
    assert tree(folder) == before
    Path("maps/albedo.png").unlink()
    assert texloom("run", "flow.yaml", "--out", ".").code == 0


def test_exports_beside_the_maps_of_an_item(folder: Path) -> None:
    subprocess.run(MAPS, shell=True, check=True)
    for _ in range(2):  # the second time over the first
        assert texloom("run", "flow.yaml", "--source", f"exemplar={folder}/lib/*", "--out", "lib").code == 0
    assert {path.name for path in (folder / "lib/moss").iterdir()} == {
        *("moss_albedo.png", "height.png", "distance.exr", "structure.png", "threshold.json")
    }


def test_a_file_in_place_of_an_items_folder(folder: Path) -> None:
    (folder / "pictures").mkdir()
    shutil.copy("wall.png", "pictures/moss")
    before = tree(folder)
    options = ("--source", f"exemplar={folder}/pictures/*", "--out", "pictures")
    assert_refused(texloom("run", "flow.yaml", *options), "not a directory")
    assert tree(folder) == before


def test_reports_that_would_replace_what_is_read(folder: Path) -> None:
    Path("pictures").mkdir()
    shutil.move("wall.png", "pictures/wall.png")
    start = "{stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 32, method: pixels}}"
    scores = "{stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image, match: start.match}}"
    for name in ("one.yaml", "two.yaml"):
        Path(name).write_text(
            f"sources: {{exemplar: pictures/wall.png}}\nsteps:\n  start: {start}\n  scores: {scores}\n"
            "exports: {texture.png: start.image, scores.json: scores.table}\n"
        )
    before = tree(folder)
    for page, what in {
        "pictures/wall.png": "a source of the flow",
        "one.yaml": "the flow file",
        "two.yaml": "the flow file",
    }.items():
        compared = texloom("compare", "one.yaml", "two.yaml", "--over", "pictures/*.png", "--report", page)
        assert_refused(compared, f"--report {page}: would replace {what}; give another file")
        assert tree(folder) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
@pytest.mark.parametrize("option", ["--store", "--out"])
def test_folders_that_may_not_be_written(folder: Path, option: str) -> None:
    (folder / "locked").mkdir(mode=0o500)
    assert_refused(texloom("run", "flow.yaml", option, "locked/inside"), "permission denied")
    assert list((folder / "locked").iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="a folder that even root cannot write")
@pytest.mark.parametrize("option", ["--store", "--out"])
def test_folders_that_nobody_can_write(folder: Path, option: str) -> None:
    before = tree(folder)
    assert_refused(texloom("run", "flow.yaml", option, "/proc/inside"), f"{option} /proc/inside: /proc cannot be")
    assert tree(folder) == before


def test_the_installed_command(empty: Path) -> None:
    """The whole program once: no traceback, the line on stderr, the code of the process."""
    command = Path(sys.executable).with_name("texloom")
    if not command.exists():
        pytest.skip("texloom is not installed beside this Python")
    ran = subprocess.run([command, "run", "gone.yaml"], check=False, capture_output=True, text=True, cwd=empty)
    assert_refused(Result(ran.returncode, ran.stdout, ran.stderr), "texloom: gone.yaml: no such flow")
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize("runner", ["local", "processes", "dask"])
def test_modules_of_the_working_folder_are_not_imported(runner: str, tmp_path: Path) -> None:
    """A folder of pictures may hold files that are called as modules of Python, of its packages, or texloom."""
    command = Path(sys.executable).with_name("texloom")
    if not command.exists():
        pytest.skip("texloom is not installed beside this Python")
    if runner == "dask":
        pytest.importorskip("distributed")
    path = write_set(tmp_path)
    for name in ("multiprocessing", "random", "numpy", "distributed", "tornado", "texloom"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'a').write('{name} ')\n")
    known = {name: value for name, value in environment(tmp_path).items() if name != "PYTHONPATH"}
    ran = subprocess.run(
        [command, "run", path, "--runner", runner, *(["--workers", "1"] if runner != "local" else [])],
        check=False,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=known,
    )
    assert (ran.returncode, (tmp_path / "imported").exists()) == (0, False), ran.stderr


# -- self_tuning on all kinds of pictures


PICTURES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "grey.png": (lambda path: save(path, blobs(channels=1)), "Y"),
    "rgba.png": (lambda path: save(path, np.maximum(blobs(channels=4), 128)), "RGBA"),
    "deep.png": (lambda path: cv2.imwrite(str(path), blobs().astype(np.uint16) * 251), "RGB"),
    "half.exr": (lambda path: save_exr(path, (blobs() / np.float32(200)).astype(np.float16)), "RGB"),
    "dark.png": (lambda path: save(path, blobs() // 64), "RGB"),
    "constant.png": (lambda path: save(path, np.full((48, 56, 3), (180, 90, 20), np.uint8)), "RGB"),
    "black.png": (lambda path: save(path, np.zeros((48, 56, 3), np.uint8)), "RGB"),
    "white.exr": (lambda path: save_exr(path, np.full((48, 56, 3), 40, np.float32)), "RGB"),
}


@pytest.mark.parametrize(("name", "make", "channels"), [(n, *rest) for n, rest in PICTURES.items()], ids=PICTURES)
def test_valid_pictures(folder: Path, name: str, make: Callable[[Path], Any], channels: str) -> None:
    make(folder / name)
    result = texloom(
        "run", "self_tuning", *SMALL, "--source", f"exemplar={name}", "--store", "store", "--out", "out", "--json"
    )
    assert result.code == 0, result.err
    assert set(result.states) == set(STEPS)
    with OpenEXR.File("out/texture.exr", separate_channels=True) as file:
        planes = {key: channel.pixels for key, channel in file.channels().items()}
        assert set(planes) == set(channels)
        assert all(plane.shape == (64, 64) and np.isfinite(plane).all() for plane in planes.values())
    with PIL.Image.open("out/texture.png") as picture:
        assert picture.size == (64, 64)
    scores = json.loads(Path("out/scores.json").read_text())
    assert scores["summary"]
    if name.startswith(("constant", "black", "white")):
        with PIL.Image.open("out/texture.png") as picture:
            colors = np.unique(np.asarray(picture).reshape(-1, 3), axis=0)
        known = {"constant.png": [180, 90, 20], "black.png": [0, 0, 0], "white.exr": [255, 255, 255]}
        assert colors.tolist() == [known[name]], "constant pictures stay bit-identical"
    if name == "dark.png":
        with PIL.Image.open("out/texture.png") as picture:
            assert 0 < np.asarray(picture).max() <= 3


# -- caching


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which self_tuning has run, with its exemplar and store."""
    folder = tmp_path_factory.mktemp("once")
    (folder / "artifacts").mkdir()
    save(folder / "wall.png", blobs())
    with contextlib.chdir(folder):
        assert texloom(*MAIN).code == 0
    return folder


CHOSEN = {"texture.occurrence": "10", "texture.tileable": "false", "texture.coarsest": "24", "scores.window": "9"}
SETTINGS = [word for name, value in CHOSEN.items() for word in ("--set", f"{name}={value}")]
MAIN = ["run", "self_tuning", *SMALL, *SETTINGS, "--source", "exemplar=wall.png", "--out", "out", "--json"]
PLAN = ["plan", *MAIN[1:-3], "--json"]


def with_values(command: list[str], *settings: str) -> list[str]:
    """The command with other values of some of its params."""
    chosen = {setting.partition("=")[0]: setting for setting in settings}
    return [chosen.get(word.partition("=")[0], word) for word in command]


@pytest.fixture
def again(once: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, which is the working folder."""
    shutil.copytree(once, tmp_path / "again")
    monkeypatch.chdir(tmp_path / "again")
    return tmp_path / "again"


CHOOSING = """
flow: choosing
sources: {exemplar: wall.png, noise: noise.png}
steps:
  first: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: noise}}
  second: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: exemplar}}
  choice:
    stage: evaluation.choice
    inputs: {first: noise, second: exemplar, first_scores: first.table, second_scores: second.table}
    params: {labels: [noise, itself]}
exports: {choice.json: choice.table}
"""


def test_scores_are_those_of_what_was_chosen(folder: Path, rng: np.random.Generator) -> None:
    PIL.Image.fromarray(rng.integers(0, 256, (64, 64, 3)).astype(np.uint8)).save("noise.png")
    Path("choosing.yaml").write_text(CHOOSING)
    lines = texloom("run", "choosing.yaml", "--out", "out").out.splitlines()
    report = texloom("run", "choosing.yaml", "--out", "out", "--json").report["choices"]["choice"]
    assert report == json.loads(Path("out/choice.json").read_text())
    assert report["chosen"] == "itself"
    scores = {
        label: ", ".join(f"{name} {value:.2f}" for name, value in own.items() if value is not None)
        for label, own in report["scores"].items()
    }
    assert f"choice: chosen is itself ({scores['itself']}), not noise ({scores['noise']})" in lines
    assert "; itself: fidelity 1.00, " in lines[-1]


def test_workers_that_do_not_start_end_a_run_by_one_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    tries = []

    def start(*_args: object, **_options: object) -> None:
        tries.append(1)
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "SpecCluster", start)
    result = texloom("run", "flow.yaml", "--runner", "dask", "--out", "out", "--json")
    problem = "--runner dask: the workers of this machine do not start (Nanny failed to start.)"
    assert (result.code, result.report["error"], len(tries)) == (1, problem, 2)
    assert result.err.splitlines()[-1] == f"texloom: {problem}"
    assert "Traceback" not in result.err
    assert not Path("out").exists()


def test_the_report(folder: Path) -> None:
    """Other programs read it."""
    for state in ("ran", "cached"):
        result = texloom("run", "flow.yaml", "--seed", "5", "--json", "--out", "out")
        assert result.code == 0
        report = result.report
        assert [step["name"] for step in report["steps"]] == ["edges", "structure", "distance"]
        for step in report["steps"]:
            assert set(step) == {"name", "stage", "key", "state", "seconds"}
            assert step["state"] == state
            assert len(step["key"]) == 64
            assert step["seconds"] >= 0
        assert [step["stage"].partition(".")[0] for step in report["steps"]] == ["analysis"] * 3
        names = ["distance.exr", "structure.png", "threshold.json"]
        assert report["exports"] == {name: str(Path("out") / name) for name in names}
        assert all(Path(path).is_file() for path in report["exports"].values())
        assert (report["flow"], report["seed"], report["error"]) == ("contours", 5, None)
        assert Path(report["store"]) == folder / "artifacts"
        assert isinstance(json.loads(Path("out/threshold.json").read_text()), float)


def test_lines_for_people(folder: Path) -> None:
    first, second = (texloom("run", "flow.yaml", "--out", "out") for _ in range(2))
    assert (first.code, first.err, second.code, second.err) == (0, "", 0, "")
    header, *lines, last = first.out.splitlines()
    assert header == "contours: wall.png; seed 0; store artifacts"
    assert [line.split()[:3] for line in lines[:3]] == [
        ["[1/3]", "edges", "ran"],
        ["[2/3]", "structure", "ran"],
        ["[3/3]", "distance", "ran"],
    ]
    assert all(line.endswith(" s") for line in lines[:3])
    assert lines[3:] == ["out/distance.exr", "out/structure.png", "out/threshold.json"]
    assert re.fullmatch(r"3 ran in \d+\.\d s; out", last)
    again = second.out.splitlines()
    assert again[0] == header
    assert again[1:4] == ["[1/3] edges      cached", "[2/3] structure  cached", "[3/3] distance   cached"]
    assert again[4:-1] == lines[3:]
    assert re.fullmatch(r"3 cached in \d+\.\d s; out", again[-1])


def test_the_header_comes_before_the_libraries_of_steps(folder: Path) -> None:
    """So a terminal is not blank while they load."""
    program = """
import sys
from texloom.pipelines import terminal
from texloom.pipelines.cli.main import main

def header(started):
    print(sorted({"prefect", "numba", "cv2", "scipy", "skimage", "rich"} & set(sys.modules)))
    return "begun"

terminal.header = header
sys.argv = ["texloom", "run", "flow.yaml", "--out", "out"]
main()
"""
    ran = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert ran.stdout.splitlines()[:2] == ["[]", "begun"]


def test_the_last_line_has_the_scores(again: Path) -> None:
    last = texloom(*MAIN[:-1]).out.splitlines()[-1]
    summary = json.loads(Path("out/scores.json").read_text())["summary"]
    scores = ", ".join(f"{name} {value:.2f}" for name, value in summary.items() if value is not None)
    assert re.fullmatch(rf"{len(STEPS)} cached in \d+\.\d s; {scores}; out", last)


TWO_SOURCES = """
flow: holes
sources: {picture: wall.png, holes: wall.png, unused: nowhere.png}
steps:
  rest: {stage: analysis.exclusion_mask, inputs: {image: picture, mask: holes}}
exports: {rest.png: rest.valid}
"""


@pytest.mark.parametrize("command", [["plan"], ["run", "--out", "out"]])
def test_a_source_that_stays_the_example_is_named(folder: Path, command: list[str]) -> None:
    """On standard error, and only if another source is replaced."""
    (folder / "flow.yaml").write_text(TWO_SOURCES)
    shutil.copy("wall.png", "mine.png")
    arguments = [*command, "flow.yaml", "--json", "--source", "picture=mine.png"]
    result = texloom(*arguments)
    assert result.code == 0
    message = f"sources.holes: {folder}/wall.png: the flow's own example; give yours with --source holes=...\n"
    assert message in result.err
    assert result.err.count("sources.") == 1
    assert "unused" not in result.err
    assert list(result.states) == ["rest"]
    for silent in (arguments[:-2], [*arguments, "--source", "holes=wall.png"]):
        assert "sources." not in texloom(*silent).err


def test_names_of_files_are_printed_as_one_line(folder: Path) -> None:
    odd = "a\nb\x1b[31m"
    (folder / odd).mkdir()
    shutil.copy("wall.png", folder / odd / f"{odd}.png")
    source = f"exemplar={folder / odd}/*.png"
    results = [
        texloom("plan", "flow.yaml", "--source", source),
        texloom("run", "flow.yaml", "--source", source, "--out", f"out{odd}", "--store", f"store{odd}"),
        texloom("run", "flow.yaml", "--out", f"single{odd}", "--store", f"store{odd}"),
        texloom("store", "ls", "--store", f"store{odd}"),
        texloom("show", f"single{odd}/distance.exr", *(folder / f"out{odd}").rglob("*.exr"), "--png", odd),
    ]
    for result in results:
        assert result.code == 0, result
        assert (result.out + result.err).replace("\n", "").isprintable()
        assert "\nb" not in result.out + result.err
    assert r"a\nb\x1b[31m" in results[-1].out


@pytest.mark.parametrize("is_project", [False, True])
def test_the_store_is_beside_the_flow_only_in_a_project(
    folder: Path, is_project: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    if not is_project:
        (folder / "artifacts").rmdir()
    store = folder / "artifacts" if is_project else folder / "cache" / "texloom" / "store"
    before = {path.name for path in folder.iterdir()}
    report = texloom("run", "flow.yaml", "--json").report
    assert report["store"] == str(store)
    assert {Path(path).parent for path in report["exports"].values()} == {Path("wall_contours")}
    assert {path.name for path in folder.iterdir()} <= before | {"cache", "wall_contours"}
    assert {step["state"] for step in texloom("plan", "flow.yaml", "--json").report["steps"]} == {"cached"}
    assert texloom("store", "verify").out == "3 results, 0 broken\n"
    texloom("run", "flow.yaml", "--keep", "final")
    assert texloom("store", "verify").out == "3 results, 0 broken, 1 without files\n"


def test_a_wrong_source_that_no_step_takes_leaves_no_folder(folder: Path) -> None:
    (folder / "flow.yaml").write_text(
        FLOW.replace("{exemplar: wall.png}", "{exemplar: wall.png, other: half.png}").replace(
            "exports:", "exports:\n  other.png: other"
        )
    )
    shutil.copy("wall.png", "half.png")
    assert texloom("run", "flow.yaml", "--out", "out").code == 0
    whole = Path("half.png").read_bytes()
    Path("half.png").write_bytes(whole[: len(whole) // 2])
    assert texloom("run", "flow.yaml").code == 2
    assert not Path("artifacts/runs").exists()


def test_store_of_the_environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_STORE", str(folder / "elsewhere"))
    assert texloom("run", "flow.yaml").code == 0
    assert (folder / "elsewhere" / "cache").is_dir()
    assert texloom("store", "ls").code == 0


def test_a_run_that_is_cached_writes_the_same_exports(again: Path) -> None:
    before = contents(again / "out")
    shutil.rmtree(again / "out")
    result = texloom(*MAIN)
    assert set(result.states.values()) == {"cached"}
    assert contents(again / "out") == before


def test_a_param_runs_its_step_and_later_ones_again(again: Path) -> None:
    result = texloom(*with_values(MAIN, "texture.occurrence=20"))
    assert result.states == {**dict.fromkeys(STEPS, "cached"), "texture": "ran", "scores": "ran"}
    assert set(texloom(*MAIN).states.values()) == {"cached"}, "earlier results are kept"


def test_a_seed_runs_random_steps_again(again: Path) -> None:
    states = texloom(*MAIN, "--seed", "8").states
    assert [name for name in STEPS if states[name] == "ran"] == ["start", "texture", "scores"]


def test_equal_results_keep_later_steps_cached(folder: Path) -> None:
    save(folder / "wall.png", np.full((48, 48, 3), 100, np.uint8))
    texloom("run", "flow.yaml")
    changed = ["--set", "edges.finest=3.0", "--json"]
    plans = {step["name"]: step["state"] for step in texloom("plan", "flow.yaml", *changed).report["steps"]}
    assert plans == {"edges": "run", "structure": "wait", "distance": "wait"}
    assert texloom("run", "flow.yaml", *changed).states == {
        "edges": "ran", "structure": "cached", "distance": "cached",
    }  # fmt: skip


# -- plan


def planned(*options: str, settings: Sequence[str] = ()) -> dict[str, tuple[str, list[str]]]:
    result = texloom(*with_values(PLAN, *settings), *options)
    assert result.code == 0, result.err
    for step in result.report["steps"]:
        assert set(step) == {"name", "stage", "state", "reasons", "key"}
        assert (step["key"] is None) == (step["state"] in ("wait", "skipped"))
    listed = [step for step in result.report["steps"] if step["state"] != "skipped"]
    return {step["name"]: (step["state"], step["reasons"]) for step in listed}


CACHED: tuple[str, list[str]] = ("cached", [])


def test_plan_of_what_has_never_run(folder: Path) -> None:
    before = tree(folder)
    plan = planned()
    assert list(plan) == STEPS
    assert plan["margins"] == ("run", ["never run before"])
    assert plan["structure"] == ("wait", ["waits for edges, tone"])
    assert plan["texture"] == ("wait", ["waits for distance, edges, guidance, lattice, parts, start"])
    assert tree(folder) == before


def test_plan_says_why(again: Path) -> None:
    before = tree(again)
    assert planned() == dict.fromkeys(STEPS, CACHED)

    plan = planned(settings=["texture.occurrence=20"])
    assert plan["texture"] == ("run", ["param occurrence: 10.0 -> 20.0"])
    assert plan["scores"] == ("wait", ["waits for texture"])
    assert {plan[name] == CACHED for name in STEPS[:-2]} == {True}

    plan = planned(settings=["texture.occurrence=20", "texture.tileable=true", "scores.window=11"])
    assert plan["texture"] == ("run", ["param occurrence: 10.0 -> 20.0", "param tileable: false -> true"])
    assert plan["scores"] == ("wait", ["param window: 9 -> 11", "waits for texture"])

    plan = planned("--seed", "8")
    assert plan["start"] == ("run", ["seed: 7/start -> 8/start"])
    assert plan["texture"] == ("wait", ["seed: 7/texture -> 8/texture", "waits for start"])
    assert tree(again) == before


def test_plan_after_another_picture(again: Path) -> None:
    save(again / "wall.png", blobs(52, 52))
    plan = planned()
    assert plan["margins"] == ("run", ["input image changed"])
    assert plan["start"] == ("wait", ["waits for lattice, parts, structure"])


def test_plan_after_another_version_or_code(again: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = find_stage("analysis.otsu")
    changed = dataclasses.replace(stage, version=stage.version + 1)
    monkeypatch.setitem(declare.declared, "analysis.otsu", changed)
    plan = planned()
    assert plan["edges"] == CACHED
    assert plan["structure"] == ("run", [f"version of analysis.otsu: {stage.version} -> {changed.version}"])
    assert plan["distance"] == ("wait", ["waits for structure"])
    monkeypatch.undo()
    monkeypatch.chdir(again)
    digest = fingerprint.code_digest
    monkeypatch.setattr(
        fingerprint,
        "code_digest",
        lambda name: "0" * 64 if name == "texloom.stages.analysis.structure.otsu" else digest(name),
    )
    assert planned()["structure"] == ("run", ["code of analysis.otsu changed"])


def test_plan_of_a_broken_result(again: Path) -> None:
    (again / "artifacts/cache/analysis.otsu").rename(again / "gone")
    plan = planned()
    assert plan["structure"] == ("run", ["broken: its files are missing"])
    result = texloom(*MAIN)
    assert result.states["structure"] == "ran"
    assert result.states["texture"] == "cached"
    assert "structure: the stored result is broken (its files are missing); computing it again" in result.err


def test_plan_for_people(again: Path) -> None:
    lines = texloom(*with_values(PLAN, "texture.occurrence=20")[:-1]).out.splitlines()
    assert lines[0] == "margins      cached"
    lines = [line for line in lines if " skipped " not in line]
    assert lines[-3:-1] == [
        "texture      run      param occurrence: 10.0 -> 20.0",
        "scores       wait     waits for texture",
    ]
    taken = r"takes about \d+ s, \d+\.\d MB of memory and \d+\.\d [kM]B of disk"
    measured = "time and disk as their last results took, else estimated"
    assert re.fullmatch(rf"\d+ cached, 1 to run, 1 waiting; {taken}; {measured}", lines[-1])


def test_a_plan_takes_time_and_disk_from_the_last_results(folder: Path) -> None:
    """In proportion to the size, for the same exemplar; else they are estimated."""
    run = ["quilting", "wall.png", "--set", "scores.window=5", "--out", "out"]

    def summary(*options: str) -> dict[str, Any]:
        return dict(texloom("plan", *run, "--seed", "4", "--json", *options).report["summary"])

    assert summary("--size", "64")["measured"] == 0
    assert texloom("run", *run, "--size", "64").code == 0
    small, large = summary("--size", "64"), summary("--size", "128")
    results = [path for path in Path("artifacts/cache").rglob("*") if path.is_file()]
    manifests = [json.loads(path.read_text()) for path in results if path.name == "manifest.json"]
    manifests = [one for one in manifests if one["stage"] != "analysis.tone"]  # whatever the seed, it is cached
    assert small["measured"] == large["measured"] == 2
    assert small["seconds"] == pytest.approx(sum(one["seconds"] for one in manifests))
    assert large["seconds"] == pytest.approx(4 * small["seconds"])
    stored = sum(file["bytes"] for one in manifests for file in one["files"].values())
    assert stored < small["disk"] < large["disk"] < 5 * stored + 16 * 128**2
    assert 4e8 < small["memory"] < large["memory"] < 7e8
    save(folder / "wall.png", blobs(40, 40))
    assert summary("--size", "64")["measured"] == 0
    assert texloom("run", *run, "--size", "64").code == 0
    done = texloom("plan", *run, "--size", "64", "--json").report["summary"]
    assert (done["states"], done["seconds"], done["disk"]) == ({"cached": 3}, 0, 0)


def test_a_plan_of_a_set_counts_items_that_are_new_like_the_others(folder: Path) -> None:
    (folder / "library").mkdir()
    save(folder / "library" / "a.png", blobs())
    assert texloom("run", "flow.yaml", "library", "--out", "out").code == 0
    for name in "bc":
        save(folder / "library" / f"{name}.png", blobs(50))
    whole = texloom("plan", "flow.yaml", "library", "--out", "out", "--json").report["summary"]
    assert (whole["items"], whole["measured"], whole["states"]["cached"]) == (3, 6, 3)


def test_a_file_called_like_a_flow_that_ships_is_told(folder: Path) -> None:
    shutil.copy("flow.yaml", "quilting.yaml")
    told = "quilting is a flow that ships; `texloom run quilting.yaml` runs the file here\n"
    assert told in texloom("plan", "quilting", "wall.png").err
    for flow in ("quilting.yaml", "flow.yaml", "per_pixel"):
        assert "is a flow that ships" not in texloom("plan", flow).err


def test_plan_is_refused_where_run_would_be(folder: Path) -> None:
    (folder / "wall_contours").mkdir()
    (folder / "wall_contours" / "structure.png").write_bytes(b"somebody's")
    for command in ("plan", "run"):
        assert_refused(texloom(command, "flow.yaml"), "structure.png was not written by texloom")


def test_plan_of_a_set_is_short(folder: Path) -> None:
    """A line a step, and one for what is refused, which makes the plan one that is refused."""
    pictures = folder / "library"
    pictures.mkdir()
    for name in "abcdefghi":
        shutil.copy(folder / "wall.png", pictures / f"{name}.png")
    planned = texloom("plan", "flow.yaml", "library")
    assert planned.code == 0
    assert re.search("edges +9 run", planned.out)
    assert planned.out.splitlines()[-1].startswith("9 items: ")
    (pictures / "b.png").write_bytes(b"no picture")
    planned = texloom("plan", "flow.yaml", "library")
    assert planned.code == 2
    assert re.search("edges +8 run", planned.out)
    assert len([line for line in planned.out.splitlines() if line.startswith("b/")]) == 1
    assert "1 refused" in planned.out.splitlines()[-1]


def test_plan_takes_what_run_takes(folder: Path) -> None:
    before = contents(folder)
    options = ["--out", "out", "--runner", "threads", "--workers", "2", "--texel-size", "1mm"]
    planned = texloom("plan", "flow.yaml", *options)
    assert (planned.code, planned.out.split()[:2]) == (0, ["edges", "run"])
    assert_refused(texloom("plan", "flow.yaml", "--workers", "2"), "--workers: needs a runner that has it")
    assert contents(folder) == before


# -- failures during a run


@pytest.fixture
def replace(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Callable[[], None]], None]:
    """Makes a stage call something first."""

    def replace(name: str, before: Callable[[], None]) -> None:
        stage = find_stage(name)

        @functools.wraps(stage.function)
        def function(*arguments: Any, **named: Any) -> Any:
            before()
            return stage.function(*arguments, **named)

        monkeypatch.setitem(declare.declared, name, dataclasses.replace(stage, function=function))

    return replace


def raising(error: BaseException) -> Callable[[], None]:
    def function() -> None:
        raise error

    return function


def test_a_stage_that_fails(folder: Path, replace: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        stage = find_stage("analysis.otsu")
        failing = functools.wraps(stage.function)(lambda **_: raising(RuntimeError("no luck\nat \x1b[31mall"))())
        patch.setitem(declare.declared, stage.name, dataclasses.replace(stage, function=failing))
        result = texloom("run", "flow.yaml", "--json", "--out", "out")
    assert result.code == 1
    assert result.states == {"edges": "ran", "structure": "failed"}
    assert result.report["exports"] == {}
    assert "RuntimeError('no luck\\nat \\x1b[31mall')" in result.report["error"]
    assert "\x1b" not in result.err, "a terminal would obey it"
    assert "Traceback" in result.err, "a defect needs its traceback"
    assert result.err.splitlines()[-1] == f"texloom: {result.report['error']}"
    assert "flow.yaml: steps.structure: failed: " in result.report["error"]
    assert not Path("out").exists()
    mended = texloom("run", "flow.yaml", "--json")
    assert mended.states == {"edges": "cached", "structure": "ran", "distance": "ran"}


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError(28, "No space left on device"), "steps.structure: failed: [Errno 28] No space left on device"),
        (MemoryError(), "steps.structure: failed: not enough memory"),
    ],
    ids=["full disk", "memory"],
)
def test_a_machine_that_fails(folder: Path, replace: Any, error: Exception, message: str) -> None:
    replace("analysis.otsu", raising(error))
    result = texloom("run", "flow.yaml")
    assert result.code == 1
    assert result.err.splitlines() == [f"texloom: flow.yaml: {message}"]


def test_a_stage_that_refuses(folder: Path, replace: Any) -> None:
    replace("analysis.otsu", raising(InputError("strength: has none")))
    result = texloom("run", "flow.yaml", "--json")
    assert result.code == 2
    assert result.err.splitlines()[-1] == "texloom: flow.yaml: steps.structure: strength: has none"
    assert result.states == {"edges": "ran", "structure": "failed"}
    assert "Traceback" not in result.err


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)


STOPS = [pytest.param(interrupt, 130, "interrupted"), pytest.param(terminate, 143, "terminated")]


@pytest.mark.parametrize(("stop", "code", "word"), STOPS)
def test_stopped_in_a_stage(folder: Path, replace: Any, stop: Callable[[], None], code: int, word: str) -> None:
    before = signal.getsignal(signal.SIGTERM)
    replace("analysis.otsu", stop)
    result = texloom("run", "flow.yaml", "--json")
    assert result.code == code
    assert f"{word}; what is finished is kept, and the next run goes on" in result.report["error"]
    assert "Traceback" not in result.err
    assert result.states == {"edges": "ran"}
    assert texloom("run", "flow.yaml", "--json").code == code
    assert texloom("plan", "flow.yaml", "--json").report["steps"][0]["state"] == "cached"
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(("stop", "code", "word"), STOPS)
def test_stopped_while_a_class_is_defined(
    folder: Path, monkeypatch: pytest.MonkeyPatch, stop: Callable[[], None], code: int, word: str
) -> None:
    class Attribute:
        def __set_name__(self, owner: type, name: str) -> None:
            stop()

    monkeypatch.setattr(run_commands, "_open", lambda *_, **__: type("Defined", (), {"attribute": Attribute()}))
    result = texloom("run", "flow.yaml")
    assert (result.code, result.err.strip()) == (code, f"texloom: {word}")


@pytest.mark.parametrize(
    "told", [ImportError("initialization failed"), SystemError("a result with an exception set")]
)
@pytest.mark.parametrize(("stop", "code", "word"), STOPS)
def test_stopped_in_a_library(
    folder: Path, replace: Any, stop: Callable[[], None], code: int, word: str, told: Exception
) -> None:
    """As pybind11 tells it while a module is imported, and Numba while a kernel runs."""

    def edges(**_: Any) -> None:
        try:
            stop()
        except KeyboardInterrupt as error:
            raise told from error

    replace("analysis.edges", edges)
    result = texloom("run", "flow.yaml")
    assert result.code == code
    assert result.err.strip().splitlines()[-1].startswith(f"texloom: {word}; what is finished is kept")
    assert "Traceback" not in result.err


@pytest.mark.parametrize("command", ["run", "plan"])
@pytest.mark.parametrize(("stop", "code", "word"), STOPS)
def test_stopped_before_the_first_step(
    folder: Path, monkeypatch: pytest.MonkeyPatch, command: str, stop: Callable[[], None], code: int, word: str
) -> None:
    monkeypatch.setattr(run_commands, "_open", lambda *_, **__: stop())
    before = tree(folder)
    result = texloom(command, "flow.yaml")
    assert (result.code, result.err.strip()) == (code, f"texloom: {word}")
    assert tree(folder) == before


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (codec.ArtifactError("x.json: a value is not finite"), "texloom: --out: x.json: a value is not finite"),
    ],
    ids=["full disk", "value that cannot be written"],
)
def test_exports_that_fail(folder: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, message: str) -> None:
    monkeypatch.setattr(codec, "export", lambda *_: raising(error)())
    result = texloom("run", "flow.yaml")
    assert result.code == 1
    assert message in result.err
    assert len(result.err.splitlines()) == 1
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    assert set(texloom("run", "flow.yaml", "--json").states.values()) == {"cached"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_standard_output_that_is_full(unbuffered: str, empty: Path) -> None:
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(
            [sys.executable, "-m", "texloom", "flows"], check=False, stdout=full, stderr=subprocess.PIPE, text=True,
            cwd=empty, env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert (ran.returncode, ran.stderr) == (1, "texloom: standard output: No space left on device\n")


def test_program_errors_are_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong request is an `InputError`; any other `ValueError` is a mistake in the program."""
    monkeypatch.setattr(run_commands, "_open", lambda *_, **__: raising(ValueError("mistake"))())
    monkeypatch.setattr(sys, "argv", ["texloom", "plan", "self_tuning"])
    with pytest.raises(ValueError, match=r"^mistake$"):
        cli.main()


@pytest.mark.parametrize("library", ["click", "numpy"])
@pytest.mark.parametrize(("name", "code", "word"), [("INT", 130, "interrupted"), ("TERM", 143, "terminated")])
def test_stopped_while_libraries_are_imported(empty: Path, library: str, name: str, code: int, word: str) -> None:
    lines = ("import os, signal", "if 'AGAIN' in os.environ:", "    raise ImportError('again')")
    lines = (*lines, "os.environ['AGAIN'] = ''", f"signal.raise_signal(signal.SIG{name})\n")
    (empty / f"{library}.py").write_text("\n".join(lines))
    handled = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # a background ignores it
    start = f"{handled}; import runpy; runpy.run_module('texloom', run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", start, "plan", "self_tuning"], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": f"{empty}{os.pathsep}{ROOT / '.import'}"},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr.strip()) == (code, "", f"texloom: {word}")


def test_a_closed_pipe(empty: Path) -> None:
    """As in `texloom stages | head`."""
    code = "from texloom.pipelines.cli.main import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-c", code, "stages", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment,
    )  # fmt: skip
    assert process.stdout
    process.stdout.close()
    assert process.stderr
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 1


def test_a_run_that_writes_tx_ends_without_complaints(folder: Path) -> None:
    """OpenImageIO complains about what is not collected at exit."""
    pytest.importorskip("OpenImageIO")
    done = subprocess.run(
        [sys.executable, "-m", "texloom", "run", "flow.yaml", "--export", "wall.tx=edges.strength"],
        check=False, capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0
    assert "leaked" not in done.stderr


def test_progress_goes_to_stderr_and_the_report_to_stdout(folder: Path, replace: Any) -> None:
    def slow() -> None:
        clock.update(now=clock["now"] + 11)
        report(Progress(0.25, scale=1, scales=4))
        clock.update(now=clock["now"] + 11)
        report(Progress(0.5, scale=2, scales=4, iteration=3, iterations=9, energy=12.345))

    clock = {"now": 0.0}
    replace("analysis.otsu", slow)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("texloom.pipelines.terminal.time.monotonic", lambda: clock["now"])
        result = texloom("run", "flow.yaml", "--json")
    assert result.code == 0
    assert set(result.states.values()) == {"ran"}
    lines = result.err.splitlines()
    assert lines[0].startswith("contours: wall.png; ")
    assert lines[1].split()[:3] == ["[1/3]", "edges", "ran"]
    assert lines[2:4] == [
        "[2/3] structure: 25 %, scale 1/4",
        "[2/3] structure: 50 %, 0:22 left, scale 2/4, iteration 3/9, energy 12.35",
    ]


# -- pictures and exports of the command line


def test_pictures_are_the_first_source(folder: Path) -> None:
    one = texloom("run", "flow.yaml", "grey.png", "--out", "one", "--export", "edges.png=edges.strength", "--json")
    assert one.code == 0
    assert {"distance.exr", "edges.png"} <= set(one.report["exports"])
    assert (folder / "one" / "edges.png").is_file()
    again = texloom("run", "flow.yaml", "--source", "exemplar=grey.png", "--out", "again", "--json")
    assert set(again.states.values()) == {"cached"}
    assert not (folder / "again" / "edges.png").exists()
    several = texloom("run", "flow.yaml", "grey.png", "wall.png", "--out", "set")
    assert several.code == 0
    assert {path.name for path in (folder / "set").iterdir()} == {"grey", "wall"}


# -- the other commands


def test_stages() -> None:
    listed = texloom("stages")
    assert listed.code == 0
    assert tuple(line.split()[0] for line in listed.out.splitlines()[: len(stage_names())]) == stage_names()
    assert json.loads(texloom("stages", "--json").out).keys() == set(stage_names())
    one = texloom("stages", "optimise")
    assert "\n  occurrence: float = " in one.out
    assert json.loads(texloom("stages", "optimise", "--json").out)["name"] == "synthesis.optimise"


def test_flows(empty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = texloom("flows")
    assert listed.code == 0
    shown = {name for name, entry in flow_catalogue().items() if entry.listed}
    assert set(re.findall(r"^  (\w+)  ", listed.out, re.MULTILINE)) == shown
    assert {"self_tuning", "quilting", "materials", "fill", "on_mesh"} <= shown
    assert len(shown) <= 32
    assert max(map(len, listed.out.splitlines())) <= 80
    assert list(GROUPS.values())[:-1] == [line for line in listed.out.splitlines() if line in GROUPS.values()]
    studies = set(re.findall(r"^  (\w+)  ", texloom("flows", "--studies").out, re.MULTILINE))
    assert "ablation" in studies
    named = set(re.findall(r"\w+", listed.out.partition("Also by name: ")[2].partition("\ntexloom")[0]))
    found = json.loads(texloom("flows", "--json").out)
    assert set(found) == shown | studies | named == set(shipped_flows())
    assert found["quilting"]["group"] == "larger"
    (empty / "mine.yaml").write_text(FLOW.lstrip())
    assert "\n  edges      analysis.edges: " in texloom("flows", "mine.yaml").out
    assert json.loads(texloom("flows", "mine.yaml", "--json").out)["sources"] == {
        "exemplar": str(empty / "wall.png")
    }
    assert_refused(texloom("flows", "mina"), "mina: no such flow")


def test_show(again: Path) -> None:
    (file,) = (again / "artifacts/cache/synthesis.initialise").rglob("result.exr")
    shown = texloom("show", file)
    assert shown.code == 0
    for word in ("match.row", "match.column", "uint32", "synthesis.initialise", "seed"):
        assert word in shown.out
    assert re.search(r"parts\.image,\s+sha256 [0-9a-f]{12}\b", shown.out)
    assert re.search(r"lattice\.generators,\s+sha256 [0-9a-f]{12}\b", shown.out)
    report = texloom("show", file, "--png", "pictures", "--json").report
    assert {Path(path).parent.name for path in report["pictures"]} == {"pictures"}
    for path in report["pictures"]:
        with PIL.Image.open(path) as picture:
            assert picture.size == (64, 64)
    shown = texloom("show", "out/texture.exr", "--png", "texture")
    assert shown.out.splitlines()[-1].startswith("texture/")
    files = sorted((again / "artifacts/cache").rglob("result.exr"))
    shown = texloom("show", *files, "--png", "all")
    assert shown.code == 0
    assert all(f"{path}:\n  compression: " in shown.out for path in files)
    (strength,) = Path("all").rglob("strength.png")
    assert strength.parts[1:2] == ("analysis.edges",)
    listed = json.loads(texloom("show", *files[:2], "--json").out)
    assert [one["file"] for one in listed] == list(map(str, files[:2]))
    for wrong in ("out/texture.png", "out/scores.json", "out"):
        assert_refused(texloom("show", wrong, "--png", "none"), wrong)
    assert_refused(texloom("show", "out/texture.exr", "--png", "out/texture.png"), "is not a folder")
    assert not Path("none").exists()


def _exr(path: Path, *layers: str, level: float = 0.5) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    planes = {layer: np.full((4, 6), level, np.float32) for layer in layers}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes).write(str(path))
    return path


def test_pictures_of_several_files_stay_in_the_folder(empty: Path) -> None:
    _exr(empty / "a/b/c/y.exr", "depth")
    _exr(empty / "a/x.exr", "depth")
    shown = texloom("show", "--png", "pictures", "a/b/c/y.exr", "a/b/c/../../x.exr")
    assert shown.code == 0
    assert {str(path) for path in Path("pictures").rglob("*.png")} == {
        "pictures/b/c/y/depth.png",
        "pictures/x/depth.png",
    }
    assert {path.name for path in empty.iterdir()} == {"a", "pictures"}


def test_file_names_of_dots_get_folders_of_their_own(empty: Path) -> None:
    for name in ("...exr", "..exr", "one.exr", "one.EXR"):
        _exr(empty / "in" / name, "depth")
    files = sorted(Path("in").iterdir())
    assert texloom("show", "--png", "pictures", *files).code == 0
    written = {str(path.parent) for path in Path("pictures").rglob("*.png")}
    assert written == {f"pictures/{path.name}" for path in files}
    assert {path.name for path in empty.iterdir()} == {"in", "pictures"}


def test_pictures_replace_no_file_of_another(empty: Path) -> None:
    _exr(empty / "one.exr", "wall", "floor")
    _exr(empty / "two.exr", "wall", level=0.25)
    Path("wall.png").write_bytes(b"mine")
    before = tree(empty)
    assert_refused(texloom("show", "one.exr", "--png", "."), "wall.png: is there already and holds something else")
    assert tree(empty) == before
    Path("pictures/two").mkdir(parents=True)
    Path("pictures/two/wall.png").symlink_to("nowhere")
    assert_refused(texloom("show", "one.exr", "two.exr", "--png", "pictures"), "pictures/two/wall.png: is there")
    assert not Path("pictures/one").exists()
    for _ in range(2):  # what is the same is no harm
        assert texloom("show", "one.exr", "--png", "again").code == 0


def test_store(again: Path) -> None:
    entries = json.loads(texloom("store", "ls", "--json").out)
    assert [entry["stage"] for entry in entries] == sorted(entry["stage"] for entry in entries)
    assert {entry["step"] for entry in entries} == set(STEPS)
    known = {"stage", "key", "folder", "size", "used", "flow", "sources", "seeds", "item", "step"}
    assert all(set(entry) == known for entry in entries)
    assert {entry["flow"] for entry in entries} == {"self_tuning"}
    assert {Path(entry["sources"]["exemplar"]).name for entry in entries} == {"wall.png"}

    verified = texloom("store", "verify")
    assert (verified.code, verified.out) == (0, f"{len(STEPS)} results, 0 broken\n")
    (file,) = (again / "artifacts/cache/analysis.otsu").rglob("result.exr")
    with file.open("r+b") as stream:
        stream.seek(-1, os.SEEK_END)
        last = stream.read(1)
        stream.seek(-1, os.SEEK_END)
        stream.write(bytes([last[0] ^ 1]))
    verified = texloom("store", "verify")
    assert verified.code == 1
    assert verified.out.splitlines() == [
        f"{file.parent}: result.exr has been altered",
        f"{len(STEPS)} results, 1 broken",
    ]
    problems = [entry["problem"] for entry in json.loads(texloom("store", "verify", "--json").out)]
    assert [problem for problem in problems if problem] == ["result.exr has been altered"]


def test_the_list_is_by_run(again: Path) -> None:
    texloom(*with_values(MAIN, "texture.occurrence=20"))
    for record in (again / "artifacts" / "records").iterdir():
        os.utime(record)  # or its age depends on when the fixture was made
    rows = [line.split() for line in texloom("store", "ls").out.splitlines()]
    assert rows[0] == ["FLOW", "PICTURE", "STEP", "SIZE", "LAST", "USED"]
    assert rows[1][:3] == ["self_tuning", "wall.png", "margins"]
    assert [row[0] for row in rows[2 : 1 + len(STEPS)]] == STEPS[1:]
    assert rows[1 + len(STEPS)][:3] == ["self_tuning", "wall.png", "texture"], "only what the later run did not use"
    assert all(row[-2:] == ["just", "now"] and row[-3] in ("B", "kB", "MB") for row in rows[2:-1])
    assert rows[-1][-2:] == [str(len(STEPS) + 2), "results"]
    shutil.rmtree("artifacts/log")
    assert {line.split()[0] for line in texloom("store", "ls").out.splitlines()[1:11]} <= set(stage_names())


def test_a_store_of_arrays_and_its_limit_are_told_in_words(folder: Path, rng: np.random.Generator) -> None:
    exemplar = rng.integers(0, 256, (48, 48, 3), np.uint8)
    maps = {"albedo": exemplar, "height": exemplar[..., 0]}
    for given in (exemplar, maps):
        api.synthesize(given, method="quilting", size=48, store=folder / "own")
    listed = texloom("store", "ls", "--store", "own").out
    assert not re.search(r"[0-9a-f]{64}", listed)
    assert [line.split()[:2] for line in listed.splitlines() if " array" in line] == [
        ["quilting", "array"], ["quilting", "array"], ["2", "arrays"],
    ]  # fmt: skip
    assert "own has a limit of 1.0 GB" in texloom("store", "limit", "1GB", "--store", "own").out
    assert "own has no limit" in texloom("store", "limit", "none", "--store", "own").out


# -- whose store it is


@pytest.fixture
def project(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder of a project that has a folder ``artifacts`` of its own, with files of the user."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "user cache"))
    for name in ("artifacts/runs/experiment1/a.txt", "artifacts/sources/data.csv", "user/thesis.txt"):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text("mine")
        os.utime(folder / name, (1, 1))
    return folder


def test_a_folder_of_the_user_is_left_alone(project: Path) -> None:
    before = tree(project / "artifacts")
    ran = texloom("run", "flow.yaml", "--out", "out", "--json")
    assert ran.code == 0
    (note,) = ran.report["notes"]
    store = project / "user cache" / "texloom" / "store"
    assert (
        note == f"artifacts holds other files and is left alone, results are in {store}; --store chooses a folder"
    )
    assert note in ran.err
    assert ran.report["store"] == str(store)
    pruned = texloom("store", "prune", "--days", "0")
    assert (pruned.code, pruned.err) == (0, f"{note}\n")
    assert tree(project / "artifacts") == before
    shown = Path("artifacts")
    assert_refused(
        texloom("run", "flow.yaml", "--store", shown), "artifacts: holds files and is no store; give a new"
    )
    for command in ("ls", "verify", "prune"):
        assert_refused(texloom("store", command, "--store", shown), "no store there")
    assert_refused(texloom("store", "limit", "1GB", "--store", shown), "holds files and is no store")
    assert_refused(texloom("store", "adopt"), "no store there")
    assert tree(project / "artifacts") == before


@pytest.mark.parametrize("formed", [False, True])
def test_a_link_in_a_folder_that_came_with_a_project_deletes_nothing(project: Path, formed: bool) -> None:
    """With settings that would remove everything at the end of each run."""
    shutil.rmtree("artifacts")
    Path("artifacts").mkdir()
    Path("artifacts/runs").symlink_to(project / "user")
    Path("artifacts/settings.json").write_text('{"limit": 1}')
    for name in ("cache", "records") if formed else ():
        (Path("artifacts") / name).mkdir()
    assert texloom("run", "flow.yaml").code == 0
    assert_refused(texloom("run", "flow.yaml", "--store", "artifacts"), "is a link")
    assert Path("user/thesis.txt").read_text() == "mine"


def test_a_store_of_another_user_is_adopted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    assert texloom("run", "flow.yaml", "--out", "out").code == 0
    assert texloom("store", "limit", "1GB").code == 0
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
    remedy = f"`texloom store adopt --store {folder}/artifacts` takes it over"
    for command in (["run", "flow.yaml"], ["plan", "flow.yaml"], ["store", "ls"], ["store", "prune"]):
        assert_refused(texloom(*command, "--store", "artifacts"), remedy)
    ran = texloom("run", "flow.yaml", "--json", "--out", "new")
    assert "artifacts was made by another user or machine and is left alone" in ran.report["notes"][0]
    assert set(ran.states.values()) == {"ran"}

    adopted = texloom("store", "adopt")
    assert adopted.code == 0
    assert re.fullmatch(rf"{folder}/artifacts: 3 results and 0 other folders, [\d.]+ kB, taken over\n", adopted.out)
    assert adopted.err.endswith(
        "its limit of 1.0 GB was not set by this user and does not apply; `texloom store limit SIZE` sets one\n"
    )
    assert texloom("store", "adopt", "--json").report["adopted"] is False
    ran = texloom("run", "flow.yaml", "--json", "--out", "new")
    assert set(ran.states.values()) == {"cached"}
    assert ran.report["notes"] == []
    ran = texloom("run", "flow.yaml", "--json", "--out", "new", "--set", "edges.finest=3")
    assert "does not apply" in ran.err
    assert texloom("store", "limit", "--json").report == {"limit": None}


@pytest.mark.parametrize(
    "options",
    [
        ["--out", "o" * 256],
        ["--out", f"{'é' * 128}/out"],
        ["--out", "o" * 255 + "/" + "p/" * 1900],
        ["--out", "out", "--store", "s" * 256],
    ],
)
def test_a_name_that_is_too_long_is_refused_before_anything_is_computed(folder: Path, options: list[str]) -> None:
    before = tree(folder)
    result = texloom("run", "flow.yaml", *options)
    assert_refused(result, "bytes; ")
    assert tree(folder) == before


def test_the_longest_names_are_written(folder: Path) -> None:
    name = "e" * 128 + ".png"
    assert texloom("run", "flow.yaml", "--out", "o" * 255, "--export", f"{name}=edges.strength").code == 0
    assert (folder / ("o" * 255) / name).is_file()


def test_an_array_is_listed_without_its_digest(folder: Path) -> None:
    api.run("flow.yaml", {"exemplar": np.zeros((24, 24), np.uint8)}, store="store")
    rows = [line.split() for line in texloom("store", "ls", "--store", "store").out.splitlines()]
    assert rows[1][:3] == ["contours", "array", "edges"]


def test_prune(again: Path) -> None:
    assert texloom("store", "prune").out == "0 results, 0 bytes removed; nothing has been unused for 30 days\n"
    before = tree(again)
    kept = texloom("store", "prune", "--days", "0", "--dry-run")
    assert kept.code == 0
    assert kept.out.splitlines()[-1].endswith(" would go")
    assert tree(again) == before
    assert len(json.loads(texloom("store", "prune", "--days", "0", "--json").out)) == len(STEPS)
    assert json.loads(texloom("store", "ls", "--json").out) == []
    assert planned()["margins"] == ("run", ["its result is no longer in the store"])
    assert (again / "out" / "texture.png").exists(), "exports are not the store's to remove"


def test_limit(again: Path) -> None:
    assert texloom("store", "limit").out == "no limit\n"
    limited = texloom("store", "limit", "20GB").out
    assert limited == f"0 results, 0 bytes removed; {again / 'artifacts'} has a limit of 20.0 GB\n"
    assert texloom("store", "limit").out == "20.0 GB\n"
    assert "limit 20.0 GB" in texloom("store", "ls").out
    assert json.loads(texloom("store", "limit", "--json").out) == {"limit": 20_000_000_000}
    assert texloom("store", "limit", "none").code == 0
    assert texloom("store", "limit").out == "no limit\n"
    before = tree(again)
    would = texloom("store", "limit", "1 KiB", "--dry-run").out.splitlines()
    assert would[-1].startswith(f"{len(STEPS)} results, ")
    assert would[-1].endswith(" would go")
    assert [line for line in would if "texture" in line], "what goes is named"
    assert tree(again) == before
    assert texloom("store", "limit", "1 KiB").out.splitlines()[:-1] == would[:-1]
    assert json.loads(texloom("store", "ls", "--json").out) == []


# -- start-up imports


HEAVY = {"prefect", "numba", "cv2", "scipy", "skimage"}
COMMANDS = [
    *([], ["run"], ["plan"], ["compare"], ["commands"], ["check-stage"], ["flows"], ["stages"], ["show"]),
    *(["store"], ["store", "ls"], ["store", "verify"], ["store", "prune"], ["store", "limit"]),
]

LOADED = """
import json, sys
from texloom.pipelines.cli.main import main
codes = []
for arguments in json.loads(sys.argv.pop()):
    sys.argv[1:] = arguments
    try:
        main()
    except SystemExit as stopped:
        codes.append(stopped.code)
print()
print(json.dumps([codes, sorted(sys.modules)]))
"""


def loaded_by(*commands: list[str], cwd: Path) -> set[str]:
    """The modules that a fresh interpreter has loaded after these commands, which must succeed."""
    ran = subprocess.run(
        [sys.executable, "-c", LOADED, json.dumps(commands)], check=True, capture_output=True, text=True, cwd=cwd
    )
    codes, modules = json.loads(ran.stdout.splitlines()[-1])
    assert codes == [0] * len(commands)
    return set(modules)


def test_help_is_light(empty: Path) -> None:
    calls = [[*command, option] for command, option in itertools.product(COMMANDS, ("--help", "-h"))]
    loaded = loaded_by(*calls, ["--version"], cwd=empty)
    assert not loaded & {*HEAVY, "numpy", "pydantic", "OpenEXR", "PIL", "rich", "yaml"}
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize("exemplar", ["texloom:bricks", "skimage:brick"])
def test_the_main_flow_does_not_import_scipy(empty: Path, exemplar: str) -> None:
    """With a lattice, whose cells are cut out, and without one, kernels compiled.

    Numba imports the package alone, which takes no time.
    """
    run = ["run", "self_tuning", exemplar, "--size", "128", "--preset", "fast"]
    heavy = {"scipy.fft", "scipy.linalg", "scipy.ndimage", "scipy.special", "numpy.f2py", "skimage.measure"}
    loaded = loaded_by(run, cwd=empty)
    if loaded & heavy:  # to compile a kernel
        loaded = loaded_by([*run, "--store", "another", "--out", "other"], cwd=empty)
    assert not loaded & heavy
    assert "numba" in loaded


def test_every_command_has_help() -> None:
    for command in COMMANDS:
        result = texloom(*command, "--help")
        assert result.code == 0
        assert result.out.startswith("Usage: texloom")
        assert result.err == ""
        commands = result.out.partition("\nCommands:\n")[2]
        assert "..." not in commands, "a summary that is cut"


def test_planning_and_a_run_that_is_cached_are_light(again: Path) -> None:
    commands = [MAIN, PLAN, with_values(PLAN, "texture.occurrence=20"), ["stages"], ["store", "ls"]]
    assert not loaded_by(*commands, cwd=again) & HEAVY


def test_a_word_after_tileable_is_its_value_unless_it_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def parsed(*words: str) -> tuple[str, tuple[str, ...]]:
        params = run_commands.run.make_context("run", ["quilting", *words]).params
        return params["tileable"], tuple(params["pictures"])

    assert parsed("--tileable", "x") == parsed("--tileable=x") == ("x", ())
    assert parsed("a.png", "--tileable") == parsed("--tileable", "a.png") == ("both", ("a.png",))
    assert parsed("--tileable", "off", "a.png") == ("off", ("a.png",))
    (tmp_path / "y").touch()
    assert parsed("--tileable", "y") == ("both", ("y",))
