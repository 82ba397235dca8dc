"""The flows that make one result of several materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import texloom
from tests.pipelines.media.test_material_set import save
from tests.synthetic import blobs


@pytest.fixture
def materials(tmp_path: Path, rng: np.random.Generator) -> str:
    """Two with a height, one of them with a roughness too."""
    for name in ("moss", "stones"):
        folder = tmp_path / "materials" / name
        folder.mkdir(parents=True)
        colors = np.rint(blobs((48, 48, 3), rng) * 255).astype(np.uint8)
        save(folder / f"{name}_albedo.png", colors)
        save(folder / f"{name}_height.png", colors.mean(axis=2).astype(np.uint16) * 256)
    save(folder / "stones_roughness.png", colors[..., 0])
    return f"{tmp_path}/materials/*"


@pytest.mark.parametrize("flow", ["remix", "mix"])
def test_maps_of_several_materials_are_delivered_as_one(flow: str, materials: str, tmp_path: Path) -> None:
    texloom.run(
        flow, {"exemplars": materials}, params={"size": "64x48", "preset": "fast"}, layout="unreal",
        store=tmp_path / "store", out=tmp_path / "out",
    )  # fmt: skip
    assert {path.name for path in (tmp_path / "out" / "maps").glob("*.png")} == {
        "T_moss_stones_BC.png", "T_moss_stones_H.png",
    }  # fmt: skip
    texloom.run(
        flow, {"exemplars": materials}, params={"size": "64x48", "preset": "fast"}, layout="unreal",
        material="ground", store=tmp_path / "store", out=tmp_path / "named",
    )  # fmt: skip
    assert (tmp_path / "named" / "maps" / "T_ground_BC.png").is_file()
    texloom.run(
        flow, {"exemplars": materials}, params={"size": "64x48", "preset": "fast"}, store=tmp_path / "store",
        out=tmp_path / "plain",
    )  # fmt: skip
    assert {path.name for path in (tmp_path / "plain" / "maps").glob("*.png")} == {"albedo.png", "height.png"}


def test_a_layout_is_written_of_pictures_without_maps(tmp_path: Path, rng: np.random.Generator) -> None:
    """Also by flows whose folder of maps is of materials alone; without one there is none."""
    for name in ("sand", "soil", "grey"):
        save(tmp_path / f"{name}.png", np.rint(blobs((40, 40, 3), rng) * 255).astype(np.uint8))
    pictures = tuple(str(tmp_path / f"{name}.png") for name in ("sand", "soil"))
    asked = {"params": {"size": "40", "preset": "fast"}, "store": tmp_path / "store"}
    texloom.run("self_tuning", {"exemplar": pictures[0]}, layout="unity", out=tmp_path / "one", **asked)
    assert [path.name for path in (tmp_path / "one" / "maps").iterdir()] == ["sand_BaseMap.png"]
    texloom.run(
        "mix",
        {"exemplars": pictures, "map": str(tmp_path / "grey.png")},
        layout="unity",
        out=tmp_path / "two",
        **asked,
    )
    assert [path.name for path in (tmp_path / "two" / "maps").iterdir()] == ["sand_soil_BaseMap.png"]
    texloom.run("mix", {"exemplars": pictures}, out=tmp_path / "none", **asked)
    assert not (tmp_path / "none" / "maps").exists()
