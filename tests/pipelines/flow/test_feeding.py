"""Which sources feed a picture: they decide how many bits its PNG has."""

from pathlib import Path

import pytest

from texloom.pipelines.flow.feeding import feeding
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides, Reference
from texloom.stages.vocabulary.arrays import Image

CONFIGS = Path(__file__).parents[3] / "configs"
FED_BY_SEVERAL = {
    ("edit_by_compaction", "texture.png"): {"edited", "texture"},
    ("edit_by_compaction", "compaction.png"): {"edited", "texture"},
    ("photo_to_photo", "texture.png"): {"photo", "scene"},
    ("revise", "texture.png"): {"exemplar", "texture"},
    ("revise", "detail.png"): {"exemplar", "texture"},
    ("per_pixel_control", "control.png"): {"control"},
    ("inverse_frames", "control.png"): {"control"},
    ("joint_compaction", "control.png"): {"control"},
    ("resynthesise", "texture.png"): {"texture"},
    ("rectify", "texture.png"): {"exemplar"},
    ("fill", "texture.png"): {"picture"},
}


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_picture_of_every_flow_is_fed_by_a_source(path: Path) -> None:
    flow = load_flow(path)
    for file, reference in flow.exports.items():
        step = flow.steps.get(reference.name)
        if step is None or step.stage.outputs[reference.output or ""] is not Image:
            continue
        found = feeding(flow, reference)
        if (path.stem, file) in FED_BY_SEVERAL:
            assert found == FED_BY_SEVERAL[path.stem, file]
        elif file == "texture.png" or file.endswith("/"):
            first = {name for name in flow.sources if flow.kinds.get(name) != "mesh"} & found
            assert first, file


def test_what_steers_does_not_feed() -> None:
    given = {"mask": "skimage:brick", "control": "skimage:brick", "exemplar_guide": "skimage:brick"}
    flow = load_flow(CONFIGS / "self_tuning.yaml", Overrides(sources=given | {"target_guide": "skimage:brick"}))
    assert feeding(flow, flow.exports["texture.png"]) == {"exemplar"}
    assert feeding(flow, Reference("exemplar")) == {"exemplar"}
