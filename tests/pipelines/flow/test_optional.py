"""Optional sources: what is skipped without them, what takes its place, what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image as Pillow

import texloom
from texloom.pipelines.cli import main as cli
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.command_list import command_list
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.recipe_flows import flow_file, open_recipe
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: base
sources:
  exemplar: exemplar.png
  mask: {optional: what is black is not used, pair: exemplar}
  painted: {optional: the wanted picture}
  own: optional
  strokes: optional
steps:
  clean: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: mask}, only: mask}
  edges: {stage: analysis.edges, inputs: {image: [clean.image, exemplar]}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  guide:
    stage: analysis.guide
    inputs: {image: [clean.image, exemplar], exemplar_guide: own, target_guide: painted}
  angle: {stage: analysis.orientation_field, inputs: {image: exemplar}, only: strokes}
  wanted: {stage: analysis.orientation_field, inputs: {image: strokes, strokes: strokes}}
  turned:
    stage: analysis.orientation_guide
    inputs: {image: exemplar, angle: angle.angle, target_angle: wanted.angle}
  start:
    stage: synthesis.initialise
    inputs:
      image: [clean.image, exemplar]
      structure: structure.structure
      exemplar_guide: [guide.exemplar, turned.exemplar]
      target_guide: [guide.target, turned.target]
    params: {size: 64}
    when:
      painted: {params: {size: null}}
      strokes: {inputs: {structure: null}, params: {size: null}}
  texture: {stage: synthesis.optimise, inputs: {image: [clean.image, exemplar], start: start.match}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: texture.image}}
  table: {stage: evaluation.tabulate, gather: {tables: scores.table}, only: sets}
params:
  size: start.size
  weight: [guide.weight, turned.weight]
  grow: clean.grow
exports:
  texture.png: texture.image
  scores.json: scores.table
  usable.png: clean.valid
  wanted.png: wanted.picture
  table.json: table.table
  maps/: {image: texture.image, like: exemplar, if_maps: true}
"""
GUIDES = {"own": "labels.png", "painted": "wanted.png"}


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    for name in ("exemplar", "mask", "labels", "wanted", "strokes"):
        Pillow.fromarray(rng.integers(0, 256, (64, 64, 3)).astype(np.uint8)).save(tmp_path / f"{name}.png")
    (tmp_path / "base.yaml").write_text(FLOW)
    return tmp_path


def loaded(folder: Path, text: str = "", **fields: Any) -> Flow:
    path = folder / "base.yaml"
    if text:
        path = folder / "flow.yaml"
        path.write_text(text)
    fields["sources"] = {name: str(folder / file) for name, file in fields.get("sources", {}).items()}
    return load_flow(path, Overrides(**fields))


def refusal(folder: Path, text: str = "", **fields: Any) -> str:
    with pytest.raises(InputError) as caught:
        loaded(folder, text, **fields)
    return str(caught.value).removeprefix(f"{folder}/flow.yaml: ")


def inputs(flow: Flow, step: str) -> dict[str, str]:
    return {name: str(reference) for name, reference in flow.steps[step].inputs.items()}


# -- what is skipped, and what takes its place


def test_without_them(folder: Path) -> None:
    flow = loaded(folder)
    assert set(flow.steps) == {"edges", "structure", "start", "texture", "scores"}
    assert {name: step.reason for name, step in flow.skipped.items()} == {
        "clean": "no mask",
        "guide": "no own and painted",
        "angle": "no strokes",
        "wanted": "no strokes",
        "turned": "no strokes",
        "table": "no set",
    }
    assert inputs(flow, "edges") == {"image": "exemplar"}
    assert inputs(flow, "start") == {"image": "exemplar", "structure": "structure.structure"}
    assert dict(flow.steps["start"].params)["size"] == (64, 64)
    assert set(flow.exports) == {"texture.png", "scores.json", "maps/"}
    assert flow.unwritten == {"usable.png": ("mask",), "wanted.png": ("strokes",), "table.json": ("set",)}
    assert not flow.is_set
    assert flow.optional == {
        "mask": "what is black is not used", "painted": "the wanted picture", "own": "", "strokes": "",
    }  # fmt: skip


def test_the_first_that_is_there_is_taken(folder: Path) -> None:
    flow = loaded(folder, sources={"mask": "mask.png"})
    assert inputs(flow, "edges") == {"image": "clean.image"}
    assert str(flow.exports["usable.png"]) == "clean.valid"


def test_a_source_that_is_there_changes_steps(folder: Path) -> None:
    guided = loaded(folder, sources=GUIDES)
    assert inputs(guided, "start")["target_guide"] == "guide.target"
    assert dict(guided.steps["start"].params)["size"] is None
    turned = loaded(folder, sources={"strokes": "strokes.png"})
    assert set(inputs(turned, "start")) == {"image", "exemplar_guide", "target_guide"}
    assert turned.skipped["structure"].reason == turned.skipped["edges"].reason == "nothing takes its result"
    wins = loaded(folder, sources=GUIDES, params={"size": "48"})
    assert dict(wins.steps["start"].params)["size"] == (48, 48)
    with_ = loaded(folder, "include: base.yaml\nwith: {size: 32}", sources=GUIDES)
    assert dict(with_.steps["start"].params)["size"] == (32, 32)
    changed = "include: base.yaml\nsteps: {start: {inputs: {structure: edges.mask}}}"
    assert "no output 'mask'" in refusal(folder, changed, sources={"strokes": "strokes.png"})


@pytest.mark.parametrize("over", [{"seeds": 2}, {"sources": {"exemplar": "*.png"}}])
def test_a_step_only_for_sets(folder: Path, over: dict[str, Any]) -> None:
    flow = loaded(folder, **over)
    assert flow.is_set
    assert flow.steps["table"].scope == "final"
    assert "table.json" in flow.exports


def test_sets_that_are_pairs(folder: Path) -> None:
    for name in ("exemplar", "mask"):
        (folder / name).mkdir()
        for item in ("a", "b"):
            (folder / name / f"{item}.png").write_bytes((folder / f"{name}.png").read_bytes())
    sides = {"exemplar": "exemplar", "mask": "mask"}
    opened = Run(loaded(folder, sources=sides), Store(folder / "store"))
    assert [{name: Path(path).name for name, path in item.sources.items()} for item in opened.items] == [
        {"exemplar": "a.png", "mask": "a.png"}, {"exemplar": "b.png", "mask": "b.png"},
    ]  # fmt: skip
    one = Run(loaded(folder, sources=sides | {"mask": "mask.png"}), Store(folder / "store"))
    assert [list(item.sources) for item in one.items] == [["exemplar"], ["exemplar"]]


# -- what is refused


def test_a_source_that_nothing_takes(folder: Path) -> None:
    assert refusal(folder, sources={"painted": "wanted.png"}) == (
        "--source painted: is used only with own, as in: texloom run base exemplar.png --source own=own.png "
        "--source painted=painted.png"
    )
    with pytest.raises(InputError, match=r"^sources painted: is used only with own$"):
        texloom.plan(folder / "base.yaml", {"painted": folder / "wanted.png"}, store=folder / "store")


def test_sources_that_exclude_each_other(folder: Path) -> None:
    both = refusal(folder, sources=GUIDES | {"strokes": "strokes.png"})
    assert both == "--source strokes: cannot be given with painted and own; leave one out"


def test_params_of_steps_that_are_skipped(folder: Path) -> None:
    assert refusal(folder, params={"grow": "2"}) == "--set grow: step 'clean' is skipped: no mask"
    assert refusal(folder, params={"clean.grow": "2"}) == "--set clean.grow: step 'clean' is skipped: no mask"
    assert refusal(folder, params={"weight": "2"}) == "--set weight: step 'guide' is skipped: no own and painted"
    strokes = loaded(folder, sources={"strokes": "strokes.png"}, params={"weight": "2"})
    assert dict(strokes.steps["turned"].params)["weight"] == 2


def test_exports_that_are_asked_for_but_skipped(folder: Path) -> None:
    asked = {"valid.png": "clean.valid"}
    assert refusal(folder, exports=asked) == "--export valid.png: clean.valid is not there: no mask"
    assert refusal(folder, exports={"m.png": "mask"}) == "--export m.png: mask is not there: no mask"
    dropped = "flow: b\ninclude: base.yaml\nsources: {mask: null}"
    assert refusal(folder, dropped, exports=asked) == "--export valid.png: clean.valid is not there: no mask"
    assert "valid.png" in loaded(folder, sources={"mask": "mask.png"}, exports=asked).exports


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[clean.image, exemplar]}}", "[clean.imag, exemplar]}}", "steps.edges.inputs.image: step 'clean' has no"),
        (
            "[clean.image, exemplar]}}",
            "[clean.valid, exemplar]}}",
            "steps.edges.inputs.image: must be an image, but",
        ),
        ("[clean.image, exemplar]}}", "[]}}", "steps.edges.inputs.image: must be a source or STEP.OUTPUT, got []"),
        (
            "painted: {params",
            "paint: {params",
            "steps.start.when.paint: no source 'paint'; did you mean 'painted'?",
        ),
        (
            "{params: {size: null}}",
            "{parms: {}}",
            "steps.start.when.painted.parms: unknown; did you mean 'params'?",
        ),
        ("{params: {size: null}}", "{params: {sise: 3}}", "steps.start.when.painted.params.sise: stage "),
        ("{structure: null}", "{structur: null}", ""),
        ("{structure: null}", "{structur: edges.strength}", "steps.start.when.strokes.inputs.structur: stage "),
        ("only: mask", "only: masks", "steps.clean.only: no source 'masks'; did you mean 'mask'?"),
        ("used, pair: exemplar", "used, each: '*.png'", "sources.mask: is either optional or has files"),
        ("{optional: the wanted picture}", "{optional: true}", "sources.painted.optional: must be a text"),
        (
            "usable.png: clean.valid",
            "usable.png: [clean.valid, clean.vali]",
            "exports.usable.png: step 'clean' has",
        ),
    ],
)
def test_all_is_checked_whether_it_is_there_or_not(folder: Path, old: str, new: str, problem: str) -> None:
    assert FLOW.count(old) >= 1
    text = FLOW.replace(old, new, 1)
    if problem:
        assert refusal(folder, text).startswith(problem)
    else:
        loaded(folder, text)


# -- flows that include it


def test_a_flow_leaves_an_optional_source_out(folder: Path) -> None:
    flow = loaded(folder, "include: base.yaml\nsources: {own: null, mask: null}")
    assert set(flow.optional) == {"strokes"}  # `painted` is of no use without `own`
    assert set(flow.skipped) == {"angle", "wanted", "turned", "table"}
    assert "usable.png" not in flow.unwritten
    without = "include: base.yaml\nsources: {mask: null}"
    assert "no such source" in refusal(folder, without, sources={"mask": "m.png"})
    assert refusal(folder, "include: base.yaml\nsources: {exemplar: null}").startswith(
        "sources.exemplar: is not opt"
    )
    assert refusal(folder, "include: base.yaml\nsources: {other: null}").startswith("sources.other: must be a file")


def test_what_belongs_to_a_picture_belongs_to_no_result(folder: Path) -> None:
    text = """
include: {flow: base.yaml, inputs: {exemplar: even.image}}
sources: {photo: exemplar.png}
steps: {even: {stage: analysis.tone, inputs: {image: photo}}}
"""
    flow = loaded(folder, text)
    assert set(flow.optional) == {"painted", "own", "strokes"}
    assert inputs(flow, "edges") == {"image": "even.image"}
    assert "maps/" not in flow.exports
    renamed = loaded(
        folder, "include: {flow: base.yaml, inputs: {exemplar: photo}}\nsources: {photo: exemplar.png}"
    )
    assert renamed.likes == {"maps/": "photo"}
    assert "mask" in renamed.optional


def test_a_source_that_the_including_file_needs_has_its_place(folder: Path) -> None:
    text = """
include: {flow: base.yaml, inputs: {exemplar: clean.image}}
sources: {photo: required, mask: {pair: photo}}
steps: {clean: {stage: analysis.exclusion_mask, inputs: {image: photo, mask: mask}}}
"""
    assert list(loaded(folder, text).sources)[:2] == ["photo", "mask"]


def test_a_source_that_is_bound_is_there(folder: Path) -> None:
    bound = "include: {flow: base.yaml, inputs: {painted: labels, own: labels}}\nsources: {labels: labels.png}"
    flow = loaded(folder, bound)
    assert dict(flow.steps["start"].params)["size"] is None
    assert inputs(flow, "guide") == {"image": "exemplar", "exemplar_guide": "labels", "target_guide": "labels"}
    optional = loaded(folder, bound.replace("labels.png", "optional"))
    assert optional.skipped["guide"].reason == "no labels"
    assert dict(optional.steps["start"].params)["size"] == (64, 64)


def test_only_some_steps_are_taken(folder: Path) -> None:
    flow = loaded(folder, "include: {flow: base.yaml, steps: [structure]}\nexports: {s.png: structure.structure}")
    assert set(flow.optional) == {"mask"}
    assert set(flow.steps) == {"edges", "structure"}
    assert inputs(loaded(folder, (folder / "flow.yaml").read_text(), sources={"mask": "mask.png"}), "edges") == {
        "image": "clean.image"
    }


def test_variants_and_rounds(folder: Path) -> None:
    text = """
include: base.yaml
for: {a: {}, b: {steps: {edges: {params: {scales: [1]}}}}}
exports: {"*.png": texture.image}
"""
    flow = loaded(folder, text, sources={"mask": "mask.png"})
    assert inputs(flow, "a_edges") == inputs(flow, "b_edges") == {"image": "clean.image"}
    assert inputs(loaded(folder, text), "a_texture") == {"image": "exemplar", "start": "a_start.match"}
    rounds = "include: {flow: base.yaml, steps: [texture], inputs: {exemplar: former.texture.image}}\nrepeat: 2\n"
    flow = loaded(folder, rounds + "exports: {texture.png: texture.image}")
    assert inputs(flow, "round_1_edges") == {"image": "exemplar"}
    assert inputs(flow, "round_2_edges") == {"image": "round_1_texture.image"}
    assert set(flow.optional) == {"painted", "own", "strokes"}
    assert "no step 'clean'" in refusal(folder, rounds, params={"clean.grow": "2"})


# -- what plan says


def test_a_plan_names_what_is_skipped(folder: Path) -> None:
    plan = texloom.plan(folder / "base.yaml", store=folder / "store")
    skipped = {step.name: step.reasons for step in plan if step.state == "skipped"}
    assert skipped["clean"] == ("no mask",)
    assert [step.key for step in plan if step.name == "clean"] == [None]
    with_mask = texloom.plan(folder / "base.yaml", {"mask": folder / "mask.png"}, store=folder / "store")
    assert {step.name: step.state for step in with_mask}["clean"] == "run"


def test_what_is_not_given_enters_no_key(folder: Path) -> None:
    plain = """
flow: base
sources: {exemplar: exemplar.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
"""
    alone = Run(loaded(folder, plain), Store(folder / "store"))
    run = Run(loaded(folder), Store(folder / "store"))
    for name, step in alone.flow.steps.items():
        assert run.flow.steps[name] == step
        assert run.parts(run.flow.steps[name], run.shared).key == alone.parts(step, alone.shared).key


# -- all ways to run a flow


def test_commands_and_deployments_give_it(folder: Path) -> None:
    from texloom.pipelines.engine.prefect.flow_run import parameters_of

    flow = loaded(folder, sources={"mask": "mask.png"})
    listed = command_list(flow, [], folder / "store", folder / "out", force=False).lines()
    assert f"--source mask={folder}/mask.png" in listed[0]
    parameters = parameters_of(Run(flow, Store(folder / "store")), folder / "out")
    assert parameters["source"]["mask"] == str(folder / "mask.png")
    assert set(parameters["source"]) == {"exemplar", "mask"}


def test_the_command_line_tells(folder: Path) -> None:
    def told(*words: str) -> str:
        made = CliRunner().invoke(cli.texloom, [*words], standalone_mode=False)
        assert made.exception is None
        return made.output

    flow = str(folder / "base.yaml")
    assert "clean      skipped  no mask" in told("plan", flow, "--store", str(folder / "store"))
    explained = told("flows", flow)
    assert "mask      optional: what is black is not used" in explained
    assert "(only with own and painted)" in explained
    assert json.loads(told("flows", flow, "--json"))["exports_with"]["table.json"] == ["set"]


def test_the_studio_gives_it(folder: Path) -> None:
    library = Library(folder, folder / "store")
    sources = {"exemplar": "folder:exemplar.png", "mask": "folder:mask.png"}
    recipe = Recipe(flow="self_tuning", sources=sources, size="64", params={"clean.grow": 1})
    run = open_recipe(recipe, library, Store(folder / "store"))
    assert "clean" in run.flow.steps
    (folder / "made.yaml").write_text(flow_file(recipe, run.flow, "made.yaml", library))
    made = load_flow(folder / "made.yaml")
    assert {name: step.params for name, step in made.steps.items()} == {
        name: step.params for name, step in run.flow.steps.items()
    }
