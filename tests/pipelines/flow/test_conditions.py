"""Steps that are there only where a param has a value: what is skipped, what takes its place, what is refused."""

from pathlib import Path

import pytest

from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: base
sources:
  exemplar: exemplar.png
  mask: optional
steps:
  tone:
    stage: analysis.tone
    inputs: {image: exemplar}
    only: tone.even!=never
    when: {mask: {params: {even: never}}}
  edges: {stage: analysis.edges, inputs: {image: [tone.image, exemplar]}, params: {finest: 1.5}}
  wide: {stage: analysis.otsu, inputs: {strength: edges.strength}, only: edges.finest=3}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
  distance: {stage: analysis.signed_distance, inputs: {structure: [wide.structure, structure.structure]}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar, structure: [wide.structure, structure.structure]}}
  masked: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: mask}, only: mask}
params:
  even: tone.even
exports:
  distance.exr: distance.pixels
  start.exr: start.match
  wide.exr: wide.structure
  usable.png: masked.valid
"""


def loaded(folder: Path, text: str = FLOW, sources: dict[str, str] | None = None, **params: str) -> Flow:
    path = folder / "base.yaml"
    path.write_text(text)
    return load_flow(path, Overrides(sources=sources or {}, params=params))


def taken(flow: Flow, step: str) -> list[str]:
    return list(map(str, flow.steps[step].inputs.values()))


def test_a_step_is_there_where_a_param_has_a_value(tmp_path: Path) -> None:
    without, flow = loaded(tmp_path), loaded(tmp_path, **{"edges.finest": "3"})
    assert "wide" not in without.steps
    assert without.skipped["wide"].reason == "only with edges.finest=3"
    assert without.unwritten["wide.exr"] == ("edges.finest=3",)
    assert taken(without, "distance") == ["structure.structure"]
    assert taken(flow, "distance") == ["wide.structure"]
    assert "wide.exr" in flow.exports
    assert flow.skipped["structure"].reason == "nothing takes its result"


def test_a_step_may_be_left_out_by_its_own_param(tmp_path: Path) -> None:
    assert taken(loaded(tmp_path), "edges") == ["tone.image"]
    for given in ("even", "tone.even"):
        flow = loaded(tmp_path, **{given: "never"})
        assert taken(flow, "edges") == ["exemplar"]
        assert flow.skipped["tone"].reason == "only with tone.even!=never"
    assert taken(loaded(tmp_path, even="always"), "edges") == ["tone.image"]


def test_a_source_may_give_the_value(tmp_path: Path) -> None:
    sources = {"mask": "mask.png"}
    assert "tone" not in loaded(tmp_path, sources=sources).steps
    assert "tone" in loaded(tmp_path, sources=sources, even="auto").steps, "what is asked for counts"


def test_in_each_variant_its_own_param_counts(tmp_path: Path) -> None:
    loaded(tmp_path)
    (tmp_path / "both.yaml").write_text(
        "include: base.yaml\nfor: {fine: {}, broad: {steps: {edges: {params: {finest: 3}}}}}\n"
    )
    flow = load_flow(tmp_path / "both.yaml")
    assert "broad_wide" in flow.steps
    assert "fine_wide" in flow.skipped
    assert taken(flow, "broad_distance") == ["broad_wide.structure"]
    assert taken(flow, "fine_distance") == ["fine_structure.structure"]


@pytest.mark.parametrize(
    ("new", "problem"),
    [
        ("edge.width=3", "no step 'edge'; did you mean 'edges'?"),
        ("edges.finset=3", "stage analysis.edges has no param 'finset'; did you mean 'finest'?"),
        (
            "edges.finest=broad",
            "finest: input should be a valid number, unable to parse string as a number, got broad",
        ),
        ("tone.even=sometimes", "even: input should be 'auto', 'always' or 'never', got sometimes"),
        ("edges=3", "stage analysis.edges has no param ''"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, new: str, problem: str) -> None:
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, FLOW.replace("only: edges.finest=3", f"only: {new}"))
    assert f"steps.wide.only: {problem}" in str(refused.value)


def test_params_of_a_step_that_is_left_out_otherwise_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"--set wide.min_extent: step 'wide' is skipped: only with edges.finest=3"
    ):
        loaded(tmp_path, **{"wide.min_extent": "0.5"})
