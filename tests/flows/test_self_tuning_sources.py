"""The optional sources of `self_tuning`, and what flows that include it have of them."""

from typing import Any

import pytest

from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.stages.vocabulary.declare import InputError

ALL = ("mask", "exemplar_structure", "exemplar_guide", "target_guide", "strokes", "control")
PLAIN = (
    *(
        "margins",
        "tone",
        "offsets",
        "lattice",
        "parts",
        "edges",
        "structure",
        "distance",
        "guidance",
        "start",
        "texture",
    ),
    "scores",
)


def opened(flow: str = "self_tuning", *given: str, **fields: Any) -> Flow:
    sources = {name: f"{name}.png" for name in given}
    return load_flow(find_flow(flow), Overrides(sources={"exemplar": "moss.png", **sources}, **fields))


def taken(flow: Flow, step: str) -> dict[str, str]:
    return {name: str(reference) for name, reference in flow.steps[step].inputs.items()}


def test_alone_it_has_the_steps_that_it_always_had() -> None:
    flow = opened()
    assert set(flow.steps) == set(PLAIN)
    assert all(step.draws_as == name for name, step in flow.steps.items())
    assert {name: taken(flow, name) for name in ("tone", "distance", "start", "texture")} == {
        "tone": {"image": "exemplar", "foreign": "margins.foreign"},
        "distance": {"structure": "structure.structure"},
        "start": {"image": "parts.image", "structure": "structure.structure", "generators": "lattice.generators"},
        "texture": {
            "image": "parts.image",
            "start": "start.match",
            "guidance": "distance.field",
            "weight": "guidance.weight",
            "generators": "lattice.generators",
            "contours": "edges.strength",
        },
    }
    assert not flow.is_set
    assert set(flow.exports) == {"texture.exr", "texture.png", "scores.json", "one_off.png", "maps/"}


@pytest.mark.parametrize(
    ("given", "steps", "exports"),
    [
        (("exemplar_structure",), {"painted"}, set()),
        (("control",), {"toned"}, {"even.png"}),
        (("exemplar_structure", "control"), {"painted", "toned"}, {"even.png"}),
    ],
)
def test_a_source_adds_its_steps(given: tuple[str, ...], steps: set[str], exports: set[str]) -> None:
    alone, flow = opened(), opened("self_tuning", *given)
    assert set(flow.steps) == {*alone.steps, *steps}
    assert set(flow.exports) == {*alone.exports, *exports}


@pytest.mark.parametrize(
    ("given", "steps", "exports"),
    [
        (("mask",), {"clean"}, {"usable.png"}),
        (("exemplar_guide", "target_guide"), {"guide"}, set()),
        (("mask", "exemplar_structure", "control"), {"clean", "painted", "toned"}, {"usable.png", "even.png"}),
    ],
)
def test_with_a_mask_or_guides_nothing_is_searched_that_is_shown_once(
    given: tuple[str, ...], steps: set[str], exports: set[str]
) -> None:
    alone, flow = opened(), opened("self_tuning", *given)
    assert set(flow.steps) == {*alone.steps, *steps} - {"margins", "parts"}
    assert set(flow.exports) == {*alone.exports, *exports} - {"one_off.png"}
    assert taken(flow, "texture")["image"] == "tone.image"
    assert "parts" in opened("self_tuning", *given, params={"one_off": "leave_out"}).steps


@pytest.mark.parametrize(
    ("one_off", "steps", "image"),
    [
        ("auto", set(PLAIN), "texture.image"),
        ("leave_out", set(PLAIN), "texture.image"),
        ("keep_whole", {*PLAIN, "laid"}, "laid.image"),
        ("use", set(PLAIN) - {"margins", "parts"}, "texture.image"),
    ],
)
def test_what_happens_to_what_is_shown_once_decides_on_steps(one_off: str, steps: set[str], image: str) -> None:
    flow = opened(params={"one_off": one_off})
    assert set(flow.steps) == steps
    assert {str(flow.exports[name]) for name in ("texture.exr", "texture.png")} == {image}
    assert taken(flow, "scores")["image"] == image
    assert str(opened("materials", params={"parts.one_off": one_off}).steps["material"].inputs["image"]) == image


def test_strokes_take_the_place_of_the_lattice() -> None:
    flow = opened("self_tuning", "strokes")
    assert set(flow.steps) == {*PLAIN, "orientation", "wanted", "along"} - {"offsets", "lattice"}
    assert {"generators"}.isdisjoint({*taken(flow, "start"), *taken(flow, "texture")})
    assert dict(flow.steps["start"].params)["size"] is None
    assert dict(opened("self_tuning", "strokes", params={"size": "64"}).steps["start"].params)["size"] == (64, 64)


def test_guides_and_strokes_exclude_each_other() -> None:
    with pytest.raises(InputError, match="--source strokes: cannot be given with exemplar_guide and target_guide"):
        opened("self_tuning", "exemplar_guide", "target_guide", "strokes")


@pytest.mark.parametrize(
    ("flow", "sources"),
    [
        ("self_tuning", set(ALL)),
        ("self_tuning_report", set(ALL)),
        ("materials", set(ALL) - {"control"}),
        ("refine", {"mask", "exemplar_structure"}),
        ("photo_self_tuning", {"mask", "strokes", "control"}),
        ("photo_material", {"mask", "strokes"}),
        ("wang_tiles", {"mask", "exemplar_structure"}),
        ("fill", {"holes"}),
        *((flow, set()) for flow in ("rectify", "make_tileable", "revise", "photo_atlas", "photo_flattening")),
        *((flow, set()) for flow in ("photo_completion", "ablation", "guidance_study")),
    ],
)
def test_flows_have_the_sources_that_make_sense(flow: str, sources: set[str]) -> None:
    assert set(load_flow(find_flow(flow)).optional) == sources


def test_a_set_has_a_table() -> None:
    assert set(opened(seeds=2).exports) - set(opened().exports) == {"table.csv", "table.json"}
