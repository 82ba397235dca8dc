"""Flows over sets of files and seeds."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import PIL.Image
import pytest

from tests.pipelines.flows import BRANCHES, SET, Events, files, open_run, paint, write_set
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.comparison import comparison_flow
from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.history import History
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError

GUESSED = """
flow: guessed
sources:
  picture: {each: pictures/*.png}
steps:
  height: {stage: analysis.height_from_colour, inputs: {image: picture}}
exports:
  height.exr: height.image
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_set(tmp_path).parent


def run(folder: Path, text: str | None = None, **overrides: str) -> tuple[Run, Events, dict[str, Path]]:
    if text is not None:
        (folder / "flow.yaml").write_text(text)
    opened, listener = open_run(folder / "flow.yaml", **overrides), Events()
    return opened, listener, execute(opened, listener, folder / "out")


@pytest.fixture(scope="module")
def results_of_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a finished set."""
    folder = write_set(tmp_path_factory.mktemp("set")).parent
    run(folder)
    return folder / "artifacts"


@pytest.fixture
def large(folder: Path, results_of_set: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a finished set that is taken for a large one."""
    shutil.copytree(results_of_set, folder / "artifacts")
    monkeypatch.setattr("texloom.pipelines.engine.run._MANY", 3)
    monkeypatch.setattr("texloom.pipelines.engine.user_cache._file", lambda name: folder / f"{name}.json")
    monkeypatch.setattr("texloom.pipelines.media.known_files._RESOLUTION", 0)
    run(folder)
    return folder


def ran(folder: Path, **overrides: str) -> set[str]:
    """The steps that another run computes."""
    _, listener, _ = run(folder, **overrides)
    return {label for label, state in listener.states.items() if state == "ran"}


@pytest.mark.parametrize("many", [3, 100])
def test_what_a_step_warned_of_is_told_again_where_it_is_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, many: int
) -> None:
    monkeypatch.setattr("texloom.pipelines.engine.run._MANY", many)
    folder = write_set(tmp_path, GUESSED).parent
    told = []
    for state in ("ran", "cached", "cached"):
        _, listener, _ = run(folder)
        assert set(listener.states.values()) == {state}
        told.append(sorted(listener.notes))
    assert [text.partition(":")[0] for text in told[0]] == ["a/height", "b/height", "c/height"]
    assert told[0] == told[1] == told[2]


def results(folder: Path, item: str, step: str) -> tuple[Path, Path]:
    """The folder and the record of a result."""
    known = History(Store(folder / "artifacts"), "set").steps[f"{item}/{step}"]
    store = Store(folder / "artifacts")
    artifact = store.location(known["stage"], known["key"])
    return artifact.folder, Path(store.record(artifact))


def test_finished_items_of_a_large_set_are_not_read(large: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(2):
        with monkeypatch.context() as patch:
            patch.setattr(Store, "find", None)
            patch.setattr("texloom.pipelines.engine.exports.file_digest", None)
            assert ran(large) == set()


@pytest.mark.parametrize("what", ["record", "folder", "replaced folder", "altered record"])
def test_what_is_removed_of_a_large_set_is_computed_again(large: Path, what: str) -> None:
    folder, record = results(large, "b-1", "start")
    if what == "record":
        record.unlink()
    elif what == "folder":
        shutil.rmtree(folder)
    elif what == "replaced folder":
        shutil.copytree(folder, large / "copy")
        shutil.rmtree(folder)
        shutil.copytree(large / "copy", folder)
        (folder / "result.exr").write_bytes(b"")
    else:
        before = record.stat()
        record.write_bytes(bytes(before.st_size))
    assert ran(large) == {"b-1/start"}
    assert ran(large) == set()


@pytest.mark.parametrize("what", ["export", "altered export", "history", "altered history", "note"])
def test_what_is_altered_beside_a_large_set_is_made_again(large: Path, what: str) -> None:
    whole, export = files(large / "out"), large / "out" / "b-1" / "start.png"
    history = large / "artifacts" / "history" / "set"
    if what == "export":
        export.unlink()
    elif what == "altered export":
        before = export.stat()
        export.write_bytes(bytes(before.st_size))
        os.utime(export, ns=(before.st_atime_ns, before.st_mtime_ns))
    elif what == "history":
        history.unlink()
    elif what == "altered history":
        history.write_bytes(history.read_bytes().replace(b"b-1", b"b-2"))
    else:
        shutil.rmtree(large / "artifacts" / "exports")
    assert ran(large) == set()
    assert files(large / "out") == whole


def test_another_recipe_or_code_of_a_large_set_runs_again(large: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    starts = {f"{item}-{seed}/{step}" for item in "abc" for seed in (1, 2) for step in ("start", "scores")}
    assert ran(large, start__method="blocks") == {*starts, "all"}
    assert ran(large) == set()
    monkeypatch.setattr("texloom.pipelines.engine.keys.code_digest", lambda module: f"another {module}")
    assert ran(large) >= {*starts, "a-1/edges", "all"}


def test_an_altered_result_of_a_large_set_is_found_when_it_is_read(large: Path) -> None:
    whole = files(large / "out")
    folder, _ = results(large, "b-1", "start")
    content = (folder / "result.exr").read_bytes()
    (folder / "result.exr").write_bytes(bytes(len(content)))
    (large / "out" / "b-1" / "start.png").unlink()
    assert ran(large) == {"b-1/start"}
    assert files(large / "out") == whole


def test_pictures_of_a_large_set_are_opened_once(large: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = large
    with monkeypatch.context() as patch:
        patch.setattr("texloom.pipelines.media.decode.read_header", None)
        _, listener, _ = run(folder)
    assert set(listener.states.values()) == {"cached"}
    paint(folder / "pictures" / "a.png", seed=9)
    _, listener, _ = run(folder)
    assert {label for label, state in listener.states.items() if state == "ran"} >= {"a-1/edges", "all"}


def test_every_file_with_every_seed_and_then_all(folder: Path) -> None:
    opened, listener, exports = run(folder)
    assert [item.name for item in opened.items] == ["a-1", "a-2", "b-1", "b-2", "c-1", "c-2"]
    assert list(listener.items.values()) == [None] * 6
    assert listener.states["a-1/start"] == "ran"
    assert listener.states["a-2/edges"] == "cached"  # it draws no random numbers
    assert listener.states["all"] == "ran"
    assert (folder / "out" / "all.csv").read_text().startswith("name,seed,")
    assert set(exports) == {"all.json", "all.csv", *(f"{item.name}/start.png" for item in opened.items)}
    assert (folder / "out" / "b-2" / "start.png").exists()
    rows = json.loads((folder / "out" / "all.json").read_text())["rows"]
    assert [row["name"] for row in rows] == [item.name for item in opened.items]
    one, other = ((folder / "out" / name / "start.png").read_bytes() for name in ("a-1", "a-2"))
    assert one != other


def test_the_second_run_computes_nothing_and_another_file_itself_alone(folder: Path) -> None:
    run(folder)
    _, listener, _ = run(folder)
    assert set(listener.states.values()) == {"cached"}
    paint(folder / "pictures" / "d.png", seed=9)
    _, listener, _ = run(folder)
    assert {label for label, state in listener.states.items() if state == "ran"} == {
        *("d-1/edges", "d-1/start", "d-1/scores", "d-2/start", "d-2/scores", "all"),
    }


def test_an_item_that_fails_is_named_and_stops_nobody(folder: Path) -> None:
    (folder / "pictures" / "b.png").write_bytes(b"no picture")
    paint(folder / "pictures" / "c.png", side=9)
    opened, listener, exports = run(folder)
    assert {name for name, problem in listener.items.items() if problem} == {"b-1", "b-2", "c-1", "c-2"}
    assert "pictures/b.png" in str(listener.items["b-1"])
    assert "9 x 9 px" in str(listener.items["c-2"])
    assert "a-2/start.png" in exports
    rows = json.loads(exports["all.json"].read_text())["rows"]
    assert [row["name"] for row in rows] == [item.name for item in opened.items]
    assert [row["failed"] for row in rows] == [False, False, True, True, True, True]


def test_a_picture_whose_header_alone_is_right_is_left_out_of_what_gathers(folder: Path) -> None:
    whole = (folder / "pictures" / "b.png").read_bytes()
    (folder / "pictures" / "b.png").write_bytes(whole[: len(whole) // 2])
    text = SET.replace("seed: [1, 2]\n", "")
    text += "  exemplar.png: exemplar\n  sheet.png: sheet.image\n"
    text = text.replace(
        "exports:", "  sheet: {stage: evaluation.contact_sheet, gather: {images: exemplar}}\nexports:"
    )
    opened, listener, exports = run(folder, text)
    assert [name for name, problem in listener.items.items() if problem] == ["b"]
    assert {"a/exemplar.png", "c/start.png", "sheet.png", "all.json"} <= set(exports)
    assert not (folder / "out" / "b").exists()
    assert {plan.name for plan in opened.plan() if plan.state != "cached"} == {
        "edges",
        "start",
        "scores",
        "all",
        "sheet",
    }
    (folder / "pictures" / "b.png").write_bytes(whole)
    _, listener, exports = run(folder)
    assert "b/exemplar.png" in exports
    assert listener.states["sheet"] == "ran"


def test_where_all_fail_nothing_is_gathered(folder: Path) -> None:
    for path in (folder / "pictures").iterdir():
        path.write_bytes(b"no picture")
    _, listener, exports = run(folder)
    assert all(listener.items.values())
    assert exports == {}


def test_a_plan_tells_items_apart(folder: Path) -> None:
    (folder / "pictures" / "b.png").write_bytes(b"no picture")
    opened = open_run(folder / "flow.yaml")
    states = {(plan.item, plan.name): plan.state for plan in opened.plan()}
    assert states["a-1", "edges"] == states["a-1", "start"] == "run"
    assert states["b-1", "edges"] == "refused"
    assert states[None, "all"] == "wait"
    run(folder)
    opened = open_run(folder / "flow.yaml")
    states = {(plan.item, plan.name): plan.state for plan in opened.plan()}
    assert states.pop(("b-1", "edges")) == states.pop(("b-2", "edges")) == "refused"
    assert set(states.values()) == {"cached"}


def test_a_changed_param_of_an_item_step_reaches_what_gathers(folder: Path) -> None:
    run(folder)
    plans = {(plan.item, plan.name): plan for plan in open_run(folder / "flow.yaml", start__size="24").plan()}
    assert plans["a-1", "start"].reasons == ("param size: 16x16 -> 24x24",)
    assert plans[None, "all"].state == "wait"
    _, listener, _ = run(folder, start__size="24")
    assert listener.states["all"] == "ran"


# -- items


def items(folder: Path, sources: str, seed: str = "1") -> list[tuple[str, dict[str, str]]]:
    steps = "steps:\n  edges: {stage: analysis.edges, inputs: {image: texture}}\n"
    (folder / "items.yaml").write_text(f"flow: items\nseed: {seed}\nsources:\n{sources}\n{steps}")
    found = items_of(load_flow(folder / "items.yaml"))
    return [(item.name, {k: str(Path(v).relative_to(folder)) for k, v in item.sources.items()}) for item in found]


def test_pairs_go_in_step(tmp_path: Path) -> None:
    for name in ("moss", "rust"):
        paint(tmp_path / "data" / name / "color.png")
        paint(tmp_path / "data" / name / "control.png")
    pair = "  texture: {each: data/*/color.png}\n  control: {each: data/*/control.png, pair: texture}"
    assert items(tmp_path, pair) == [
        (name, {"texture": f"data/{name}/color.png", "control": f"data/{name}/control.png"})
        for name in ("moss", "rust")
    ]
    (tmp_path / "data" / "rust" / "control.png").unlink()
    with pytest.raises(InputError, match=r"sources\.control: no file goes with texture .*/rust/color\.png"):
        items(tmp_path, pair)


REQUIRED_PAIR = """\
flow: wet
sources:
  texture: required
  control: {pair: texture}
steps:
  edges: {stage: analysis.edges, inputs: {image: texture}}
  weight: {stage: analysis.edges, inputs: {image: control}}
"""


@pytest.mark.parametrize(
    ("texture", "control", "expected"),
    [
        ("t/*.png", "c/*.png", [("moss", "moss", "moss"), ("rust", "rust", "rust")]),
        ("t", "c", [("moss", "moss", "moss"), ("rust", "rust", "rust")]),
        ("t/*.png", "c/moss.png", [("moss", "moss", None), ("rust", "rust", None)]),
        ("t/moss.png", "c/*.png", [("moss", None, "moss"), ("rust", None, "rust")]),
    ],
)
def test_a_required_partner_is_a_set_where_the_other_is(
    tmp_path: Path, texture: str, control: str, expected: list[tuple[str, str | None, str | None]]
) -> None:
    for name in ("t/moss.png", "t/rust.png", "c/moss.png", "c/rust.png"):
        paint(tmp_path / name)
    (tmp_path / "wet.yaml").write_text(REQUIRED_PAIR)
    assert load_flow(tmp_path / "wet.yaml").missing == ("texture", "control")
    sources = {"texture": str(tmp_path / texture), "control": str(tmp_path / control)}
    flow = load_flow(tmp_path / "wet.yaml", Overrides(sources=sources))
    stems = [{name: Path(path).stem for name, path in item.sources.items()} for item in items_of(flow)]
    names = [item.name for item in items_of(flow)]
    assert [(n, s.get("texture"), s.get("control")) for n, s in zip(names, stems, strict=True)] == expected


def test_files_that_the_shell_has_listed_are_explained(tmp_path: Path) -> None:
    """As of ``t/*_color.png`` without quotes."""
    for name in ("t/moss_color.png", "t/rust_color.png", "t/moss_wet.png", "t/rust_wet.png"):
        paint(tmp_path / name)
    (tmp_path / "wet.yaml").write_text(REQUIRED_PAIR)
    pictures = tuple(str(tmp_path / "t" / f"{name}_color.png") for name in ("moss", "rust"))
    overrides = Overrides({"control": str(tmp_path / "t/*_wet.png")}, pictures=pictures)
    with pytest.raises(InputError, match=r"/moss_wet.png, called 'moss'; texture has 'moss_color'"):
        items_of(load_flow(tmp_path / "wet.yaml", overrides))


@pytest.mark.parametrize(("texture", "expected"), [("picture", ["moss", "rust"]), ("soft.image", ["x", "y"])])
def test_a_partner_of_an_included_flow_may_be_another_source(
    tmp_path: Path, texture: str, expected: list[str]
) -> None:
    for name in ("t/moss.png", "t/rust.png", "c/moss.png", "c/rust.png", "d/x.png", "d/y.png"):
        paint(tmp_path / name)
    (tmp_path / "wet.yaml").write_text(REQUIRED_PAIR)
    (tmp_path / "flow.yaml").write_text(
        f"flow: more\ninclude: {{flow: wet.yaml, inputs: {{texture: {texture}}}}}\nsources: {{picture: required}}\n"
        "steps:\n  soft: {stage: analysis.crop, inputs: {image: picture}, params: {size: 32}}\n"
    )
    given = ("t/*.png", "c/*.png") if texture == "picture" else ("t/moss.png", "d/*.png")
    sources = {name: str(tmp_path / pattern) for name, pattern in zip(("picture", "control"), given, strict=True)}
    flow = load_flow(tmp_path / "flow.yaml", Overrides(sources=sources))
    assert [item.name for item in items_of(flow)] == expected


def test_sets_that_are_no_pair_are_combined(tmp_path: Path) -> None:
    for name in ("a/1.png", "a/2.png", "b/x.png", "b/y.png"):
        paint(tmp_path / name)
    both = "  texture: {each: a/*.png}\n  control: {each: b/*.png}"
    assert [name for name, _ in items(tmp_path, both)] == ["1-x", "1-y", "2-x", "2-y"]
    assert [name for name, _ in items(tmp_path, both, "[5, 6]")][:3] == ["1-x-5", "1-x-6", "1-y-5"]


def test_names_do_not_depend_on_the_pattern(tmp_path: Path) -> None:
    for name in ("x/y/wall_1.png", "x/wall_2.png", "x/wall_22.png"):
        paint(tmp_path / name)
    assert [name for name, _ in items(tmp_path, "  texture: {each: 'x/**/wall_?.png'}")] == ["wall_2", "wall_1"]
    assert [name for name, _ in items(tmp_path, "  texture: {each: 'x/wall_[0-2]*.png'}")] == ["wall_2", "wall_22"]
    assert [name for name, _ in items(tmp_path, "  texture: {each: x/wall_*.png}")] == ["wall_2", "wall_22"]


def test_names_that_differ_by_case_get_folders_of_their_own(tmp_path: Path) -> None:
    for name in ("x/Tex.png", "x/tex.png"):
        paint(tmp_path / name)
    if len([*(tmp_path / "x").iterdir()]) == 2:
        assert [name for name, _ in items(tmp_path, "  texture: {each: x/*.png}")] == ["Tex", "tex-2"]


def test_a_suffix_is_no_part_of_a_name_unless_it_tells_files_apart(tmp_path: Path) -> None:
    paint(tmp_path / "x" / "moss.png")
    paint(tmp_path / "x" / "rust.jpg")
    assert [name for name, _ in items(tmp_path, "  texture: {each: x/*}")] == ["moss", "rust"]
    paint(tmp_path / "x" / "rust.png")
    assert [name for name, _ in items(tmp_path, "  texture: {each: x/*}")] == ["moss.png", "rust.jpg", "rust.png"]


def test_patterns_without_files_and_names_that_clash(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"sources\.texture: no file or map set matches"):
        items(tmp_path, "  texture: {each: x/*.png}")
    paint(tmp_path / "x" / "a-b.png")
    paint(tmp_path / "x" / "a" / "b.png")
    with pytest.raises(InputError, match="would both be called 'a-b'"):
        items(tmp_path, "  texture: {each: x/**/*.png}")


@pytest.mark.parametrize(
    ("file", "pattern", "name"),
    [
        (".....png", "....*.png", "____"),
        ("....png", ".*.png", "___"),
        ("...png", ".*.png", "__"),
        ("a\nb\x1b[31m.png", "*.png", "a_b_[31m"),
        ("a\\..\\b.png", "*.png", "a_.._b"),
        ("a\u2028b.png", "*.png", "a_b"),
        ("wände 1.2.png", "*.png", "wände 1.2"),
    ],
)
def test_a_name_is_that_of_one_folder(tmp_path: Path, file: str, pattern: str, name: str) -> None:
    paint(tmp_path / "x" / "plain.png")
    (tmp_path / "x" / "plain.png").rename(tmp_path / "x" / file)
    assert [found for found, _ in items(tmp_path, f"  texture: {{each: 'x/{pattern}'}}")] == [name]


def test_names_that_no_folder_can_have(tmp_path: Path) -> None:
    paint(tmp_path / "x" / "a\nb.png")
    paint(tmp_path / "x" / "a_b.png")
    with pytest.raises(InputError, match="would both be called 'a_b'"):
        items(tmp_path, "  texture: {each: x/*.png}")
    for folder in ("y", "z"):
        paint(tmp_path / folder / f"{folder * 200}.png")
    with pytest.raises(InputError, match="too long for a folder's name"):
        items(tmp_path, "  texture: {each: y/*.png}\n  control: {each: z/*.png}")


def test_an_item_called_as_an_export(folder: Path) -> None:
    paint(folder / "pictures" / "all.json.png")
    (folder / "flow.yaml").write_text(SET.replace("seed: [1, 2]\n", ""))
    with pytest.raises(InputError, match=r"exports\.all\.json: an item and its folder have this name"):
        open_run(folder / "flow.yaml")


# -- what a flow may say


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("gather: {tables: scores.table}", "inputs: {tables: scores.table}", "must be a list"),
        ("gather: {tables: scores.table}", "gather: {tables: scores.tabel}", "did you mean 'table'"),
        ("gather: {tables: scores.table}", "gather: {tables: start.image}", "must be a table, but start.image"),
        ("gather: {tables: scores.table}", "gather: {tabels: scores.table}", "did you mean 'tables'"),
        ("inputs: {image: exemplar}}", "gather: {image: exemplar}}", "takes an image: give it as an input"),
        ("seed: [1, 2]", "seed: [1, 1]", "the same one twice"),
        ("seed: [1, 2]", "seed: [1, x]", "seed: must be a whole number"),
        ("{each: pictures/*.png}", "{each: pictures/a.png}", "must be a pattern"),
        ("{each: pictures/*.png}", "{each: pictures/*.png, pair: nobody}", "no source 'nobody'"),
        ("{each: pictures/*.png}", "{each: pictures/*.png, pair: exemplar}", "must be another source"),
    ],
)
def test_a_set_that_is_described_wrongly(folder: Path, old: str, new: str, problem: str) -> None:
    assert SET.count(old) >= 1
    (folder / "flow.yaml").write_text(SET.replace(old, new, 1))
    with pytest.raises(InputError, match=problem):
        load_flow(folder / "flow.yaml")


def test_one_for_all_takes_no_items_by_itself(folder: Path) -> None:
    wrong = SET.replace(
        "gather: {tables: scores.table}", "gather: {tables: scores.table}, inputs: {more: scores.table}"
    )
    (folder / "flow.yaml").write_text(wrong)
    with pytest.raises(InputError):
        load_flow(folder / "flow.yaml")


def test_any_flow_runs_over_a_pattern_and_seeds(folder: Path) -> None:
    text = SET.replace("{each: pictures/*.png}", "pictures/a.png").replace("seed: [1, 2]", "seed: 4")
    (folder / "flow.yaml").write_text(text)
    flow = load_flow(
        folder / "flow.yaml", Overrides(sources={"exemplar": str(folder / "pictures" / "[ab].png")}, seeds=2)
    )
    assert [item.name for item in items_of(flow)] == ["a-4", "a-5", "b-4", "b-5"]


def test_a_set_that_stays_the_example_is_named_once(folder: Path) -> None:
    text = SET.replace("  exemplar:", "  holes: pictures/b.png\n  exemplar:", 1)
    rest = "steps:\n  rest: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: holes}}"
    (folder / "flow.yaml").write_text(text.replace("steps:", rest))
    given = Overrides(sources={"holes": str(folder / "pictures" / "a.png")})
    opened = Run(load_flow(folder / "flow.yaml", given), Store(folder / "artifacts"))
    opened.plan()
    pattern = folder / "pictures" / "*.png"
    assert opened.notes == [
        f"sources.exemplar: {pattern}: the flow's own example; give yours with --source exemplar=..."
    ]


# -- comparing flows

ONE = """
sources:
  exemplar: pictures/a.png
steps:
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 16, method: METHOD}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image, match: start.match}}
exports:
  texture.png: start.image
  scores.json: scores.table
"""


def test_flows_are_compared_on_the_same_items(folder: Path) -> None:
    for method in ("pixels", "blocks"):
        (folder / f"{method}.yaml").write_text(ONE.replace("METHOD", method))
    names = [str(folder / f"{method}.yaml") for method in ("pixels", "blocks")]
    overrides = Overrides(params={"start.size": "16x20"}, seed=5, seeds=2)
    flow = comparison_flow(names, overrides, str(folder / "pictures" / "*.png"))
    opened, listener = Run(flow, Store(folder / "artifacts")), Events()
    exports = execute(opened, listener, folder / "out")
    with PIL.Image.open(exports["a-5/pixels.png"]) as picture:
        assert picture.size == (16, 20)
    table = json.loads(exports["comparison.json"].read_text())
    assert table["methods"] == ["pixels", "blocks"]
    page = exports["comparison.html"].read_text()
    assert page.count("<img") >= 9
    assert 'src="http' not in page
    assert 'href="http' not in page
    # what a flow computes by itself is the same result
    alone = load_flow(
        folder / "blocks.yaml",
        Overrides({"exemplar": str(folder / "pictures" / "b.png")}, {"start.size": "16x20"}, seed=6),
    )
    assert {plan.state for plan in Run(alone, Store(folder / "artifacts")).plan()} == {"cached"}


def test_flows_that_cannot_be_compared(folder: Path) -> None:
    (folder / "one.yaml").write_text(ONE.replace("METHOD", "pixels"))
    (folder / "two.yaml").write_text(ONE.replace("METHOD", "pixels").replace("exemplar", "texture", 1))
    (folder / "three.yaml").write_text(ONE.replace("METHOD", "pixels").replace("  scores.json: scores.table\n", ""))
    one, over = str(folder / "one.yaml"), str(folder / "pictures" / "*.png")
    again = str(shutil.copy(one, folder / "again.yaml"))
    for others, params, problem in (
        ([one], {}, "at least two"),
        ([one, str(folder / "three.yaml")], {}, r"must be a \.json file"),
        ([one, one], {}, r"one\.yaml is given twice"),
        ([one, again], {"strat.size": "3"}, "did you mean 'start'"),
        ([one, again], {"start.size": "3"}, "--set start.size"),
    ):
        with pytest.raises(InputError, match=problem):
            comparison_flow(others, Overrides(params=params), over)


def test_a_method_that_fails_stops_only_what_takes_its_result(folder: Path) -> None:
    _, listener, exports = run(folder, BRANCHES)  # noise has no lattice
    assert all("lattice" in str(problem) for problem in listener.items.values())
    assert set(exports) == {"a/start.png", "b/start.png", "c/start.png", "both.json"}
    assert json.loads(exports["both.json"].read_text())["failed"] == {"pixels": 0, "tiles": 3}
    assert "tiles" not in listener.states
    opened = open_run(folder / "flow.yaml")
    states = {(plan.item, plan.name): plan.state for plan in opened.plan()}
    assert (states["a", "scores"], states["a", "cells"], states["a", "tiled"]) == ("cached", "run", "wait")


def test_several_pictures_are_named_by_the_first(folder: Path) -> None:
    names = [str(folder / "pictures" / name) for name in ("b.png", "a.png", "c.png")]
    flow = load_flow(folder / "flow.yaml", Overrides(pictures=names))
    opened = Run(flow, Store(folder / "artifacts"))
    assert opened.source_references() == {"exemplar": f"{names[0]} and 2 more"}
    assert len(opened.items) == 6
