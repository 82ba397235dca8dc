"""What holds for a picture beside its pixels, and what every stage does with it."""

import ast
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import PIL.PngImagePlugin
import pytest

from tests.synthetic import identity, picture, smooth_noise
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import codec
from texloom.stages.lookup.registry import find_stage, shipped_stages
from texloom.stages.vocabulary import facts as vocabulary
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.facts import TORUS, UNKNOWN, Facts, MapFacts, Wraps
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.voted_patches import VotedPatches

SETS = {
    "synthesis.adaptive", "synthesis.bidirectional", "synthesis.coarse_target",
    "synthesis.collage", "synthesis.compact", "synthesis.graph_cut",
    "synthesis.hybrid", "synthesis.image_melding", "synthesis.near_regular",
    "synthesis.optimise", "synthesis.patch_based", "synthesis.per_pixel", "synthesis.quilting",
    "synthesis.reconstruct", "synthesis.regularised_patches",
}  # fmt: skip
"""stages whose result wraps where `tileable` asks for it"""
ALWAYS = {"synthesis.epitome", "synthesis.wang_tiles"}
"""stages whose result is a torus"""
KEEPS = {
    "analysis.ao_from_height", "analysis.height_from_colour", "analysis.height_from_normal",
    "analysis.normal_from_height", "analysis.roughness_from_colour",
    "analysis.exclusion_mask", "analysis.foreign_parts", "analysis.one_off_parts",
    "evaluation.choice", "evaluation.external_result", "synthesis.coarse_choice", "synthesis.either_way",
    "synthesis.gradient_domain",
    "synthesis.graded_statistics",
    "synthesis.inpaint", "synthesis.propagate_edit", "synthesis.refine", "synthesis.restore_tone",
    "synthesis.revise", "synthesis.whole_parts",
    "analysis.fitted_cells", "synthesis.scaled_maps",  # scaled pictures are sampled around their borders
}  # fmt: skip
"""stages whose result wraps where the picture that they change did"""
DROPS = {
    # parts of pictures, pictures that are laid otherwise, pictures of measurements
    "analysis.crop", "analysis.reduced", "analysis.straighten", "analysis.unroll", "analysis.unroll_hole",
    "analysis.patch_atlas",
    "analysis.lens_distortion", "analysis.photometric_stereo",
    "analysis.delight", "analysis.tone",  # unless it changes nothing: drift ends differently on opposite sides
    "analysis.between_joints", "analysis.level_surface",
    "analysis.control_direction", "analysis.deformed_lattice", "analysis.dog_mask", "analysis.feature_distance",
    "analysis.gaussian_stack", "analysis.jacobian_field", "analysis.orientation_field", "analysis.plane_proposal",
    "analysis.growth_guide", "analysis.progression",
    "analysis.surface_charts", "analysis.surface_control",
    "synthesis.exemplar_origin", "synthesis.exemplar_sheet",
    "synthesis.atlas", "synthesis.best_crop", "synthesis.coarse_level", "synthesis.compact_oriented",
    "synthesis.control_features",
    "synthesis.histogram_summary", "synthesis.initialise", "synthesis.layout", "synthesis.on_surface",
    "synthesis.place_texture", "synthesis.seam_carving", "synthesis.edge_sheets",
    "synthesis.tile_sheets", "synthesis.wang_borders",
    "synthesis.whole_periods",
    "synthesis.reapply",  # it wraps as the earlier result
    "evaluation.cell_plane", "synthesis.cell_texture",
    "evaluation.contact_sheet", "evaluation.endless_plane", "evaluation.energy_curve", "evaluation.hex_plane",
    "evaluation.lit_preview", "evaluation.sequence", "evaluation.size_curve",
    "evaluation.source_positions", "evaluation.surface_views", "evaluation.thumbnail", "evaluation.wang_tiling",
}  # fmt: skip
"""stages that return another picture than one that may repeat"""


def test_every_stage_that_returns_an_image_has_a_row() -> None:
    stages = {name: find_stage(name) for name in shipped_stages()}
    images = {name for name, one in stages.items() if any("Image" in str(hint) for hint in one.outputs.values())}
    rows = (SETS, ALWAYS, KEEPS, DROPS)
    assert set().union(*rows) == images
    assert sum(map(len, rows)) == len(images)
    assert all("tileable" in stages[name].params.model_fields for name in SETS)


def torus(side: int = 64) -> Image:
    return picture(smooth_noise((side, side), 2, np.random.default_rng(5)) * 0.1 + 0.5).wrapping(True)


def voted(exemplar: tuple[int, int]) -> VotedPatches:
    """A result of one pixel, of an exemplar of this size."""
    return VotedPatches(np.zeros((1, 1, 2), np.uint32), exemplar, 1, None, False, False, TORUS)


def edited(stage: str, image: Image) -> Image:
    """What a stage of `KEEPS` makes of a picture."""
    hole = np.zeros((image.height, image.width), bool)
    hole[20:30, 20:30] = True
    own, random = identity((image.height, image.width)), np.random.default_rng(3)
    relief = Image(np.dstack([image.pixels, image.pixels[..., 0]]), (*image.channels, "height"), image.facts)
    normal = np.zeros((*hole.shape, 3), np.float32) + np.float32([0, 0, 1])
    level = Image(np.dstack([image.pixels, normal]), (*image.channels, *NORMAL), image.facts)
    known = {"summary": {"fidelity": 1.0, "structure": 1.0}}
    calls: dict[str, dict[str, Any]] = {
        "analysis.ao_from_height": {"image": relief},
        "analysis.height_from_colour": {"image": image},
        "analysis.height_from_normal": {"image": level},
        "analysis.normal_from_height": {"image": relief},
        "analysis.roughness_from_colour": {"image": image},
        "analysis.exclusion_mask": {"image": image, "mask": picture(hole.astype(np.float32))},
        "analysis.fitted_cells": {"image": image, "generators": np.float32([[15, 0], [0, 15]])},
        "analysis.foreign_parts": {"image": image, "mask": picture(hole.astype(np.float32))},
        "analysis.one_off_parts": {"image": image},
        "evaluation.choice": {"first": image, "second": image, "first_scores": known, "second_scores": known},
        "evaluation.external_result": {"image": image},
        "synthesis.coarse_choice": {
            **dict.fromkeys(("texture", "plain", "guided"), image),
            "exemplar_guide": image.color,
            "params": Params(),
        },
        "synthesis.either_way": {"turning": {"chosen": ["turned"], "because": "asked"}, "turned": image},
        "synthesis.gradient_domain": {"exemplar": image, "image": image, "match": own},
        "synthesis.inpaint": {"image": image, "keep": ~hole},
        "synthesis.refine": {"image": image, "match": own, "exemplar": image, "rng": random},
        "synthesis.restore_tone": {"image": image, "control": image},
        "synthesis.scaled_maps": {"image": image, "votes": voted((60, 66))},
        "synthesis.whole_parts": {"exemplar": image, "image": image, "match": own, "kept": hole},
        "synthesis.graded_statistics": {
            "image": image,
            "match": own,
            "way": np.zeros(hole.shape, np.float32),
            "exemplars": image,
            "rectangles": np.array([[0, 0, *hole.shape]], np.int32),
            "original": None,
        },
        "synthesis.revise": {"texture": image, "exemplar": image, "region": picture(hole * 1.0), "rng": random},
    }
    options: dict[str, Any] = {
        "evaluation.choice": {"labels": ["a", "b"]},
        "analysis.fitted_cells": {"result": 64, "tileable": True},
        "synthesis.inpaint": {"block": 16},
        "synthesis.refine": {"rounds": 0, "preset": "fast"},
        "synthesis.revise": {"preset": "fast", "margin": 16},
        "synthesis.gradient_domain": {"maps": ["albedo"]},
    }
    declared = find_stage(stage)
    params = (
        {"params": declared.params.model_validate(options.get(stage, {}))} if declared.params.model_fields else {}
    )
    made: Image = declared.function(**calls[stage], **params).image
    return made


@pytest.mark.parametrize("stage", sorted(KEEPS - {"synthesis.propagate_edit"}))
def test_edits_keep_the_tiling(stage: str) -> None:
    assert edited(stage, torus()).wraps.both
    assert not edited(stage, torus().wrapping(False)).wraps


def test_parts_wrap_along_whole_sides() -> None:
    image = torus(16)
    assert str(image.cropped(slice(2, 9), slice(None)).wraps) == "x"
    assert str(image.cropped(slice(None), slice(1, 16)).wraps) == "y"
    assert image.cropped(slice(0, 16), slice(0, 16)).wraps.both
    assert image.with_pixels(image.pixels * 2).wraps.both
    assert not Image(image.pixels, image.channels).wraps


MAPS = {"normal": MapFacts(green="down"), "height": MapFacts(unit="mm", range=(-0.5, 12.0))}


def material(side: int = 24) -> Image:
    """A torus with normals and heights of which everything is known."""
    values = smooth_noise((side, side, 7), 2, np.random.default_rng(7)) * 0.1 + 0.5
    names = ("R", "G", "B", "normal.X", "normal.Y", "normal.Z", "height")
    return Image(values.astype(np.float32), names, Facts(TORUS, MAPS))


def test_every_fact_is_in_the_table_and_here() -> None:
    header = next(line for line in str(vocabulary.__doc__).splitlines() if line.startswith("| operation"))
    assert [f"`{field.name}`" for field in dataclasses.fields(Facts)] == header.strip("| ").split(" | ")[1:]
    default = MapFacts()
    for field in dataclasses.fields(MapFacts):
        assert any(getattr(one, field.name) != getattr(default, field.name) for one in MAPS.values())


def test_maps_keep_what_is_known_of_them() -> None:
    image = material()
    made = {
        "part": image.cropped(slice(2, 9), slice(3, 9)),
        "edit": image.with_pixels(image.pixels * 2),
        "turned": image.elsewhere(np.ascontiguousarray(np.rot90(image.pixels))),
        "synthesis": image.elsewhere(image.pixels[:5]).wrapping(True),
    }
    assert {name: one.facts.maps for name, one in made.items()} == dict.fromkeys(made, MAPS)
    assert not made["turned"].wraps
    assert made["synthesis"].wraps.both


def test_maps_that_are_left_out_take_their_facts_along() -> None:
    image = material()
    assert image.with_pixels(image.pixels[..., :3], ("R", "G", "B")).facts == Facts(TORUS)
    kept = image.elsewhere(image.pixels[..., [0, 1, 2, 6]], ("R", "G", "B", "height"))
    assert kept.facts == Facts(maps={"height": MAPS["height"]})


@pytest.mark.parametrize("stage", ["synthesis.quilting", "synthesis.initialise", "analysis.crop"])
def test_stages_hand_on_facts_of_maps(stage: str) -> None:
    declared = find_stage(stage)
    options = {"size": (16, 16)} | ({"block": 8} if stage == "synthesis.quilting" else {})
    more = {} if stage == "analysis.crop" else {"rng": np.random.default_rng(1)}
    made = declared.function(material(), params=declared.params(**options), **more).image
    assert made.facts == Facts(maps=MAPS)


def test_stages_make_no_picture_of_the_channels_of_another_one() -> None:
    """Which would forget its facts: `Image.elsewhere` and `Image.with_pixels` hand them on."""
    root = Path(str(vocabulary.__file__)).parents[1]
    found = []
    for file in root.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Image":
                channels = node.args[1] if len(node.args) == 2 else None
                if isinstance(channels, ast.Attribute) and channels.attr == "channels":
                    found.append(f"{file.relative_to(root)}:{node.lineno}")
    assert not found


def test_joined_maps_wrap_where_all_do() -> None:
    parts = [Facts(Wraps.of(name)) for name in ("both", "x", "both")]
    assert str(Facts.joined(parts).wraps) == "x"
    parts = [Facts(maps={role: known}) for role, known in MAPS.items()]
    assert Facts.joined(parts).maps == MAPS


@pytest.mark.parametrize("name", ["off", "x", "y", "both"])
def test_records_are_read_back(name: str) -> None:
    assert Facts.of(Facts(Wraps.of(name)).record()) == Facts(Wraps.of(name))
    assert Facts.of({"wraps": "perhaps"}) == Facts.of({"wraps": ["x"]}) == Facts.of({}) == UNKNOWN


def test_records_of_maps_are_read_back() -> None:
    assert Facts.of(Facts(TORUS, MAPS).record()) == Facts(TORUS, MAPS)
    assert Facts.of(material().facts.record()) == material().facts


@pytest.mark.parametrize(
    "record",
    [
        {"green": "left", "unit": "mile", "range": "0 1"},
        {"green": 1, "unit": ["m"], "range": [1.0, 0.0]},
        {"range": [0.0, float("nan")]},
        {"range": [False, True]},
        ["down"],
    ],
)
def test_damaged_records_say_nothing(record: Any) -> None:
    assert MapFacts.of(record) == MapFacts()
    assert Facts.of({"maps": record}).record() == {}


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_files_carry_facts_of_pictures_of_their_size(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"a.{suffix}"
    image = torus(16)
    codec.export(image, Image, file, {"seed": 3})
    assert open_source("a", str(file)).read().wraps.both
    codec.export(image.wrapping(False), Image, file, {"seed": 3})
    assert not open_source("a", str(file)).read().wraps


def test_an_exr_carries_facts_of_maps(tmp_path: Path) -> None:
    file = tmp_path / "a.exr"
    codec.export(material(), Image, file, {})
    assert open_source("a", str(file)).read().facts == Facts(TORUS, MAPS)


def test_a_cropped_png_with_our_text_does_not_wrap(tmp_path: Path) -> None:
    """Programs keep the texts of a PNG that they crop."""
    file = tmp_path / "a.png"
    codec.export(torus(16), Image, file, {"seed": 3})
    with PIL.Image.open(file) as opened:
        text = PIL.PngImagePlugin.PngInfo()
        text.add_itxt("texloom.provenance", opened.text["texloom.provenance"])
        opened.crop((0, 0, 9, 16)).save(file, pnginfo=text)
    assert not open_source("a", str(file)).read().wraps


def test_facts_decide_digests() -> None:
    @dataclasses.dataclass(frozen=True)
    class Made:
        image: Image

    one, other = (codec.digests(Made(torus(16).wrapping(wrap)))["image"] for wrap in (True, False))
    assert one != other
    digests = set()
    for field, value in (("green", "up"), ("unit", "m"), ("range", (0.0, 1.0))):
        known = Facts(maps={"height": MapFacts(**{field: value})})
        digests.add(codec.digests(Made(dataclasses.replace(material(), facts=known)))["image"])
    assert len(digests) == 3


def test_arrays_given_by_programs_carry_facts(tmp_path: Path) -> None:
    assert open_source("a", file_source(torus(16), tmp_path)).read().wraps.both
