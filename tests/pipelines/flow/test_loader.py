"""Loading of flow files, and the errors of wrong ones."""

from __future__ import annotations

import dataclasses
import re
import textwrap
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import ROOT
from texloom.pipelines import yaml as plain_yaml
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides, Reference
from texloom.pipelines.media.part import Part
from texloom.pipelines.yaml import parse_yaml
from texloom.stages.synthesis.optimisation.optimise_params import PRESETS
from texloom.stages.vocabulary.declare import InputError

NO_OVERRIDES = Overrides()
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))

GOOD = """
flow: contours
seed: 3
sources:
  exemplar: pictures/wall.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {finest: 2.0}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar, structure: structure.structure}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image}}
exports:
  edges.png: edges.strength
  scores.json: scores.table
"""


@pytest.fixture
def write(tmp_path: Path) -> Any:
    """Writes a flow file, GOOD with one text in place of another."""

    def write(old: str = "", new: str = "", text: str = GOOD) -> Path:
        assert old in text
        path = tmp_path / "flow.yaml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return write


def refusal(path: Path, overrides: Overrides = NO_OVERRIDES) -> str:
    """The one line that says what is wrong, less the file's name."""
    with pytest.raises(InputError) as caught:
        load_flow(path, overrides)
    line = str(caught.value)
    assert line.isprintable()
    return line.removeprefix(f"{path}: ")


# -- flows that load


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_flow_that_ships_loads(path: Path) -> None:
    flow = load_flow(path)
    assert flow.name == path.stem
    assert flow.exports
    assert find_flow(path.stem).samefile(path)
    assert path.read_text().startswith("# "), "a flow begins by saying what it is"


def test_one_picture_is_given_no_folder_of_maps() -> None:
    flows = [load_flow(path) for path in CONFIGS]
    always = {flow.name for flow in flows if "maps/" in flow.likes and "maps/" not in flow.of_maps}
    assert always == {"materials", "material_from_colour", "material_synthesis", "photo_material"}


def test_what_keeps_a_picture_keeps_its_bits() -> None:
    flows = [load_flow(path) for path in CONFIGS]
    keeping = {flow.name for flow in flows if "texture.png" in flow.likes}
    names = "edit_by_compaction fill make_tileable photo_completion photo_to_photo revise"
    assert set(names.split()) <= keeping


def test_there_are_flows() -> None:
    assert {"self_tuning", "texture_optimisation"} <= {path.stem for path in CONFIGS}


def test_names_that_must_stay() -> None:
    flow = load_flow(ROOT / "configs" / "self_tuning.yaml")
    names = "margins tone offsets lattice parts edges structure distance guidance start texture scores"
    assert list(flow.steps) == names.split()
    assert {"exemplar"} == set(flow.sources)
    assert {"texture.exr", "texture.png", "scores.json", "one_off.png", "maps/"} == set(flow.exports)
    assert {"occurrence", "patch_size", "tileable", "preset"} <= set(
        type(flow.steps["texture"].params).model_fields
    )
    assert "size" in type(flow.steps["start"].params).model_fields


def test_a_flow_has_the_content_of_its_file(write: Any, tmp_path: Path) -> None:
    flow = load_flow(write())
    assert flow.name == "contours"
    assert flow.seeds == (3,)
    assert flow.sources == {"exemplar": str(tmp_path / "pictures" / "wall.png")}
    assert flow.steps["edges"].stage.name == "analysis.edges"
    assert flow.steps["edges"].params.model_dump()["finest"] == 2.0
    assert flow.steps["structure"].inputs == {"strength": Reference("edges", "strength")}
    assert flow.steps["structure"].needs == ["edges"]
    assert flow.steps["edges"].needs == []
    assert flow.exports["scores.json"] == Reference("scores", "table")
    assert flow.where("steps", "edges") == f"{tmp_path / 'flow.yaml'}: steps.edges"


def test_optional_fields(tmp_path: Path) -> None:
    path = tmp_path / "least.yaml"
    path.write_text("sources: {a: skimage:brick}\nsteps: {e: {stage: analysis.edges, inputs: {image: a}}}\n")
    flow = load_flow(path)
    assert (flow.name, flow.seeds, flow.exports) == ("least", (0,), {})
    assert flow.sources == {"a": "skimage:brick"}


def test_steps_keep_the_order_of_the_file_where_inputs_allow(write: Any) -> None:
    lines = {
        name: f"  {name}: {{stage: {stage}, inputs: {{{inputs}}}}}\n"
        for name, stage, inputs in (
            ("distance", "analysis.signed_distance", "structure: structure.structure"),
            ("offsets", "analysis.offset_statistics", "image: exemplar"),
            ("structure", "analysis.otsu", "strength: edges.strength"),
            ("edges", "analysis.edges", "image: exemplar"),
            ("start", "synthesis.initialise", "image: exemplar"),
        )
    }

    def order(*names: str) -> list[str]:
        steps = "".join(lines[name] for name in names)
        return list(load_flow(write(text=f"sources: {{exemplar: a.png}}\nsteps:\n{steps}")).steps)

    natural = ["start", "edges", "structure", "offsets", "distance"]
    assert order(*natural) == natural
    assert order("distance", "offsets", "structure", "edges", "start") == [
        "offsets", "edges", "structure", "distance", "start",
    ]  # fmt: skip


def test_relative_paths_start_at_the_flow_file(write: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths of the command line start at the working folder."""
    (tmp_path / "forest.yml").touch()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "other.yml").touch()
    monkeypatch.chdir(elsewhere)
    path = write("finest: 2.0", "model: forest.yml")
    assert load_flow(path).steps["edges"].params.model_dump()["model"] == tmp_path / "forest.yml"
    flow = load_flow(path, Overrides({"exemplar": "mine.png"}, {"edges.model": "other.yml"}))
    assert flow.own_examples == ()
    assert flow.steps["edges"].params.model_dump()["model"] == elsewhere / "other.yml"
    assert flow.sources["exemplar"] == str(elsewhere / "mine.png")


def test_home_is_expanded(write: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert load_flow(write("pictures/", "~/")).sources["exemplar"] == str(tmp_path / "home" / "wall.png")
    path = write("pictures/", "~nobody.of.this.name/")
    assert load_flow(path).sources["exemplar"] == str(tmp_path / "~nobody.of.this.name" / "wall.png")


# -- overrides of the command line


def test_set_takes_yaml(write: Any) -> None:
    given = {
        "start.size": "32x64",
        "start.method": "pixels",
        "start.block": "null",
        "structure.min_extent": "5e-2",
    }
    steps = load_flow(write(), Overrides({}, given)).steps
    start = steps["start"].params.model_dump()
    assert (start["size"], start["method"], start["block"]) == ((64, 32), "pixels", None)
    assert steps["structure"].params.model_dump()["min_extent"] == 0.05
    assert steps["edges"].params.model_dump()["finest"] == 2.0, "what the file says stays"


def test_set_replaces_a_wrong_value_of_the_file(write: Any) -> None:
    flow = load_flow(write("finest: 2.0", "finest: -1"), Overrides({}, {"edges.finest": "3"}))
    assert flow.steps["edges"].params.model_dump()["finest"] == 3.0


def test_a_preset_and_one_of_its_values() -> None:
    chosen = Overrides({}, {"texture.preset": "fast", "texture.ratio": "1.5"})
    params = load_flow(ROOT / "configs" / "self_tuning.yaml", chosen).steps["texture"].params.model_dump()
    assert {**params, **PRESETS["fast"], "ratio": 1.5} == params


def test_seed_of_the_command_line(write: Any) -> None:
    assert load_flow(write(), Overrides(seed=0)).seeds == (0,)
    assert load_flow(write("seed: 3", "seed: none"), Overrides(seed=2**63 - 1)).seeds == (2**63 - 1,)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (Overrides({"exemplr": "a"}), "--source exemplr: the flow has no such source; did you mean 'exemplar'?"),
        (Overrides({"zzz": "a"}), "--source zzz: the flow has no such source; there is exemplar"),
        (Overrides({}, {"edgse.finest": "1"}), "--set edgse.finest: no step 'edgse'; did you mean 'edges'?"),
        (
            Overrides({}, {"zzz.finest": "1"}),
            "--set zzz.finest: no step 'zzz'; there are edges, structure, start, scores",
        ),
        (Overrides({}, {"edges": "1"}), "--set edges: is a step; name one of its params, as edges.detector"),
        (Overrides({}, {"edges.finets": "1"}), "--set edges.finets: no such param; did you mean 'finest'?"),
        (Overrides({}, {"edges.": "1"}), "--set edges.: no such param; there are detector"),
        (Overrides({}, {"start.size.0": "9"}), "--set start.size.0: no such param; did you mean 'size'?"),
        (Overrides({}, {"edges.finest": "[1]"}), "--set edges.finest: input should be a valid number, got [1]"),
        (Overrides({}, {"edges.finest": "[1"}), "--set edges.finest: not valid YAML: "),
        (Overrides({}, {"edges.finest": "!!float 1"}), "--set edges.finest: not valid YAML: tags (!!float)"),
        (Overrides({}, {"start.size": "64x5"}), "--set start.size: the height should be greater than"),
        (Overrides({}, {"edges.model": "nowhere.yml"}), "--set edges.model: "),
        (Overrides(seed=-1), "--seed: must be a whole number from 0 to 2**63 - 1, got -1"),
        (Overrides(seed=2**63), "--seed: must be a whole number"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_wrong_overrides(write: Any, overrides: Overrides, message: str) -> None:
    assert refusal(write(), overrides).startswith(message)


# -- errors: place, expected value, actual value, closest match

EDGES = "stage: analysis.edges, inputs: {image: exemplar}"
WRONG = {  # change of GOOD => error
    # stages and params
    "analysis.otsu => analysis.ostu": (
        "steps.structure.stage: no stage 'analysis.ostu'; did you mean 'analysis.otsu'?"
    ),
    "analysis.otsu => otsu": "steps.structure.stage: no stage 'otsu'; did you mean 'analysis.otsu'?",
    "analysis.otsu => zzzz": "steps.structure.stage: no stage 'zzzz'; `texloom stages` lists them",
    "synthesis.initialise => synthesis._vote": "steps.start.stage: no stage 'synthesis._vote'; `texloom stages` ",
    "analysis.otsu => 7": "steps.structure.stage: must name a stage, got 7",
    "stage: analysis.otsu,  => ": "steps.structure.stage: must name a stage, got nothing",
    "finest => finset": "steps.edges.params.finset: no such param; did you mean 'finest'?",
    "2.0 => wide": "steps.edges.params.finest: input should be a valid number…, got 'wide'",
    "2.0 => 0": "steps.edges.params.finest: input should be greater than 0, got 0",
    "2.0 => .nan": "steps.edges.params.finest: input should be a finite number, got nan",
    "finest: 2.0 => detector: sobel": (
        "steps.edges.params.detector: input should be 'structured' or 'gradient', got 'sobel'"
    ),
    "finest: 2.0 => model: none.yml": "steps.edges.params.model: …none.yml: no such file or directory",
    "finest: 2.0 => model: .": "steps.edges.params.model: …: is not a file",
    "finest: 2.0 => model: /dev/zero": "…: /dev/zero: is not a file",
    'finest: 2.0 => model: "a\\0b"': "…a\\x00b: a file name cannot hold a zero byte",
    "{finest: 2.0} => [2.0]": "steps.edges.params: must be a mapping, got [2.0]",
    # inputs and references
    "strength: => strenght:": (
        "steps.structure.inputs.strenght: stage analysis.otsu has no such input; did you mean 'strength'?"
    ),
    "{strength: edges.strength} => {}": (
        "steps.structure.inputs: stage analysis.otsu needs 'strength' (float32 array (h w))"
    ),
    "edges.strength} => edges.strenght}": (
        "steps.structure.inputs.strength: step 'edges' has no output 'strenght'; did you mean 'strength'?"
    ),
    "edges.strength} => edgse.strength}": (
        "steps.structure.inputs.strength: no step 'edgse'; did you mean 'edges'?"
    ),
    "image: exemplar => image: exampler": (
        "steps.edges.inputs.image: no source 'exampler'; did you mean 'exemplar'?"
    ),
    "edges.strength} => edges}": "steps.structure.inputs.strength: which output of step 'edges'? edges.strength",
    "edges.strength} => [edges]}": (
        "steps.structure.inputs.strength: which output of step 'edges'? edges.strength"
    ),
    "edges.strength} => [edges.strength, 3]}": (
        "steps.structure.inputs.strength: must be a source or STEP.OUTPUT, got 3"
    ),
    "structure.structure => edges.strength": (
        "steps.start.inputs.structure: must be bool array (h w), but edges.strength is float32 array (h w)"
    ),
    "edges.strength} => exemplar}": (
        "steps.structure.inputs.strength: must be float32 array (h w), but exemplar is an image"
    ),
    "{strength: edges.strength} => edges": "steps.structure.inputs: must be a mapping, got 'edges'",
    "edges.strength} => structure.structure}": "steps.structure.inputs.strength: must be float32",
    # names and sources
    "edges: => exemplar:": "steps.exemplar: there is a source of the same name",
    "edges: => Edges:": "steps: 'Edges' is not a name; use small letters, digits and _",
    "edges: => yes:": "steps: True is not a name",
    "exemplar: pic => 1: pic": "sources: 1 is not a name",
    "pictures/wall.png => [a, b]": "sources.exemplar: must be a file, 'texloom:NAME', ",
    "pictures/wall.png => ": "sources.exemplar: must be a file, … or 'optional', got nothing",
    "pictures/wall.png => {eahc: '*'}": "sources.exemplar.eahc: unknown; did you mean",
    "pictures/wall.png => {pair: a}": "sources.exemplar.pair: no source 'a'",
    "pictures/wall.png => {pair: exemplar}": "sources.exemplar.pair: 'exemplar' must be another source",
    "pictures/wall.png => {}": "sources.exemplar.each: must be a pattern like 'folder/*.png', got nothing",
    "pictures/wall.png => {each: 3}": "sources.exemplar.each: must be a pattern like 'folder/*.png', got 3",
    "pictures/wall.png => {each: '*', pair: 3}": "sources.exemplar.pair: must be another source, got 3",
    "seed: 3 => format: 2": "format: must be 1, the newest that this texloom reads; update texloom, got 2",
    "seed: 3 => format: '1'": "format: must be the number of a format, up to 1, got '1'",
    # unknown fields
    f"{EDGES} => each: a, {EDGES}": "steps.edges.each: unknown; there are stage",
    f"{EDGES} => parms: 1, {EDGES}": "steps.edges.parms: unknown; did you mean 'params'?",
    "exports: => export:": "export: unknown; did you mean 'exports'?",
    "exports: => zzz:": (
        "zzz: unknown; there are format, flow, group, listed, seed, runner, delivery, part, keep, include, with, "
        "for, repeat, sources, steps, params, exports"
    ),
    'exports: => "a\\nb\\e[0m":': "a\\nb\\x1b[0m: unknown",
    # flow, seed, exports
    "contours => my flow": "flow: must be a name like 'my_flow'",
    "contours => ../../etc": "flow: must be a name",
    "seed: 3 => group: biger": "group: must be one of larger, tileable, materials, photographs, control, meshes, ",
    "seed: 3 => listed: 3": "listed: must be true or false, got 3",
    "seed: 3 => seed: three": "seed: must be a whole number from 0 to 2**63 - 1, got 'three'",
    "seed: 3 => seed: 3.5": "seed: must be a whole number",
    "seed: 3 => seed: true": "seed: must be a whole number",
    "seed: 3 => seed: -3": "seed: must be a whole number",
    f"seed: 3 => seed: {2**63}": "seed: must be a whole number",
    "edges.png => edges": "exports: 'edges' is not a file name of letters, digits,",
    "edges.png => edges.bmp": "exports: 'edges.bmp' is not a file name",
    "edges.png => ../edges.png": "exports: '../edges.png' is not a file name",
    "edges.png: edges.strength => edges.png/: exemplar\n  edges.png: edges.strength": (
        "exports.edges.png: 'edges.png/' is another export; a file and a folder cannot have the same name"
    ),
    "edges.png => .png": "exports: '.png' is not a file name",
    "edges.png: edges.strength => edges.png: edges.strong": (
        "exports.edges.png: step 'edges' has no output 'strong'; did you mean 'strength'?"
    ),
    "scores.json: scores.table => scores.json: edges.strength": (
        "exports.scores.json: must be a table or number, but edges.strength is float32 array (h w)"
    ),
    "edges.png: edges.strength => edges.png: scores.table": (
        "exports.edges.png: must be a picture or field, but scores.table is a table"
    ),
    "  edges.png: edges.strength\n  scores.json: scores.table\n =>   [a.png]": (
        "exports: must be a mapping, got ['a.png']"
    ),
    # values of a wrong type
    "edges.png: edges.strength => a.png: {image: exemplar, like: []}": "exports.a.png.like: no source [];",
    "seed: 3 => runner: {name: []}": "runner.name: no runner []; there are ",
    # YAML
    "seed: 3 => seed: 3\nseed: 4": "not valid YAML: 'seed' is given twice (line 4, column 1)",
    "  structure: =>   edges: {}\n  structure:": "not valid YAML: 'edges' is given twice",
    "finest: 2.0 => finest: 2.0, finest: 1.0": "not valid YAML: 'finest' is given twice",
    "seed: 3 => [a]: 3": "not valid YAML: a key must be plain text (line 3, column 1)",
    "seed: 3 => <<: {seed: 3}": "not valid YAML: merge keys (<<) are not allowed (line 3",
    "seed: 3 => seed: &s 3\nother: *s": "not valid YAML: aliases (*s) are not allowed (line 4, column 8)",
    "seed: 3 => seed: !!int 3": "not valid YAML: tags (!!int) are not allowed (line 3, column 7)",
    "contours => !!python/object/apply:os.getcwd []": "not valid YAML: tags (!!python/object",
    "contours => !mine x": "not valid YAML: tags (!mine) are not allowed",
    "contours => !!set [a]": "not valid YAML: tags (!!set) are not allowed",
    "contours => 2020-99-99": "not valid YAML: month must be in 1..12",
    f"seed: 3 => seed: {'9' * 5000}": "not valid YAML: ",
    "exports: => ---\nexports:": "not valid YAML: ",
    "{image: exemplar}, params => {image: exemplar, params": "not valid YAML: ",
    "  exemplar: => \texemplar:": "not valid YAML: ",
    "contours => con\x07tours": "not valid YAML: ",
    "contours => =": "not valid YAML: ",
}


@pytest.mark.parametrize("change", WRONG, ids=lambda change: repr(change[:80]))
def test_wrong_flow(write: Any, change: str) -> None:
    expected = ".*".join(map(re.escape, WRONG[change].split("…")))
    assert re.match(expected, refusal(write(*change.split(" => "))))


LATTICE = """
sources: {s: a.png}
steps:
  offsets: {stage: analysis.offset_statistics, inputs: {image: s}}
  lattice: {stage: analysis.lattice, inputs: {image: s, density: offsets.density}}
  distance: {stage: analysis.signed_distance, inputs: {structure: lattice.generators}}
  start: {stage: synthesis.initialise, inputs: {image: s, generators: offsets.density}}
"""


def test_a_list_is_no_mesh(write: Any) -> None:
    text = "sources: {m: texloom:torus}\nsteps: {c: {stage: analysis.surface_charts, inputs: {mesh: []}}}"
    assert refusal(write(text=text)) == "steps.c.inputs.mesh: must be a source or STEP.OUTPUT, got []"


def test_a_list_is_not_a_field(write: Any) -> None:
    """Both are arrays of two axes."""
    assert refusal(write(text=LATTICE)).startswith(
        "steps.distance.inputs.structure: must be bool array (h w), but lattice.generators is float32 array (n 2)"
    )
    assert refusal(write("  distance:", "  # distance:", LATTICE)).startswith(
        "steps.start.inputs.generators: must be float32 array (n 2), but offsets.density is float32 array (h w)"
    )


def test_outputs_that_can_be_pictures(write: Any) -> None:
    flow = """
    sources: {s: a.png}
    steps:
      edges: {stage: analysis.edges, inputs: {image: s}}
      structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
      offsets: {stage: analysis.offset_statistics, inputs: {image: s}}
      lattice: {stage: analysis.lattice, inputs: {image: s, density: offsets.density}}
      start: {stage: synthesis.initialise, inputs: {image: s}}
    exports:
      it.png: """
    for output in ("s", "edges.strength", "structure.structure", "start.image", "start.match"):
        assert load_flow(write(text=textwrap.dedent(flow) + output)).exports
    assert refusal(write(text=textwrap.dedent(flow) + "lattice.generators")) == (
        "exports.it.png: must be a picture, but lattice.generators is float32 array (n 2); export it as .exr"
    )
    text = textwrap.dedent(flow).replace("it.png", "it.exr")
    assert load_flow(write(text=text + "lattice.generators")).exports
    assert load_flow(write(text=text + "{image: edges.strength, like: s, if_maps: true}")).of_maps == ("it.exr",)
    text = textwrap.dedent(flow).replace("it.png", "it.data.png")
    assert load_flow(write(text=text + "edges.strength")).exports
    assert refusal(write(text=text + "start.image")) == (
        "exports.it.data.png: must be a field, but start.image is an image; export it as .png"
    )


def test_a_cycle_names_its_steps(write: Any) -> None:
    ring = """
    steps:
      a: {stage: analysis.signed_distance, inputs: {structure: c.structure}}
      b: {stage: analysis.otsu, inputs: {strength: a.pixels}}
      c: {stage: analysis.otsu, inputs: {strength: d.strength}}
      d: {stage: analysis.edges, inputs: {image: start.image}}
      start: {stage: synthesis.initialise, inputs: {image: s, structure: b.structure}}
    sources: {s: a.png}
    """
    problem = refusal(write(text=textwrap.dedent(ring)))
    assert problem.startswith("steps: a cycle: ")
    names = problem.removeprefix("steps: a cycle: ").split(" <- ")
    assert names[0] == names[-1]
    assert set(names) == {"a", "b", "c", "d", "start"}


def test_a_step_that_needs_itself_is_a_cycle(write: Any) -> None:
    text = "sources: {s: a.png}\nsteps: {a: {stage: synthesis.initialise, inputs: {image: a.image}}}"
    assert refusal(write(text=text)) == "steps: a cycle: a <- a"


@pytest.mark.parametrize("text", ["", "\n", "# a word\n", "- a\n- b\n", "word", "3", "[]", "null"])
def test_not_a_mapping(write: Any, text: str) -> None:
    assert refusal(write(text=text)).startswith("must be a mapping with 'flow', 'sources', 'steps' and 'exports'")


@pytest.mark.parametrize("text", ["flow: a", "steps:", "steps: {}", "{}"])
def test_no_steps(write: Any, text: str) -> None:
    assert refusal(write(text=text)) == "steps: there must be at least one step"


def test_billion_laughs(write: Any) -> None:
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12)]
    assert "aliases (*a0) are not allowed" in refusal(write(text="\n".join(levels)))


@pytest.mark.parametrize("text", ["[" * 10_000, "{a: " * 10_000 + "1" + "}" * 10_000, "- " * 10_000 + "a"])
def test_nested_too_deeply(write: Any, text: str) -> None:
    assert refusal(write(text=text)) == "not valid YAML: nested too deeply"


def test_too_large(write: Any) -> None:
    assert refusal(write(text=GOOD + "#" * (1 << 20))) == "larger than 1048576 bytes"


def test_long_values_are_cut(write: Any) -> None:
    assert refusal(write("contours", "x" * 10_000)).endswith("xxx...")
    assert len(refusal(write("contours", "x" * 10_000))) < 250
    assert len(refusal(write("exports:", f"? {'x' * 10_000}\n:"))) < 3000


@pytest.mark.parametrize(
    "content", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfe", bytes(range(256)), b"flow: \xed\xa0\x80"]
)
def test_binary_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flow.yaml"
    path.write_bytes(content)
    assert refusal(path) == "not a text file in UTF-8"


def test_tags_execute_nothing(write: Any, tmp_path: Path) -> None:
    harm = f"!!python/object/apply:os.mkdir ['{tmp_path / 'harm'}']"
    refusal(write("contours", harm))
    assert not (tmp_path / "harm").exists()


def test_missing_flow_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").touch()
    for name, message in {
        "self_tunning": "self_tunning: no such flow; did you mean 'self_tuning'?",
        "zzz": "zzz: no such flow; `texloom flows` lists those that ship",
        "mine": "mine: no such flow; did you mean 'mine.yaml'?",
        "./zzz.yaml": "./zzz.yaml: no such flow",
        str(tmp_path): f"{tmp_path}: is a folder, not a flow file",
        "x" * 5000: "x" * 2000,
        "a\nb": "a\\nb: no such flow",
    }.items():
        with pytest.raises(InputError) as caught:
            find_flow(name)
        assert str(caught.value).startswith(message)
        assert str(caught.value).isprintable()
    assert refusal(tmp_path / "gone.yaml") == "no such file"
    assert refusal(tmp_path) == "cannot be read: Is a directory"


def test_a_file_comes_before_a_shipped_flow_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_flow("self_tuning").parent.name == "configs"
    Path("self_tuning").write_text(GOOD)
    assert find_flow("self_tuning") == Path("self_tuning")


# -- any input gives a flow or one line


KEYS = ["flow", "seed", "sources", "steps", "exports", "stage", "inputs", "params", "each", "exemplar", "edges"]
VALUES = ["exemplar", "edges.strength", "analysis.edges", "analysis.otsu", "image", "strength", "finest", "model"]
scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from(VALUES)
keys = st.sampled_from(KEYS + VALUES) | scalars
documents = st.recursive(scalars, lambda part: st.lists(part, max_size=3) | st.dictionaries(keys, part, max_size=4))
documents.validate()  # reads the line above, which may be edited while tests run
steps = st.dictionaries(
    st.sampled_from(["edges", "otsu", "a b"]),
    st.fixed_dictionaries(
        {"stage": st.sampled_from(["analysis.edges", "analysis.otsu", "analysis"]) | documents},
        optional={"inputs": st.dictionaries(keys, scalars, max_size=3) | documents, "params": documents},
    )
    | documents,
)
flows = st.fixed_dictionaries(
    {"steps": steps},
    optional={
        "flow": scalars,
        "seed": scalars,
        "sources": st.dictionaries(st.just("exemplar") | keys, scalars, max_size=2),
        "exports": st.dictionaries(st.sampled_from(["a.png", "b.json", "c"]) | keys, scalars, max_size=2),
    },
)


def check_loads_or_is_refused(path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
    problem = ""
    try:
        assert load_flow(path, overrides).steps
    except InputError as error:
        problem = str(error)
    assert problem.isprintable()


@st.composite
def flows_with_a_piece_cut_out(draw: st.DrawFn) -> str:
    first = draw(st.integers(0, len(GOOD)))
    last = draw(st.integers(first, min(len(GOOD), first + 30)))
    return GOOD[:first] + draw(st.text(max_size=3)) + GOOD[last:]


CONTENTS: dict[str, st.SearchStrategy[bytes]] = {
    "documents": st.one_of(documents, flows).map(lambda value: yaml.safe_dump(value, allow_unicode=True).encode()),
    "text": st.text("ab:-[]{}#&*!|>'\"%@`,?~<=.09 \n\t\r\0\u2028é", max_size=40).map(str.encode),
    "bytes": st.binary(max_size=40),
    "cut flows": flows_with_a_piece_cut_out().map(str.encode),
}


@pytest.mark.parametrize("contents", CONTENTS.values(), ids=CONTENTS)
@given(data=st.data())
def test_any_content_loads_or_is_refused_on_one_line(
    tmp_path_factory: pytest.TempPathFactory, contents: st.SearchStrategy[bytes], data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(data.draw(contents))
    check_loads_or_is_refused(path)


@given(st.dictionaries(st.sampled_from(["edges.finest", "start.size", "edges.model", "x"]) | st.text(), st.text()))
def test_any_override_is_taken_or_refused_on_one_line(
    tmp_path_factory: pytest.TempPathFactory, params: dict[str, str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "good.yaml"
    path.write_text(GOOD, encoding="utf-8")
    check_loads_or_is_refused(path, Overrides({}, params))


def test_parse_yaml_of_plain_values() -> None:
    values = parse_yaml("[1, 2.5, text, true, null, {a: 1e-3}]", "here")
    assert values == [1, 2.5, "text", True, None, {"a": "1e-3"}]
    values[5]["a"] = 2
    assert parse_yaml("[1, 2.5, text, true, null, {a: 1e-3}]", "here")[5:] == [{"a": "1e-3"}], "read anew"
    assert parse_yaml("[-3, +4, 0, 1_000, 0x200, 0b11, 010, 1:30]", "here") == [
        *(-3, 4, 0, 1000),
        *("0x200", "0b11", "010", "1:30"),  # numbers to YAML 1.1, to nobody else
    ]
    with pytest.raises(InputError, match=r"^here: larger than"):
        parse_yaml("x" * (plain_yaml._LARGEST + 1), "here")


DELIVERY = "delivery: {layout: unity, texel_size: 0.5mm}\nexports:\n  texture.png: start.image"


def test_a_flow_states_how_exports_are_written(write: Any, tmp_path: Path) -> None:
    path = write("exports:", DELIVERY)
    delivery = load_flow(path).delivery
    assert (delivery.layout, delivery.texel_size) == ("unity", 0.0005)
    changed = load_flow(path, Overrides(delivery={"layout": "blender", "udim": "2x1"})).delivery
    assert (changed.layout, changed.texel_size, changed.udim) == ("blender", 0.0005, (1, 2))
    (tmp_path / "more.yaml").write_text("flow: more\ninclude: flow.yaml\ndelivery: {texel_size: 1cm}\n")
    assert load_flow(tmp_path / "more.yaml").delivery == dataclasses.replace(delivery, texel_size=0.01)
    (tmp_path / "each.yaml").write_text("flow: each\nfor: {a: {include: flow.yaml}, b: {include: flow.yaml}}\n")
    assert load_flow(tmp_path / "each.yaml").delivery.layout == "unity"


def test_a_flow_states_what_is_taken_of_its_exemplar(write: Any, tmp_path: Path) -> None:
    path = write("exports:", "part: {crop: 40x30+8+4, reduce: 0.5}\ndelivery: {texel_size: 1mm}\nexports:")
    flow = load_flow(path)
    assert flow.parts == {next(iter(flow.sources)): Part((30, 40), (4, 8), 0.5)}
    assert flow.delivery.texel_size == 0.002
    (tmp_path / "more.yaml").write_text("flow: more\ninclude: flow.yaml\npart: {reduce: .25}\n")
    changed = load_flow(tmp_path / "more.yaml", Overrides(part={"crop": "20x10"}))
    assert list(changed.parts.values()) == [Part((10, 20), None, 0.25)]
    for stated, problem in (("{reduce: 3}", "part.reduce: must be a factor"), ("{cut: 3}", "part.cut: unknown")):
        with pytest.raises(InputError, match=re.escape(problem)):
            load_flow(write("exports:", f"part: {stated}\nexports:"))


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ("{layout: unrael}", "delivery.layout: no layout 'unrael'; did you mean 'unreal'?"),
        ("{material: moss}", "delivery.material: needs a layout, whose files begin with it"),
        ("{layout: unity, material: '-'}", "delivery.material: must have a letter or digit, got '-'"),
        ("{udim: 2x2}", "delivery.udim: needs a layout, whose maps are cut into tiles"),
        ("{size: 4}", "delivery.size: unknown"),
        ("{texel_size: 4}", "delivery.texel_size: must be a text, got 4"),
        ("unity", "delivery: must be a mapping"),
    ],
)
def test_a_wrong_delivery(write: Any, stated: str, problem: str) -> None:
    path = write("exports:", f"delivery: {stated}\nexports:")
    with pytest.raises(InputError, match=re.escape(problem)):
        load_flow(path)
