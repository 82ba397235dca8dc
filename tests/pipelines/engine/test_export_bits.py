"""The bits of exported pictures, and what is told of values that they cannot hold."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.pipelines.flows import open_run, run_local
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.material_export import write_maps
from texloom.pipelines.media.writers.writer_registry import WriteJob, write
from texloom.pipelines.store import codec
from texloom.stages.vocabulary.arrays import Image

FLOW = """
flow: part
sources:
  exemplar: EXEMPLAR
  guide: GUIDE
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}}
  other: {stage: analysis.crop, inputs: {image: guide}, params: {size: 16}}
exports:
  texture.png: part.image
  guide.png: other.image
"""
CODES = np.random.default_rng(3).integers(0, 256, (20, 20, 3)).astype(np.uint8)


def exported(folder: Path, exemplar: np.ndarray) -> tuple[dict[str, np.dtype], list[str]]:
    """The types of the pictures that the flow writes, of which one comes from 8 bits, and what was told."""
    sources = {"EXEMPLAR": file_source(exemplar, folder), "GUIDE": file_source(CODES, folder)}
    text = FLOW
    for word, file in sources.items():
        text = text.replace(word, file)
    (folder / "flow.yaml").write_text(text)
    told = run_local(open_run(folder / "flow.yaml"), folder / "out")
    values = {
        name: cv2.imread(str(folder / "out" / name), cv2.IMREAD_UNCHANGED) for name in ("texture.png", "guide.png")
    }
    return {name: picture.dtype for name, picture in values.items() if picture is not None}, told.notes


def test_a_picture_has_the_bits_of_what_it_is_made_from(tmp_path: Path) -> None:
    """Also where a step of the same result was stored in a run of 8 bits, and the other way round."""
    assert exported(tmp_path, CODES) == ({"texture.png": np.uint8, "guide.png": np.uint8}, [])
    deep = CODES * np.uint16(257)  # the same light
    assert exported(tmp_path, deep) == ({"texture.png": np.uint16, "guide.png": np.uint8}, [])
    assert exported(tmp_path, CODES)[0]["texture.png"] == np.uint8
    assert exported(tmp_path, deep / np.float32(2**16))[0]["texture.png"] == np.uint16


def test_what_is_cut_off_is_told(tmp_path: Path) -> None:
    bright = np.full((20, 20, 3), 0.5, np.float32)
    bright[2:10] = 3
    _, notes = exported(tmp_path, bright)
    assert len(notes) == 1
    assert notes[0].startswith("texture.png: albedo: 50.0 % of the values are outside of 0..1 and were cut off")
    assert "(0.0 % below 0, 50.0 % above 1, range 0.5 .. 3)" in notes[0]
    written = (tmp_path / "out" / "texture.png").stat().st_mtime_ns
    assert exported(tmp_path, bright)[1] == notes  # also where the file is left as it is
    assert (tmp_path / "out" / "texture.png").stat().st_mtime_ns == written


def test_what_is_cut_off_is_told_once_of_a_picture(tmp_path: Path) -> None:
    bright = np.full((20, 20, 3), 0.5, np.float32)
    bright[2:10] = 3
    source = file_source(bright, tmp_path)
    text = FLOW.replace("  guide: GUIDE\n", "").replace("EXEMPLAR", source)
    text = text.replace("{image: guide}", "{image: exemplar}").replace("size: 16}}\nexports", "size: 12}}\nexports")
    (tmp_path / "flow.yaml").write_text(f"{text}  a.tif: part.image\n  maps/: part.image\n  a.jpg: part.image\n")
    for _ in range(2):  # written, and left as they are
        told = run_local(open_run(tmp_path / "flow.yaml"), tmp_path / "out")
        notes = [note for note in told.notes if "were cut off" in note]
        assert [note.partition(": albedo: ")[0] for note in notes] == [
            "texture.png, a.tif, maps, a.jpg",
            "guide.png",
        ]


def test_maps_and_8_bits_tell_too(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pixels = np.full((8, 8, 4), 0.5, np.float32)
    pixels[:2, :, 3] = -0.01  # m
    image = Image(pixels, ("R", "G", "B", "height"))
    with caplog.at_level(logging.WARNING):
        write_maps(image, tmp_path / "maps", (), {})
        codec.export(image, Image, tmp_path / "a.png", {})
        codec.export(image, Image, tmp_path / "a.exr", {})
    (told,) = [record.getMessage() for record in caplog.records]
    assert told.startswith("height: 25.0 % of the values are outside of 0..1")
    assert "heights from 0 to 1, and their scale" in told
    pixels[0, 0, 0] = 1.5
    with caplog.at_level(logging.WARNING):
        codec.export(image, Image, tmp_path / "a.png", {})
    assert caplog.records[-1].getMessage().startswith("colour: 0.5 % of the values")


MAPS = """
flow: maps
sources: {exemplar: EXEMPLAR}
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}}
exports:
  maps/: part.image
  texture.png: part.image
  bound.usda: part.image
  all.exr: part.image
"""


@pytest.mark.parametrize("layout", [None, "unreal", "substance"])
@pytest.mark.parametrize("deep", ["albedo", "roughness", "normal"])
def test_each_map_has_the_bits_of_what_feeds_it(tmp_path: Path, deep: str, layout: str | None) -> None:
    """Also in layouts, in documents, and where an EXR of texloom is the exemplar."""
    for role, codes in (("albedo", CODES), ("roughness", CODES[..., 0]), ("normal", CODES)):
        (tmp_path / "moss").mkdir(exist_ok=True)
        values = codes * np.uint16(257) if role == deep else codes
        assert cv2.imwrite(str(tmp_path / "moss" / f"{role}.png"), values)
    delivery = "" if layout is None else f"delivery: {{layout: {layout}}}\n"
    (tmp_path / "flow.yaml").write_text(MAPS.replace("EXEMPLAR", "moss") + delivery)
    run_local(open_run(tmp_path / "flow.yaml"), tmp_path / "out")
    (tmp_path / "again.yaml").write_text(MAPS.replace("EXEMPLAR", "out/all.exr") + delivery)
    run_local(open_run(tmp_path / "again.yaml"), tmp_path / "again")
    suffixes = {"unreal": ("BC", "ORM", "N"), "substance": ("basecolor", "roughness", "normal")}
    names = dict(zip(("albedo", "roughness", "normal"), suffixes.get(layout or "", ()), strict=False))
    for out in (tmp_path / "out", tmp_path / "again"):
        for role in ("albedo", "roughness", "normal"):
            found = list((out / "maps").glob(f"*{names.get(role, role)}.png"))
            assert len(found) == 1
            picture = cv2.imread(str(found[0]), cv2.IMREAD_UNCHANGED)
            assert picture is not None
            always = layout == "substance" and role == "normal"
            assert picture.dtype == (np.uint16 if role == deep or always else np.uint8), found[0]
        texture = cv2.imread(str(out / "texture.png"), cv2.IMREAD_UNCHANGED)
        assert texture is not None
        assert texture.dtype == (np.uint16 if deep == "albedo" else np.uint8)
    rough = cv2.imread(str(tmp_path / "out" / "bound_maps" / "bound_roughness.png"), cv2.IMREAD_UNCHANGED)
    assert rough is not None
    assert rough.dtype == (np.uint16 if deep == "roughness" else np.uint8)


def test_files_of_8_bits_tell_that_levels_are_lost(tmp_path: Path) -> None:
    source = file_source(CODES * np.uint16(257), tmp_path)
    text = MAPS.replace("EXEMPLAR", source).partition("exports:")[0]
    (tmp_path / "flow.yaml").write_text(f"{text}exports: {{a.jpg: part.image, a.tif: part.image}}\n")
    told = run_local(open_run(tmp_path / "flow.yaml"), tmp_path / "out")
    assert told.notes == ["a.jpg: colour of 16 bits has 8 in .jpg; .png, .tif and .exr hold more"]


def test_a_dropped_alpha_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pixels = np.ones((8, 8, 4), np.float32)
    with caplog.at_level(logging.WARNING):
        write(WriteJob(tmp_path / "opaque.jpg", Image(pixels, ("R", "G", "B", "A")), Image, {}))
        pixels[:2, :, 3] = 0.2
        write(WriteJob(tmp_path / "holes.jpg", Image(pixels, ("R", "G", "B", "A")), Image, {}))
    (told,) = [record.getMessage() for record in caplog.records]
    assert told == "alpha is dropped, which JPEG cannot hold; 25.0 % of the pixels have some"
