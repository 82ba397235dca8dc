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
        f"T_{flow}_BC.png", f"T_{flow}_H.png",
    }  # fmt: skip
