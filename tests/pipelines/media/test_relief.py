"""Heights that integers cannot hold: normalised, with scale and offset in documents, and read back."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import cv2
import MaterialX
import numpy as np
import pytest

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import write_maps
from texloom.pipelines.media.relief import Relief, relief_of
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.writers import glb
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Facts, MapFacts

CM = Facts(maps={"height": MapFacts(unit="cm", range=(-2.0, 3.0))})


def material(heights: np.ndarray, facts: Facts = CM) -> Image:
    pixels = np.full((*heights.shape, 4), 0.5, np.float32)
    pixels[..., 3] = heights
    return Image(pixels, ("R", "G", "B", "height"), facts)


@pytest.fixture
def heights(rng: np.random.Generator) -> np.ndarray:
    values = rng.uniform(-2, 3, (12, 14)).astype(np.float32)
    values[0, :2] = -2, 3
    return values


@pytest.mark.parametrize(
    ("range_", "values", "expected"),
    [
        (None, (0.0, 1.0), Relief()),
        (None, (-0.01, 1.02), Relief()),  # integrated
        ((0.0, 1.0), (-0.01, 1.02), Relief()),
        (None, (-0.5, 0.5), Relief(-0.5, 0.5, "m")),
        ((-0.5, 0.5), (0.0, 0.5), Relief(0.0, 0.5, "m")),
        ((0.0, 0.018), (0.0, 0.018), Relief(0.0, 0.018, "m")),  # 12 bits would be lost
        ((300.0, 300.0), (300.0, 300.0), Relief(300.0, 301.0, "m")),
    ],
)
def test_which_heights_are_normalised(
    range_: tuple[float, float] | None, values: tuple[float, float], expected: Relief
) -> None:
    facts = Facts(maps={"height": MapFacts(range=range_)})
    found = relief_of(material(np.array([values], np.float32), facts))
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert found.unit == expected.unit


def test_maps_hold_all_levels_and_are_read_back(
    tmp_path: Path, heights: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        write_maps(material(heights), tmp_path, (), {})
    (told,) = [record.getMessage() for record in caplog.records]
    assert told.startswith("height: -2 .. 3 cm became 0..1 in PNG")
    levels = cv2.imread(str(tmp_path / "height.png"), cv2.IMREAD_UNCHANGED)
    assert levels is not None
    assert levels.dtype == np.uint16
    assert (levels.min(), levels.max()) == (0, 65535)
    (tmp_path / "material.exr").unlink()
    again = open_source("exemplar", str(tmp_path)).read()
    assert np.abs(again.pixels[..., 3] - heights).max() < 5 / 65535
    assert again.facts.of_map("height") == CM.of_map("height")


def test_documents_make_metres_of_the_levels(tmp_path: Path, heights: np.ndarray) -> None:
    """-2 cm of black, 5 cm more of white."""
    image = material(heights)
    write_maps(image, tmp_path / "maps", (), {})
    document = MaterialX.createDocument()
    MaterialX.readFromXmlFile(document, str(tmp_path / "maps" / "material.mtlx"))
    (displacement,) = document.getNodes("displacement")
    scale = displacement.getInputValue("scale")
    offset = displacement.getConnectedNode("displacement").getInputValue("in2")
    assert scale == pytest.approx(0.05)
    assert offset * scale == pytest.approx(-0.02)
    write_layout(image, tmp_path, "moss", Delivery("blender"), {})
    text = (tmp_path / "moss.usda").read_text()
    assert "inputs:scale = (0.05, 0.05, 0.05, 1)" in text
    assert "inputs:bias = (-0.02, -0.02, -0.02, 0)" in text
    wanted = {"black": -2.0, "white": 3.0, "unit": "cm", "scale_m": 0.05, "bias_m": -0.02}
    write_layout(image, tmp_path, "moss", Delivery("unreal"), {})
    assert json.loads((tmp_path / "T_moss_height.json").read_text()) == pytest.approx(wanted)
    content = glb.binary("moss", image, Delivery())
    length = int.from_bytes(content[12:16], "little")
    (material_,) = json.loads(content[20 : 20 + length])["materials"]
    assert material_["extras"]["height"] == pytest.approx(wanted)


def test_heights_without_a_unit_are_a_share_of_the_width(tmp_path: Path) -> None:
    """All channels have the scale, although one is read: Blender takes the mean of red, green and blue."""
    image = material(np.linspace(0, 1, 168, dtype=np.float32).reshape(12, 14), Facts())
    written = write_layout(image, tmp_path, "moss", Delivery("blender", texel_size=0.1), {})
    text = (tmp_path / "moss.usda").read_text()
    assert "inputs:scale = (0.07, 0.07, 0.07, 1)" in text
    assert "inputs:bias = (0, 0, 0, 0)" in text
    assert not any(name.endswith(".json") for name in written)
