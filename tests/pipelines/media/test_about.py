"""What is known of a picture file."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.media.about import about_material, about_picture
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.pipelines.store import codec
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def test_our_files_tell_whether_they_wrap(tmp_path: Path) -> None:
    image = Image(np.full((8, 8, 4), 0.25, np.float32), ("R", "G", "B", "height")).wrapping(True)
    codec.export(image, Image, tmp_path / "a.exr", {})
    codec.export(image, Image, tmp_path / "a.png", {})
    assert about_picture(tmp_path / "a.exr") == {
        "wraps": "both", "bits": 32, "range": {name: [0.25, 0.25] for name in image.channels}
    }  # fmt: skip
    known = about_picture(tmp_path / "a.png")
    assert (known["wraps"], known["bits"]) == ("both", 8)


def test_borders_of_other_files_are_measured(tmp_path: Path) -> None:
    ramp = np.arange(0, 64, 4, np.uint8)[:, None].repeat(16, 1)
    PIL.Image.fromarray(ramp).save(tmp_path / "wall_height.png")
    assert about_picture(tmp_path / "wall_height.png") == {
        "plausible_wraps": {axis: {"wraps": "unclear", "score": 0.0} for axis in "xy"},
        "bits": 8, "range": {"Y": [0.0, 0.2353]}, "role": "height",
    }  # fmt: skip


def test_materials_tell_what_their_files_say(tmp_path: Path) -> None:
    level = np.arange(64, dtype=np.uint8).reshape(8, 8)
    for name in ("albedo", "height"):
        PIL.Image.fromarray(level).save(tmp_path / f"{name}.png")
    PIL.Image.fromarray(np.dstack([level, level + 9, level + 100])).save(tmp_path / "normal_dx.png")
    PIL.Image.fromarray(level).save(tmp_path / "other.png")
    known = about_material(tmp_path)
    assert known["maps"] == {"normal": {"green": "down"}}
    unclear = dict.fromkeys("xy", "unclear")
    assert known["files"]["normal"] == {
        "file": "normal_dx.png", "bits": 8, "green": "down", "plausible_wraps": unclear,
        "plausible": "does not fit the height, see notes",
    }  # fmt: skip
    assert known["notes"][0] == "other.png ignored: the name is that of no map"
    assert known["plausible_green"]["green"] in ("up", "down", "does not fit the height")
    PIL.Image.fromarray(level).save(tmp_path / "roughness.png")
    PIL.Image.fromarray(level).save(tmp_path / "specular.png")
    known = about_material(tmp_path)
    assert "roughness: seems to be gloss" in known["notes"][-1]
    assert known["files"]["roughness"]["plausible"] == "see notes"
    assert "plausible" not in known["files"]["specular"]
    (tmp_path / "albedo.png").unlink()
    with pytest.raises(InputError, match="has no albedo"):
        about_material(tmp_path)


def test_what_texloom_wrote_of_size_and_tiling_is_told(tmp_path: Path) -> None:
    image = Image(np.random.default_rng(3).random((8, 8, 4), np.float32), ("R", "G", "B", "roughness")).wrapping(
        True
    )
    delivery = Delivery("unreal", texel_size=0.0005)
    write_layout(image, tmp_path, "moss", delivery, {"texel_size": 0.0005})
    for known in (about_material(tmp_path), about_picture(tmp_path / "T_moss_BC.png")):
        assert (known["texel_size"], known["wraps"]) == ("0.5 mm", "both")
    assert about_material(tmp_path)["files"]["albedo"]["wraps"] == "both"


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("none")
    with pytest.raises(InputError, match=r"a\.png: is not a picture"):
        about_picture(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"b\.png"):
        about_picture(tmp_path / "b.png")
