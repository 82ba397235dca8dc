"""Layouts of materials: what is written is read back as it was."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest

from texloom.pipelines.media.conventions import COLORS, LAYOUTS, ROLES, role_of
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import channels_of
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.normals import NORMAL, unit

SIDES = (16, 24)
CHANNELS = (
    *("R", "G", "B", *NORMAL),
    *(role for role in ROLES if role not in (*COLORS, "normal", "mask")),
    *(f"{role}.{letter}" for role in ("emissive", "translucency") for letter in "RGB"),
)
FORMS = [name for name, one in LAYOUTS.items() if one.kind == "png" or importlib.util.find_spec("OpenImageIO")]


@pytest.fixture
def material(rng: np.random.Generator) -> Image:
    """A material with all maps but a mask."""
    pixels = rng.random((*SIDES, len(CHANNELS)), np.float32)
    pixels[..., 3:6] = unit(pixels[..., 3:6] * [2, 2, 1] - [1, 1, -0.2])
    return Image(pixels, CHANNELS)


def without_text(folder: Path) -> None:
    """Leave nothing in PNGs that says what they are."""
    for path in folder.glob("*.png"):
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert values is not None
        assert cv2.imwrite(str(path), values)


@pytest.mark.parametrize("is_silent", [False, True])
@pytest.mark.parametrize("name", FORMS)
def test_what_a_layout_writes_is_read_back(material: Image, tmp_path: Path, name: str, is_silent: bool) -> None:
    layout, folder = LAYOUTS[name], tmp_path / "moss"
    write_layout(material, folder, "moss", Delivery(name), {})
    if is_silent:
        without_text(folder)
    source = open_source("exemplar", str(folder))
    again = source.read()
    held = {
        role_of(plane)[0]: part.bits
        for part in layout.written
        for plane in part.planes
        if plane and channels_of(role_of(plane)[0], material.channels)
    }
    assert {one.role for one in source.maps} == set(held)
    for role, bits in held.items():
        for channel in channels_of(role, material.channels):
            wanted, found = (one.pixels[..., one.channels.index(channel)] for one in (material, again))
            if role == "normal" and not again.facts.of_map(role).green and channel == NORMAL[1]:
                found = found * np.sign((wanted * found).sum())
            if role in COLORS and layout.kind == "png":
                wanted, found = srgb_from_linear(wanted), srgb_from_linear(found)
            most = 2**bits - 1 if layout.kind == "png" else 2**10
            tolerance = (1.2 if role == "normal" else 0.51) / most
            np.testing.assert_allclose(found, wanted, atol=tolerance, err_msg=f"{role} {channel}")
