"""Exports: left as they are where they are what they would become, written again in all other cases."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.pipelines.flows import Events, files, open_run, paint, run_local, write_flow, write_set
from texloom.pipelines.engine import exports, task_spec
from texloom.pipelines.engine.code_digest import imports
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.engine.stage_call import call_stage
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store import codec, exr, housekeeping
from texloom.pipelines.store.atomic import make_new_folder
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: kinds
sources:
  exemplar: exemplar.png
  material: material
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
exports:
  copy.png: exemplar
  strength.exr: edges.strength
  strength.png: edges.strength
  structure.png: structure.structure
  threshold.json: structure.threshold
  maps/: {image: material, like: material}
"""


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A flow with exports of every kind, and what it has exported into ``out``."""
    (tmp_path / "material").mkdir()
    for path in ("exemplar.png", "material/moss_Color.png", "material/moss_rough.png"):
        levels = rng.integers(0, 256, (40, 48, 1 if "rough" in path else 3)).astype(np.uint8)
        assert cv2.imwrite(str(tmp_path / path), levels)
    (tmp_path / "flow.yaml").write_text(FLOW)
    run(tmp_path)
    return tmp_path


def run(folder: Path, out: str = "out", **params: str) -> None:
    """Run the flow, with params as ``step__param="value"``."""
    run_local(open_run(folder / "flow.yaml", **params), folder / out)


def marks(folder: Path) -> dict[str, tuple[int, int, int]]:
    """By what one can tell that files have been written again."""
    states = {str(path.relative_to(folder)): path.stat() for path in folder.rglob("*") if path.is_file()}
    return {name: (state.st_ino, state.st_mtime_ns, state.st_ctime_ns) for name, state in states.items()}


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    """No EXR may be read or written, and no result read."""

    def never(*arguments: object, **options: object) -> None:
        raise AssertionError(arguments)

    monkeypatch.setattr(exr, "load", never)
    monkeypatch.setattr(exr, "write", never)
    monkeypatch.setattr(Store, "load", never)
    monkeypatch.setattr(exports.Export, "write", never)


def test_a_second_run_opens_no_exr_and_leaves_the_exports_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = marks(folder / "out")
    assert {"copy.png", "strength.exr", "maps/material.exr", "maps/moss_rough.png"} <= set(before)
    forbid(monkeypatch)
    run(folder)
    assert marks(folder / "out") == before


def test_a_copy_of_the_exports_elsewhere_is_left_alone_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(folder / "out", folder / "moved")
    before = marks(folder / "moved")
    forbid(monkeypatch)
    run(folder, "moved")
    assert marks(folder / "moved") == before


# -- what becomes of a file


def _edit(path: Path) -> None:
    """Other bytes, of the same number, at the same time, in the same inode."""
    state, content = path.stat(), bytearray(path.read_bytes())
    content[-1] ^= 1
    with path.open("r+b") as file:
        file.write(content)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


def _replace(path: Path) -> None:
    path.with_suffix(".other").write_bytes(b"other")
    path.with_suffix(".other").replace(path)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "deleted": Path.unlink,
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "empty": lambda path: path.write_bytes(b""),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "edited": _edit,
    "replaced": _replace,
    "a pipe": _pipe,
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_what_is_not_as_it_was_written_is_written_again(folder: Path, damage: Callable[[Path], object]) -> None:
    whole, before = files(folder / "out"), marks(folder / "out")
    for name in ("copy.png", "strength.exr", "threshold.json", "maps/moss_rough.png"):
        damage(folder / "out" / name)
    run(folder)
    assert {name: content for name, content in files(folder / "out").items() if "other" not in name} == whole
    assert marks(folder / "out")["structure.png"] == before["structure.png"]


def test_a_users_own_files_stay(folder: Path) -> None:
    (folder / "out" / "maps" / "notes.txt").write_text("mine")
    (folder / "out" / "maps" / "moss_rough.png").unlink()
    run(folder)
    assert (folder / "out" / "maps" / "notes.txt").read_text() == "mine"
    assert (folder / "out" / "maps" / "moss_rough.png").exists()


def test_an_older_result_that_was_put_back_gives_way(folder: Path) -> None:
    first, before = files(folder / "out"), (folder / "out" / "strength.exr").stat()
    run(folder, edges__finest="3.0")
    second = files(folder / "out")
    assert second["strength.exr"] != first["strength.exr"]
    (folder / "out" / "strength.exr").write_bytes(first["strength.exr"])
    os.utime(folder / "out" / "strength.exr", ns=(before.st_atime_ns, before.st_mtime_ns))
    run(folder, edges__finest="3.0")
    assert files(folder / "out") == second
    run(folder)
    assert files(folder / "out") == first


# -- what an export is made of

CHANGES = {
    "another output": ("strength.exr: edges.strength", "strength.exr: structure.structure", {"strength.exr"}),
    "another source": ("copy.png: exemplar", "copy.png: material", {"copy.png"}),
    "another name": ("copy.png", "other.png", {"other.png"}),
    "another kind": ("structure.png", "structure.exr", {"structure.exr"}),
    "a folder in place of a file": ("copy.png: exemplar", "copy.exr/: exemplar", {"copy.exr/"}),
    "like nothing": ("{image: material, like: material}", "material", {"maps/"}),
    "another flow": (
        "flow: kinds",
        "flow: sorts",
        {"copy.png", "strength.exr", "strength.png", "structure.png", "maps/"},
    ),
    "nothing": ("sources:", "# a comment\nsources:", set()),
}


@pytest.mark.parametrize(("old", "new", "changed"), CHANGES.values(), ids=CHANGES)
def test_what_decides_whether_an_export_is_written(folder: Path, old: str, new: str, changed: set[str]) -> None:
    (folder / "flow.yaml").write_text(FLOW.replace(old, new))
    written = marks(folder / "out")
    run(folder)
    again = {name for name, mark in marks(folder / "out").items() if written.get(name) != mark}
    groups = {name.partition("/")[0] for name in changed}
    assert {name.partition("/")[0] for name in again} - {"threshold.json"} == groups
    one = folder / "one"
    shutil.rmtree(folder / "artifacts" / "exports")
    run(folder, "one")
    ours = files(folder / "out")
    assert all(ours[name] == content for name, content in files(one).items())


def test_other_code_of_the_exporter_writes_everything_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = marks(folder / "out")
    digest = exports.code_digest
    monkeypatch.setattr(exports, "code_digest", lambda module: digest(module)[::-1])
    run(folder)
    after = marks(folder / "out")
    assert after.keys() == before.keys()
    assert all(after[name] != before[name] for name in before)


def test_the_code_of_the_exporter_is_all_that_it_calls(folder: Path) -> None:
    seen, pending = set[str](), ["texloom.pipelines.media.material_export"]
    while pending:
        seen.add(name := pending.pop())
        pending += [other for other in imports(name) if other not in seen]
    names = ("store.codec", "store.exr", "store.outputs", "store.preview", "media.materialx")
    assert {f"texloom.pipelines.{name}" for name in names} <= seen
    assert {
        "texloom.stages.vocabulary.arrays",
        "texloom.stages.vocabulary.color",
        "texloom.stages.vocabulary.normals",
    } <= seen


# -- notes


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "null", "3", '{"": 3}', '{"": "00"}', '{"": ', "[" * 100_000, "\0"]
)
def test_a_note_that_is_damaged_is_none(folder: Path, text: str) -> None:
    notes, whole = folder / "artifacts" / "exports", files(folder / "out")
    kept = {name: note for name, note in files(notes).items() if note != b"{}"}
    for name in kept:
        (notes / name).write_text(text)
    (folder / "out" / "structure.png").write_bytes(b"mine")
    run(folder)
    assert files(folder / "out") == whole
    assert kept.items() <= files(notes).items()


def test_without_notes_exports_are_written_all_the_same(folder: Path) -> None:
    whole = files(folder / "out")
    shutil.rmtree(folder / "artifacts" / "exports")
    (folder / "artifacts" / "exports").write_text("no folder")
    (folder / "out" / "structure.png").unlink()
    run(folder)
    assert files(folder / "out") == whole


def test_runs_at_once_leave_whole_exports_and_notes(folder: Path) -> None:
    whole, notes = files(folder / "out"), files(folder / "artifacts" / "exports")
    for name in notes:
        (folder / "artifacts" / "exports" / name).unlink()
    value, provenance = {"rows": list(range(1000))}, {"output": "table"}
    export = exports.Export(folder / "out" / "table.json", False, "0" * 64, provenance)
    store = Store(folder / "artifacts")

    def ensure(_: int) -> None:
        if export.current(store) is None:
            export.write(store, value, dict, provenance)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(ensure, range(32)))
    assert json.loads((folder / "out" / "table.json").read_text()) == value
    digest = hashlib.sha256((folder / "out" / "table.json").read_bytes()).hexdigest()
    assert set(files(folder / "artifacts" / "exports")) == {export.key, digest}
    run(folder)
    assert whole.items() < files(folder / "out").items()
    assert notes.items() < files(folder / "artifacts" / "exports").items()


def test_notes_of_no_use_are_pruned(folder: Path) -> None:
    notes = sorted((folder / "artifacts" / "exports").iterdir())
    for path in notes:
        os.utime(path, (0, 0))
    run(folder, structure__min_extent="0.3")
    assert housekeeping.prune(Store(folder / "artifacts"), 30) == []
    left = set((folder / "artifacts" / "exports").iterdir())
    recent = time.time() - 60
    assert {path.name for path in notes} - {path.name for path in left}
    assert set(notes) & left
    assert all(path.stat().st_mtime > recent for path in left)


# -- the folder of a run that is given none


def test_no_two_runs_get_one_new_folder(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as threads:
        made = list(threads.map(lambda _: make_new_folder(tmp_path / "runs" / "flow"), range(32)))
    names = {"flow", *(f"flow-{count}" for count in range(2, 33))}
    assert {path.name for path in made} == names
    assert {path.name for path in (tmp_path / "runs").iterdir()} == names


def test_a_file_in_place_of_the_runs_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("no folder")
    with pytest.raises(OSError, match="runs"):
        make_new_folder(tmp_path / "runs" / "flow")


def test_runs_that_begin_at_once_have_a_folder_each(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "strftime", lambda *_: "now")
    finest = [2.0, 3.0, 4.0, 5.0]
    runs = [open_run(folder / "flow.yaml", edges__finest=str(one)) for one in finest]
    outs = [one.new_out() for one in runs]
    assert not (folder / "artifacts" / "runs").exists()

    with ThreadPoolExecutor(len(runs)) as threads:
        written = list(threads.map(execute, runs, [Events() for _ in runs], outs))
    folders = [one.out_folder(out) for one, out in zip(runs, outs, strict=True)]
    assert set(folders) == set((folder / "artifacts" / "runs").iterdir())
    assert len(set(folders)) == len(runs)
    for one, place, exports_of in zip(finest, folders, written, strict=True):
        assert all(path.is_relative_to(place) for path in exports_of.values())
        run(folder, f"out-{one}", edges__finest=str(one))
        assert files(folder / f"out-{one}") == files(place)


# -- what exports say of the run


PAGE = """
flow: shown
sources: {exemplar: exemplar.png}
steps:
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: exemplar}}
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
  report: {stage: evaluation.report, inputs: {exemplar: exemplar, image: exemplar, table: scores.table}}
exports: {report.html: report.page, strength.exr: edges.strength}
"""


def provenance(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = codec.describe(file)["provenance"]
    return found


def test_a_cached_page_names_the_picture_and_the_command_of_its_run(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flow.yaml").write_text(PAGE)
    assert cv2.imwrite("exemplar.png", rng.integers(0, 256, (40, 48, 3)).astype(np.uint8))
    shutil.copy("exemplar.png", "a<b.png")
    run(tmp_path)
    flow = load_flow(tmp_path / "flow.yaml", Overrides({"exemplar": "a<b.png"}))
    events = run_local(Run(flow, Store(tmp_path / "artifacts")), tmp_path / "other")
    assert set(events.states.values()) == {"cached"}
    pages = [(tmp_path / out / "report.html").read_text() for out in ("out", "other")]
    for page, name, command in zip(
        pages,
        ("exemplar", "a&lt;b"),
        (
            "texloom run flow.yaml --seed 0",
            "texloom run flow.yaml &#x27;a&lt;b.png&#x27; --seed 0",
        ),
        strict=True,
    ):
        assert f">{name} · shown</title>" in page
        assert f">{name}</h1>" in page
        assert f">{command}</code>" in page
    assert provenance(tmp_path / "out/strength.exr")["from"] == {"image": "exemplar: exemplar.png"}
    assert provenance(tmp_path / "other/strength.exr")["from"] == {"image": "exemplar: a<b.png"}


def test_what_a_step_warned_of_is_not_in_its_exports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python tells some warnings once a process, Numba where it compiles; equal results are equal files."""

    def warned(*arguments: Any) -> dict[str, Any]:
        logging.getLogger("texloom").warning("as if Numba were")
        return call_stage(*arguments)

    for out in ("plain", "warned"):
        monkeypatch.setattr(task_spec, "call_stage", call_stage if out == "plain" else warned)
        run = open_run(write_flow(tmp_path / out))
        told = run_local(run, tmp_path / out / "out").notes
        assert bool(told) == (out == "warned")
    assert files(tmp_path / "plain/out") == files(tmp_path / "warned/out")


def test_a_page_of_an_item_names_the_item(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_set(tmp_path, PAGE.replace("exemplar.png", "{each: pictures/*.png}"))
    run(tmp_path)
    for name in ("a", "b", "c"):
        page = (tmp_path / "out" / name / "report.html").read_text()
        assert f">{name}</h1>" in page
        assert f">texloom run flow.yaml pictures/{name}.png --seed 0</code>" in page


MATERIAL = """
flow: kinds
sources: {material: material}
steps:
  start: {stage: synthesis.initialise, inputs: {image: material}, params: {size: 48x32, method: pixels}}
exports:
  texture.png: start.image
  texture.usda: start.image
  texture.glb: start.image
"""


def run_material(folder: Path, force: bool = False, **delivery: str) -> Events:
    opened = Run(load_flow(folder / "flow.yaml", Overrides(delivery=delivery)), Store(folder / "artifacts"))
    Preflight(opened).check(folder / "made", force)
    return run_local(opened, folder / "made")


def test_layouts_and_documents_are_exports(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "flow.yaml").write_text(MATERIAL)
    run_material(folder, layout="unreal", texel_size="1mm", udim="1x2")
    made = sorted(files(folder / "made"))
    packed = {f"maps/T_material_{part}.{tile}.png" for part in ("BC", "ORM") for tile in (1001, 1011)}
    maps = {f"texture_maps/texture_{part}.png" for part in ("base_color", "roughness")}
    assert set(made) == {*packed, *maps, "texture.glb", "texture.png", "texture.usda"}
    before = marks(folder / "made")
    run_material(folder, layout="unreal", texel_size="1mm", udim="1x2")
    assert marks(folder / "made") == before
    (folder / "made" / "texture_maps" / "texture_roughness.png").write_bytes(b"")
    run_material(folder, force=True, layout="unreal", texel_size="1mm", udim="1x2")
    after = marks(folder / "made")
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {"texture.usda", *maps}
    assert (folder / "made" / "texture_maps" / "texture_roughness.png").read_bytes()
    run_material(folder, layout="unreal", texel_size="2mm", udim="1x2")
    assert marks(folder / "made")["texture.usda"] != after["texture.usda"]


def test_a_size_that_tiles_do_not_divide_is_refused_first(folder: Path) -> None:
    (folder / "flow.yaml").write_text(MATERIAL)
    before = files(folder)
    with pytest.raises(InputError, match=r"^--udim: 48 x 32 px cannot be cut into 1x3 equal tiles; change --size$"):
        run_material(folder, layout="unreal", udim="1x3")
    assert files(folder) == before


def test_the_layout_of_the_exemplar_needs_one_of_maps(folder: Path) -> None:
    (folder / "flow.yaml").write_text(MATERIAL)
    sources = {path.name for path in (folder / "material").iterdir()}
    run_material(folder, layout="same")
    assert {path.name for path in (folder / "made" / "maps").iterdir()} == sources
    (folder / "flow.yaml").write_text(MATERIAL.replace("material: material}", "material: material/moss_Color.png}"))
    before = files(folder)
    with pytest.raises(
        InputError, match=r"^--layout: same needs a folder or YAML file of maps as sources\.material$"
    ):
        run_material(folder, layout="same", force=True)
    assert files(folder) == before


def test_maps_of_a_document_replace_no_source(folder: Path) -> None:
    (folder / "made").mkdir()
    (folder / "material").rename(folder / "made" / "texture_maps")
    (folder / "flow.yaml").write_text(MATERIAL.replace("material: material", "material: made/texture_maps"))
    with pytest.raises(InputError, match="texture_maps would replace a source of the flow"):
        run_material(folder)


def test_maps_of_a_document_are_no_other_export(folder: Path) -> None:
    (folder / "flow.yaml").write_text(MATERIAL + "  texture_maps/: start.image\n")
    with pytest.raises(InputError, match=r"its maps are written into 'texture_maps', which is another export"):
        load_flow(folder / "flow.yaml")


def test_what_a_step_did_not_give_is_not_written(tmp_path: Path) -> None:
    paint(tmp_path / "exemplar.png")
    (tmp_path / "flow.yaml").write_text(
        "flow: small\nsources: {exemplar: exemplar.png, control: optional}\nsteps:\n"
        "  small:\n    stage: synthesis.histogram_summary\n    inputs: {texture: exemplar, control: control}\n"
        "    params: {size: 16}\n"
        "exports: {texture.png: small.image, control.png: small.control}\n"
    )
    for _ in range(2):
        told = run_local(open_run(tmp_path / "flow.yaml"), tmp_path / "out").notes
        assert {path.name for path in (tmp_path / "out").iterdir()} == {"texture.png"}
        assert told == ["control.png: not written, as there is no small.control here"]
