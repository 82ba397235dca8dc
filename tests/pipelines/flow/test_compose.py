"""Composition of flows: include, with, for, repeat; the params that a flow declares."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.pipelines.flows import Events, write_flow
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.comparison import comparison_flow
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides, Reference
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError

METHOD = """
flow: method
seed: 3
sources: {exemplar: exemplar.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  texture:
    stage: synthesis.initialise
    inputs: {image: exemplar, structure: structure.structure}
    params: {size: 40x32, method: pixels}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: texture.image, match: texture.match}}
params: {size: texture.size, method: texture.method}
exports: {texture.png: texture.image, scores.json: scores.table}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_flow(tmp_path)
    (tmp_path / "method.yaml").write_text(METHOD)
    return tmp_path


def loaded(folder: Path, text: str, **overrides: Any) -> Flow:
    (folder / "flow.yaml").write_text(text)
    return load_flow(folder / "flow.yaml", Overrides(**overrides))


def refusal(folder: Path, text: str, **overrides: Any) -> str:
    with pytest.raises(InputError) as caught:
        loaded(folder, text, **overrides)
    return str(caught.value).replace(f"{folder}/", "")


def param(flow: Flow, step: str, name: str) -> Any:
    return flow.steps[step].params.model_dump()[name]


# -- params of a flow


@pytest.mark.parametrize(
    ("text", "size"),
    [("64", (64, 64)), ("96x48", (48, 96)), ((48, 96), (48, 96))],
)
@pytest.mark.parametrize("target", ["size", "start.size"])
def test_sizes_are_width_by_height_in_text(target: str, text: str | tuple[int, int], size: tuple[int, int]) -> None:
    flow = load_flow(find_flow("self_tuning"), Overrides(params={target: text}))
    assert flow.overrides.params[target] in ("64", "96x48")
    assert param(flow, "start", "size") == size


def test_a_param_reaches_all_its_steps() -> None:
    flow = load_flow(find_flow("ablation"), Overrides(params={"size": "64"}))
    assert param(flow, "start", "size") == param(flow, "pixels", "size") == (64, 64)


def test_an_entry_of_a_mapping(folder: Path) -> None:
    flow = load_flow(find_flow("quilting"), Overrides(params={"texture.weights.height": "0"}))
    assert param(flow, "texture", "weights") == {"height": 0}


@pytest.mark.parametrize(
    ("target", "text", "value"),
    [
        ("edges.scales", "0.5,1,2", (0.5, 1, 2)),
        ("edges.scales", "1", (1,)),
        ("edges.scales", "[1, 2]", (1, 2)),
        ("material.maps", "height", ("height",)),
        ("material.maps", "height,ao", ("height", "ao")),
        ("material.maps", "none", ()),
    ],
)
def test_lists_without_brackets(target: str, text: str, value: tuple[Any, ...]) -> None:
    flow = load_flow(find_flow("materials"), Overrides(params={target: text}))
    assert param(flow, *target.split(".")) == value


def test_params_that_are_wrong(folder: Path) -> None:
    method = str(folder / "method.yaml")
    for target, message in (
        ("sise", "--set sise: method has no such param; did you mean 'size'?"),
        ("zzz", "--set zzz: method has no such param; it has size, method and those of its steps, as STEP.PARAM"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            load_flow(Path(method), Overrides(params={target: "3"}))
    with pytest.raises(InputError, match=r"--set size: must be N or WIDTHxHEIGHT, .*, got 'wide'"):
        load_flow(Path(method), Overrides(params={"size": "wide"}))
    assert refusal(folder, METHOD.replace("size: texture.size", "size: txture.size")) == (
        "flow.yaml: params.size: no step 'txture'; did you mean 'texture'?"
    )
    assert refusal(folder, METHOD.replace("size: texture.size", "size: texture.sise")) == (
        "flow.yaml: params.size: stage synthesis.initialise has no param 'sise'; did you mean 'size'?"
    )


STUDIES = {
    "ablation",
    "adaptive_study",
    "coarse_control_study",
    "energy_curve",
    "guidance_study",
    "joint_energy_curve",
    "regularity_study",
    "sequence_study",
}
"""flows whose results are pages and tables"""


@pytest.mark.parametrize("name", shipped_flows())
def test_params_of_shipped_flows(name: str) -> None:
    """Every flow that makes a picture of a size that can be chosen declares it, and exports it as texture.*."""
    flow = load_flow(find_flow(name))
    sized = [step for step in flow.steps.values() if "size" in type(step.params).model_fields]
    if any(step.stage.name.startswith("synthesis.") and "target_jacobian" not in step.inputs for step in sized):
        assert {"size", "compaction"} & set(flow.params)
    makes_picture = any(step.stage.name.startswith("synthesis.") for step in flow.steps.values())
    if makes_picture and name not in STUDIES:
        assert {"texture.png", "texture.exr"} <= set(flow.exports)
        assert flow.exports["texture.png"] == flow.exports["texture.exr"]


def test_a_param_reaches_every_method_that_is_compared() -> None:
    methods = ["self_tuning", "texture_optimisation", "quilting", "per_pixel"]
    flow = comparison_flow(methods, Overrides(params={"size": "256x384"}), "skimage:brick")
    sizes = {name: step.params.model_dump().get("size") for name, step in flow.steps.items()}
    assert sizes["self_tuning_start"] == sizes["quilting_texture"] == sizes["per_pixel_texture"] == (384, 256)
    assert {size for size in sizes.values() if size} == {(384, 256)}
    assert flow.steps["compare_lattice"].stage.name == "analysis.lattice_selection"
    flow = comparison_flow(methods, Overrides(params={"quilting_texture.block": "64"}), "skimage:brick")
    assert param(flow, "quilting_texture", "block") == 64


@pytest.mark.parametrize("methods", [["graph_cut", "quilting"], ["quilting", "graph_cut", "per_pixel"]])
def test_results_that_are_compared_have_one_size(methods: list[str]) -> None:
    """By default, that of the first method."""
    first = load_flow(find_flow(methods[0]))
    flow = comparison_flow(methods, Overrides(), "skimage:brick")
    for method in methods:
        assert param(flow, f"{method}_texture", "size") == param(first, "texture", "size")
    wrong = Overrides(params={"quilting_texture.size": "64"})
    with pytest.raises(
        InputError, match=r"all results must have one size, got .*quilting_texture\.size 64 x 64 px"
    ):
        comparison_flow(methods, wrong, "skimage:brick")


# -- sources that must be given


def test_a_source_that_is_required(folder: Path) -> None:
    flow = loaded(folder, METHOD.replace("exemplar: exemplar.png", "exemplar: required"))
    assert flow.missing == ("exemplar",)
    with pytest.raises(InputError, match=r"sources\.exemplar: required, as in: texloom run \S+ exemplar\.png"):
        Run(flow, Store(folder / "store"))
    overrides = Overrides({"exemplar": str(folder / "exemplar.png")})
    assert Run(load_flow(folder / "flow.yaml", overrides), Store(folder / "store")).plan()


def test_a_source_that_is_optional(folder: Path) -> None:
    """Without it the inputs that take it are left out."""
    text = METHOD.replace("exemplar: exemplar.png", "exemplar: exemplar.png, more: optional")
    flow = loaded(folder, text.replace("edges.strength}", "edges.strength, image: more}"))
    assert (flow.left_out, set(flow.sources)) == (("more",), {"exemplar"})
    assert set(flow.steps["structure"].inputs) == {"strength"}
    given = load_flow(folder / "flow.yaml", Overrides({"more": str(folder / "exemplar.png")}))
    assert given.left_out == ()
    assert str(given.steps["structure"].inputs["image"]) == "more"


@pytest.mark.parametrize(
    ("flow", "sources"),
    [
        ("fill", ("picture",)),
        ("inverse_reconstruct", ("texture", "control", "target")),
        ("resynthesise", ("texture", "control", "target")),
        ("per_pixel_control", ("texture", "control", "target")),
        ("energy_curve", ("texture", "control")),
        ("revise", ("texture", "exemplar", "region")),
        ("rectify", ("exemplar", "layout")),
    ],
)
def test_pictures_with_masks_and_controls_are_required(flow: str, sources: tuple[str, ...]) -> None:
    assert load_flow(find_flow(flow)).missing == sources


# -- include


@pytest.mark.parametrize(
    ("flow", "source", "param"),
    [
        ("photo_to_texture", "photo", "geometry"),
        ("photo_atlas", "photo", "geometry"),
        ("photo_completion", "photo", "geometry"),
        ("photo_to_photo", "scene", "place.geometry"),
        ("rectify_pieces", "exemplar", "pieces"),
    ],
)
def test_what_describes_an_example_is_not_applied_to_another_picture(
    folder: Path, flow: str, source: str, param: str
) -> None:
    path = find_flow(flow)
    assert load_flow(path).own_examples == ()
    with pytest.raises(InputError) as caught:
        load_flow(path, Overrides(sources={source: "exemplar.png"}))
    message = str(caught.value)
    assert message.startswith(f"sources.{source}: {param}: ")
    assert f"give --set {param}=FILE" in message
    geometry = folder / "mine.yaml"
    geometry.write_text("patches: []")
    load_flow(path, Overrides(sources={source: "exemplar.png"}, params={param: str(geometry)}))
    # nor to the picture of a flow that includes it
    including = f"include: {flow}\nsources: {{{source}: exemplar.png}}"
    assert f"sources.{source}: {param}: " in refusal(folder, including)


def test_a_document_of_the_including_flow_counts(folder: Path) -> None:
    (folder / "camera.yaml").write_text("patches: []")
    text = "include: photo_to_texture\nwith: {geometry: camera.yaml}"
    assert loaded(folder, text, sources={"photo": "exemplar.png"}).sources["photo"].endswith("exemplar.png")
    required = f"{text}\nsources: {{photo: required}}"
    assert loaded(folder, required, sources={"photo": "exemplar.png"}).missing == ()


def test_all_of_a_flow_is_taken(folder: Path) -> None:
    flow = loaded(folder, "include: method.yaml")
    alone = load_flow(folder / "method.yaml")
    assert flow.name == "flow"
    assert (flow.steps, flow.sources, flow.seeds, flow.exports) == (
        alone.steps, alone.sources, alone.seeds, alone.exports,
    )  # fmt: skip
    assert flow.params == alone.params
    assert flow.more_paths == (folder / "method.yaml",)


def test_what_an_including_file_changes(folder: Path) -> None:
    text = """
    include: method.yaml
    seed: 9
    with: {size: 64x48}
    sources: {exemplar: other.png}
    steps:
      texture: {inputs: {structure: null}, params: {method: blocks}}
      small: {stage: evaluation.thumbnail, inputs: {image: texture.image}}
    exports: {small.png: small.image, scores.json: null}
    """
    flow = loaded(folder, text)
    assert flow.seeds == (9,)
    assert flow.sources == {"exemplar": str(folder / "other.png")}
    assert set(flow.steps["texture"].inputs) == {"image"}
    assert param(flow, "texture", "size") == (48, 64)
    assert param(flow, "texture", "method") == "blocks"
    assert set(flow.exports) == {"texture.png", "small.png"}
    assert set(flow.steps) == {"texture", "small"}, "what nothing needs is left out"


def test_a_variant_gives_values_to_the_flow_that_it_includes(folder: Path) -> None:
    """Though the file has a param of that name, which reaches the steps of the merged flow."""
    text = """
    for:
      small: {include: method.yaml, with: {size: 32}}
      large: {include: method.yaml}
    steps:
      sheet: {stage: evaluation.thumbnail, inputs: {image: small_texture.image}}
      other: {stage: evaluation.thumbnail, inputs: {image: large_texture.image}}
    params: {size: [large_texture.size]}
    exports: {sheet.png: sheet.image, other.png: other.image}
    """
    flow = loaded(folder, text)
    assert param(flow, "small_texture", "size") == (32, 32)
    assert param(flow, "large_texture", "size") != (32, 32)
    assert flow.params["size"] == ("large_texture.size",)


def test_a_source_is_replaced_by_a_result(folder: Path) -> None:
    text = """
    include: {flow: method.yaml, inputs: {exemplar: part.image}}
    sources: {picture: exemplar.png}
    steps: {part: {stage: analysis.crop, inputs: {image: picture}, params: {size: 48}}}
    """
    flow = loaded(folder, text)
    assert set(flow.sources) == {"picture"}
    assert flow.steps["edges"].inputs == {"image": Reference("part", "image")}
    assert flow.steps["scores"].inputs["exemplar"] == Reference("part", "image")


def test_some_steps_are_taken(folder: Path) -> None:
    flow = loaded(
        folder, "include: {flow: method.yaml, steps: [structure]}\nexports: {it.png: structure.structure}"
    )
    assert set(flow.steps) == {"edges", "structure"}
    assert set(flow.exports) == {"it.png"}
    assert flow.params == {}


def test_steps_draw_as_in_their_own_flow(folder: Path) -> None:
    flow = loaded(folder, "include: method.yaml\nfor: {method: [pixels, blocks]}")
    assert {step.draws_as for step in flow.steps.values()} == {"edges", "structure", "texture", "scores"}
    named = loaded(
        folder, 'include: method.yaml\nfor: {method: [pixels, blocks]}\nsteps: {texture: {draws_as: "x_*"}}'
    )
    assert {named.steps[f"{method}_texture"].draws_as for method in ("pixels", "blocks")} == {
        "x_pixels",
        "x_blocks",
    }


def test_file_params_start_at_their_own_file(folder: Path) -> None:
    (folder / "sub").mkdir()
    (folder / "sub" / "forest.yml").touch()
    text = METHOD.replace(
        "inputs: {image: exemplar}}", "inputs: {image: exemplar}, params: {model: forest.yml}}", 1
    )
    (folder / "sub" / "method.yaml").write_text(text)
    flow = loaded(folder, "include: sub/method.yaml")
    assert param(flow, "edges", "model") == folder / "sub" / "forest.yml"
    assert flow.sources == {"exemplar": str(folder / "sub" / "exemplar.png")}


# -- variants


def test_only_what_differs_is_there_once_for_each(folder: Path) -> None:
    flow = loaded(folder, "include: method.yaml\nfor: {method: [pixels, blocks]}")
    assert list(flow.steps) == [
        "edges", "structure", "pixels_texture", "pixels_scores", "blocks_texture", "blocks_scores",
    ]  # fmt: skip
    assert set(flow.exports) == {
        "pixels_texture.png", "blocks_texture.png", "pixels_scores.json", "blocks_scores.json",
    }  # fmt: skip
    assert param(flow, "blocks_texture", "method") == "blocks"
    assert flow.params == {"size": ("pixels_texture.size", "blocks_texture.size")}


COMPARED = """
include: method.yaml
for:
  plain: {}
  blocks: {with: {method: blocks}, steps: {texture: {inputs: {structure: null}}}}
steps:
  compare: {stage: evaluation.compare, gather: {tables: {"*": scores.table}}}
exports:
  "*.png": texture.image
  compare.json: compare.table
"""


def test_what_receives_all_variants(folder: Path) -> None:
    flow = loaded(folder, COMPARED)
    gathered = {"plain": Reference("plain_scores", "table"), "blocks": Reference("blocks_scores", "table")}
    assert flow.steps["compare"].gather == {"tables": gathered}
    assert set(flow.exports) == {"plain.png", "blocks.png", "compare.json"}


def test_a_step_of_all_variants_is_changed_by_its_own_name(folder: Path) -> None:
    flow = loaded(folder, COMPARED, params={"texture.size": "24"})
    assert param(flow, "plain_texture", "size") == param(flow, "blocks_texture", "size") == (24, 24)
    flow = loaded(folder, COMPARED, params={"plain_texture.size": "24"})
    assert param(flow, "blocks_texture", "size") == (32, 40)


def test_params_that_some_variants_lack_are_refused(folder: Path) -> None:
    (folder / "other.yaml").write_text(METHOD.replace("texture", "start").replace("method: start.method", ""))
    text = "for: {one: {include: method.yaml}, two: {include: other.yaml}}"
    assert param(loaded(folder, text, params={"size": "24"}), "two_start", "size") == (24, 24)
    assert refusal(folder, text, params={"start.size": "24"}) == (
        "--set start.size: one has no step 'start'; name that of one, as two_start.size"
    )
    assert refusal(folder, text, params={"method": "blocks"}) == (
        "--set method: two has no such param; name that of one step, as one_texture.method"
    )


def test_a_param_whose_step_a_variant_does_not_need(folder: Path) -> None:
    (folder / "other.yaml").write_text(METHOD.replace("\nparams: {", "\nparams: {finest: edges.finest, "))
    text = "include: other.yaml\nfor: {bare: {steps: {texture: {inputs: {structure: null}}}}, whole: {}}"
    flow = loaded(folder, text, params={"finest": "3.0"})
    assert flow.params["finest"] == ("edges.finest",)
    assert param(flow, "edges", "finest") == 3.0


def test_variants_are_the_flow_itself(folder: Path) -> None:
    """Bit-identical, so that nothing is computed again."""
    store = Store(folder / "store")
    alone = Run(load_flow(folder / "method.yaml"), store)
    execute(alone, Events(), folder / "out")
    states = {plan.name: plan.state for plan in Run(loaded(folder, COMPARED), store).plan()}
    assert states["edges"] == states["plain_texture"] == states["plain_scores"] == "cached"
    assert states["blocks_texture"] == "run"


# -- rounds


CHAIN = """
include: {flow: method.yaml, steps: [texture], inputs: {exemplar: former.texture.image}}
repeat: 3
steps:
  trace: {stage: evaluation.traced_match, inputs: {match: texture.match, former: former.trace.match}}
params: {method: include, rounds: repeat}
exports: {texture.png: texture.image, "*_trace.exr": trace.match}
"""


def test_every_round_takes_the_result_of_the_former(folder: Path) -> None:
    flow = loaded(folder, CHAIN)
    assert flow.steps["round_1_edges"].inputs == {"image": Reference("exemplar")}
    assert flow.steps["round_3_edges"].inputs == {"image": Reference("round_2_texture", "image")}
    assert set(flow.steps["round_1_trace"].inputs) == {"match"}
    assert flow.steps["round_2_trace"].inputs["former"] == Reference("round_1_trace", "match")
    assert flow.exports["texture.png"] == Reference("round_3_texture", "image")
    assert {"round_1_trace.exr", "round_2_trace.exr", "round_3_trace.exr"} < set(flow.exports)
    assert [flow.steps[f"round_{index}_texture"].draws_as for index in (1, 2, 3)] == [
        "texture", "round_2_texture", "round_3_texture",
    ]  # fmt: skip


def test_the_number_of_rounds_and_the_method_are_params(folder: Path) -> None:
    (folder / "other.yaml").write_text(
        METHOD.replace("  structure:", "  unused:").replace(", structure: structure.structure", "")
    )
    params = {"rounds": "2", "method": str(folder / "other.yaml")}
    assert set(loaded(folder, CHAIN, params=params).steps) == {
        f"round_{index}_{step}" for index in (1, 2) for step in ("texture", "trace")
    }
    assert refusal(folder, CHAIN, params={"rounds": "0"}).endswith(
        "repeat: must be a whole number from 1 to 100, got 0"
    )
    assert "no such flow 'quiltin'; did you mean" in refusal(folder, CHAIN, params={"method": "quiltin"}).replace(
        "quiltin: no such flow", "no such flow 'quiltin'"
    )


@pytest.mark.parametrize("method", ["quilting", "hybrid", "near_regular", "per_pixel", "texture_optimisation"])
def test_a_sequence_of_any_method(method: str) -> None:
    overrides = Overrides(params={"method": method, "generations": "2", "size": "64"})
    flow = load_flow(find_flow("texture_sequence"), overrides)
    alone = load_flow(find_flow(method), Overrides(params={"size": "64"}))
    assert flow.steps["round_1_texture"].params == alone.steps["texture"].params
    assert flow.exports["texture.png"] == Reference("round_2_texture", "image")


@pytest.mark.parametrize("generations", [2, 5])
def test_the_sequences_of_any_methods(generations: int) -> None:
    params = {"methods": "quilting,graph_cut", "size": "64"} | ({"generations": "2"} if generations == 2 else {})
    flow = load_flow(find_flow("sequence_study"), Overrides(params=params))
    last = f"round_{generations}_sequence"
    gathered = {method: Reference(f"{method}_{last}", "table") for method in ("quilting", "graph_cut")}
    assert flow.steps["comparison"].gather["tables"] == gathered
    alone = load_flow(find_flow("quilting"), Overrides(params={"size": "64"}))
    assert flow.steps["quilting_round_1_texture"].params == alone.steps["texture"].params
    assert {"quilting.png", "graph_cut.png", "sequences.html"} <= set(flow.exports)
    with pytest.raises(InputError, match="no such flow; did you mean 'quilting'"):
        load_flow(find_flow("sequence_study"), Overrides(params={"methods": "quiltin"}))


def test_a_sequence_is_the_method_again_and_again(folder: Path) -> None:
    store, text = Store(folder / "store"), (ROOT / "configs" / "texture_sequence.yaml").read_text()
    text = text.replace("flow: self_tuning", "flow: method.yaml")
    run = Run(loaded(folder, text, params={"size": "64", "generations": "2"}), store)
    exports = execute(run, Events(), folder / "out")
    curves = json.loads(exports["curves.json"].read_text())
    assert curves["generations"] == 2
    assert len(curves["measures"]["contents"]["values"]) == 2
    alone = Run(load_flow(folder / "method.yaml", Overrides(params={"size": "64"})), store)
    assert {plan.name: plan.state for plan in alone.plan()}["texture"] == "cached"


# -- errors


WRONG = {
    "include: nothing": "include: nothing: no such flow",
    "include: metod.yaml": "include: metod.yaml: no such flow",
    "include: flow.yaml": "include: flow.yaml includes itself",
    "include: {flw: method.yaml}": "include.flw: unknown; did you mean 'flow'?",
    "include: {steps: [edges]}": "include: which flow? give its name or file as 'flow'",
    "include: {flow: method.yaml, steps: [edgse]}": "include.steps.0: no step 'edgse'; did you mean 'edges'?",
    "include: {flow: method.yaml, inputs: {exempler: a.b}}": (
        "include.inputs.exempler: the included flow has no source 'exempler'; did you mean 'exemplar'?"
    ),
    "include: {flow: method.yaml, inputs: {exemplar: prt.image}}": "include.inputs.exemplar: no step 'prt'; there",
    "include: method.yaml\nwith: {sise: 3}": "with.sise: the flow has no param 'sise'; did you mean 'size'?",
    "include: method.yaml\nwith: {size: 3}": "with.size: the side should be greater than or equal to 16, got 3",
    "include: method.yaml\nfor: {method: [pixels, square]}": "for: with.method: input should be 'lattice'",
    "include: method.yaml\nfor: {mthod: [pixels]}": "for: with.mthod: the flow has no param 'mthod'",
    "include: method.yaml\nfor: {a: {steps: {texture: {params: {sise: 3}}}}}": (
        "for.a.steps.texture.params.sise: no such param; did you mean 'size'?"
    ),
    "include: method.yaml\nfor: {a: {stesp: 3}}": "for.a.stesp: unknown; did you mean 'steps'?",
    "include: method.yaml\nfor: {a: {}, method: [pixels]}": "for.a: either lists of values or variants by label",
    "include: method.yaml\nfor: {method: [a, a]}": "for: two variants would be called 'a'",
    "include: method.yaml\nfor: {method: []}": "for.method: must list at least one value, got []",
    'include: method.yaml\nfor: {a: {}}\nsteps: {c: {stage: evaluation.compare, gather: {t: {"*": {b: 1}}}}}': (
        "steps.c.gather: '*' of {'b': 1} has no 'a'"
    ),
    f"include: method.yaml\nfor: {{size: {list(range(16, 20_016))}}}": (
        "for: 20000 variants, at most 1000 with those of included files"
    ),
    f"include: method.yaml\nfor: {{size: {list(range(16, 80))}, method: {list(range(20))}}}": (
        "for: 1280 variants, at most 1000 with those of included files"
    ),
    "include: method.yaml\nfor: {a: {}}\nrepeat: 2": "repeat: a flow has either 'for' or 'repeat'",
    "include: method.yaml\nrepeat: many": "repeat: must be a whole number from 1 to 100, got 'many'",
    'include: method.yaml\nexports: {"*.png": texture.image}': "exports.*.png: '*' is for the labels",
    "include: method.yaml\nsteps: {edges: {inputs: {image: former.texture.image}}}": "no step 'former'",
    "include: method.yaml\nsteps: {edges: {inputs: {imaeg: null}}}": (
        "steps.edges.inputs.imaeg: the step takes no 'imaeg' that could be left out; did you mean 'image'?"
    ),
    "include: method.yaml\nsteps: {edgse: {params: {}}}": "steps.edgse.stage: must name a stage, got nothing",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_compositions(folder: Path, text: str) -> None:
    message = refusal(folder, text)
    assert message.startswith("flow.yaml: ")
    assert WRONG[text] in message


def test_variants_of_included_variants_are_counted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.pipelines.flow.compose._MOST_VARIANTS", 40)
    inner = "include: {flow: method.yaml, steps: [structure]}\nrepeat: 10\n"
    (folder / "inner.yaml").write_text(inner)
    message = refusal(folder, "include: inner.yaml\nrepeat: 8\n")
    assert message == "inner.yaml: repeat: 48 variants, at most 40 with those of included files"


def test_steps_are_counted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.pipelines.flow.compose._MOST_STEPS", 7)
    assert refusal(folder, "include: method.yaml\nfor: {method: [pixels, patches]}").startswith(
        "flow.yaml: for: 8 steps, at most 7 in all variants and included files"
    )
    assert len(loaded(folder, "include: method.yaml").steps) == 4


def test_an_error_names_the_file_in_which_it_is(folder: Path) -> None:
    (folder / "method.yaml").write_text(METHOD.replace("edges.strength", "edges.strenght"))
    assert refusal(folder, "include: method.yaml").startswith(
        "method.yaml: steps.structure.inputs.strength: step 'edges'"
    )


def test_steps_of_all_variants_take_no_result_of_one(folder: Path) -> None:
    text = COMPARED.replace(
        'gather: {tables: {"*": scores.table}}', 'gather: {tables: {"*": scores.table}}, inputs: {a: scores.table}'
    )
    assert "the step runs once for all variants, but scores.table exists for each" in refusal(folder, text)
