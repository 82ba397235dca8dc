"""Descriptions of stages and flows."""

from __future__ import annotations

import json
import re
from typing import Annotated, Literal

import pytest
from pydantic import Field

from tests.conftest import ROOT
from texloom.pipelines.cli.describe import (
    _worded,
    catalogue,
    description,
    explained,
    flow_description,
    flow_explained,
)
from texloom.pipelines.flow.shipped import GROUPS, flow_catalogue
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary.declare import Document, InputError, InputFile, OddSize

NAMES = stage_names()


def test_every_stage_has_a_summary() -> None:
    summaries = catalogue()
    assert tuple(summaries) == NAMES
    assert all(summary.endswith(".") and "\n" not in summary for summary in summaries.values())


@pytest.mark.parametrize("name", NAMES)
def test_all_that_is_declared_is_described(name: str) -> None:
    stage, described = find_stage(name), description(name)
    assert json.loads(json.dumps(described, allow_nan=False)) == described
    assert described["name"] == name
    assert set(described["inputs"]) == set(stage.inputs)
    assert set(described["outputs"]) == set(stage.outputs)
    assert set(described["params"]) == set(stage.params.model_fields)
    assert {key for key, entry in described["inputs"].items() if entry["optional"]} == stage.optional
    assert all(entry["what"] for part in ("params", "outputs") for entry in described[part].values())
    for head in ("Parameters", "References"):
        assert head not in described["description"]


@pytest.mark.parametrize("name", NAMES)
def test_defaults_are_those_that_count(name: str) -> None:
    """Also where a preset fills them in."""
    stage = find_stage(name)
    defaults = {key: entry["default"] for key, entry in description(name)["params"].items()}
    assert stage.params.model_validate(defaults) == stage.params()
    assert defaults == stage.params().model_dump(mode="json")


@pytest.mark.parametrize("name", NAMES)
def test_the_text_has_every_name_and_no_word_of_python(name: str) -> None:
    described = description(name)
    text = explained(described)
    for part in ("inputs", "params", "outputs"):
        for key in described[part]:
            assert f"\n  {key}: " in text
    assert described["summary"] in text
    for word in ("Annotated", "Literal", "FieldInfo", "typing", "None", "True", "False", "Optional"):
        assert word not in re.split(r"\n(?:no )?params", text)[-1].split("\noutputs")[0]
    assert max(map(len, text.splitlines())) < 130


def test_what_a_docstring_says_of_an_input_stands_with_it() -> None:
    described = description("guidance_weight")
    inputs = described["inputs"]
    assert inputs["distance"]["what"] == "signed distance to features, px, positive outside; see `signed_distance`."
    assert inputs["image"]["what"] == "the exemplar."
    assert described["description"].startswith("If these colours form several groups")
    assert "distance: float32 array (h w)\n      signed distance to features, px" in explained(described)
    assert "Raises\n------\nInputError" in description("crop")["description"]
    inputs = description("hole_window")["inputs"]
    assert inputs["hole"]["what"] == inputs["jacobian"]["what"] == "see `jacobian_field`."


def test_flows_are_listed_and_explained() -> None:
    assert all(entry.group in GROUPS for entry in flow_catalogue().values())
    summaries = {name: entry.about for name, entry in flow_catalogue().items()}
    assert set(summaries) == {path.stem for path in (ROOT / "configs").glob("*.yaml")}
    assert all(summary and "\n" not in summary and not summary.startswith("#") for summary in summaries.values())
    assert summaries["graph_cut"].endswith("least visible seam.")
    flow = flow_description("inverse")
    assert json.loads(json.dumps(flow)) == flow
    assert flow["sources"] == {"texture": "skimage:gravel", "control": "optional"}
    assert flow["params"]["size"]["targets"] == ["compact.size"]
    assert flow["steps"]["compact"]["stage"] == "synthesis.compact"
    assert flow["exports"]["texture.exr"] == "compact.image"
    assert flow_description("joint_compaction")["sources"]["texture"].endswith("/textures/*_color.png")
    text = flow_explained(flow)
    assert "A control map that comes with the texture is summarised too;" in text.replace("\n  ", " "), (
        "sentences are joined"
    )
    assert "\n    texloom run inverse rust.png --source control=wetness.png --size 128" in text
    for words in ("texture  skimage:gravel", "compact     synthesis.compact: ", "energy.json  compact.energy"):
        assert f"\n  {words}" in text
    sizes = "N | WIDTHxHEIGHT >= 1 | float > 0 < 1 | auto"
    assert f"\n  size: {sizes} = 128x128  [compact.size]\n      size" in text
    sequence = flow_explained(flow_description("texture_sequence"))
    assert "\n  generations: int >= 1 <= 100 = 5  [repeat]\n" in sequence
    assert "\n  method: a flow's name or file = self_tuning  [include]\n" in sequence
    with pytest.raises(InputError, match="did you mean 'inverse'"):
        flow_description("inverze")


def test_a_stage_is_found_without_its_group() -> None:
    assert description("otsu") == description("analysis.otsu")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ostu", "no stage 'ostu'; did you mean 'analysis.otsu'?"),
        ("synthesis.ostu", "no stage 'synthesis.ostu'; did you mean 'analysis.otsu'?"),
        ("zzzz", "no stage 'zzzz'; `texloom stages` lists them"),
        ("", "no stage ''; `texloom stages` lists them"),
        ("kernels.threads", "no stage 'kernels.threads'; `texloom stages` lists them"),
    ],
)
def test_no_such_stage(name: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        description(name)
    assert caught.value.args[0].startswith(message)


def test_limits_and_seed() -> None:
    described = description("synthesis.initialise")
    assert described["uses_seed"]
    assert described["params"]["tries"]["range"] == ">= 1, <= 100"
    assert described["params"]["method"]["type"] == "lattice | blocks | pixels"
    assert not description("analysis.otsu")["uses_seed"]
    assert "random: no" in explained(description("analysis.otsu"))
    assert "[Otsu1979]_" in description("analysis.otsu")["references"]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (int, "int"),
        (float, "float"),
        (bool, "true | false"),
        (str, "text"),
        (InputFile, "file"),
        (InputFile | None, "file | null"),
        (Document | None, "file | null"),
        (float | None, "float | null"),
        (Literal["a", "b"], "a | b"),
        (tuple[int, int], "[int, int]"),
        (tuple[float, ...], "[float, ...]"),
        (list[str], "[text]"),
        (Annotated[int, Field(ge=1, le=9)], "int >= 1 <= 9"),
        (OddSize, "int >= 1"),
        (tuple[Annotated[int, Field(gt=2)], bool], "[int > 2, true | false]"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_types_as_a_user_writes_them(kind: object, words: str) -> None:
    assert _worded(kind) == words
