"""The size of pixels, which exports state and which is read from them again."""

from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.flows import open_run, run_local
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.part import Part
from texloom.pipelines.media.sources import open_source

FLOW = """
flow: part
sources:
  NAME: FILE
steps:
  part: {stage: analysis.crop, inputs: {image: NAME}, params: {size: 16}}
exports:
  texture.png: part.image
  texture.exr: part.image
  maps/: part.image
DELIVERY"""
CODES = np.random.default_rng(3).integers(0, 256, (20, 20, 3)).astype(np.uint8)


def exported(folder: Path, source: str, name: str = "exemplar", size: str = "") -> Path:
    """The folder of the exports of a flow whose source has this name."""
    folder.mkdir()
    delivery = f"delivery: {{texel_size: {size}}}" if size else ""
    text = FLOW.replace("NAME", name).replace("FILE", source).replace("DELIVERY", delivery)
    (folder / "flow.yaml").write_text(text)
    run_local(open_run(folder / "flow.yaml"), folder / "out")
    return folder / "out"


@pytest.mark.parametrize("file", ["texture.png", "texture.exr", "maps/albedo.png", "maps"])
def test_a_run_keeps_the_texel_size_of_its_exemplar(tmp_path: Path, file: str) -> None:
    first = exported(tmp_path / "first", file_source(CODES, tmp_path), size="0.5mm")
    source = open_source("exemplar", str(first / file))
    assert source.texel_size == pytest.approx(5e-4)
    assert source.notes[-1].endswith("its header says that a pixel is 0.5 mm")
    assert source.taken(Part(reduce=0.5)).texel_size == pytest.approx(1e-3)
    again = exported(tmp_path / "again", str(first / file))
    assert open_source("exemplar", str(again / file)).texel_size == pytest.approx(5e-4)
    other = exported(tmp_path / "other", str(first / file), size="2mm")
    assert open_source("exemplar", str(other / file)).texel_size == pytest.approx(2e-3)
    photo = exported(tmp_path / "photo", str(first / file), name="photo")
    assert open_source("exemplar", str(photo / file)).texel_size is None
    two = f"{first / file}\n  exemplar: {file_source(CODES, tmp_path)}"  # as of revise: of what is edited
    edited = exported(tmp_path / "edited", two, name="texture")
    assert open_source("exemplar", str(edited / file)).texel_size == pytest.approx(5e-4)


def test_a_picture_that_was_scaled_says_nothing(tmp_path: Path) -> None:
    """By a program that keeps its text."""
    import PIL.Image
    from PIL.PngImagePlugin import PngInfo

    first = exported(tmp_path / "first", file_source(CODES, tmp_path), size="0.5mm")
    picture = PIL.Image.open(first / "texture.png")
    text = PngInfo()
    text.add_itxt("texloom.provenance", picture.info["texloom.provenance"])
    picture.save(tmp_path / "same.png", pnginfo=text)
    picture.resize((8, 8)).save(tmp_path / "small.png", pnginfo=text)
    assert open_source("exemplar", str(tmp_path / "same.png")).texel_size == pytest.approx(5e-4)
    assert open_source("exemplar", str(tmp_path / "small.png")).texel_size is None
