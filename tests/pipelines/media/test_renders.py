"""Material sets as Blender shows them: all layouts of a material must give the same picture.

The interpreter that has `bpy` is named by TEXLOOM_BLENDER, as `bpy` needs another release of NumPy.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from tests.synthetic import blobs
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.stages.evaluation.lit_preview import LitPreviewParams, light_directions, lit
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL, unit

SIDE = 96
SHOWN = ("blender", "gltf", "unreal", "unity", "unity_standard", "godot", "arnold", "substance")
"""layouts that `render_sphere.py` shows as their programs do"""
BLENDER = os.environ.get("TEXLOOM_BLENDER") or (sys.executable if importlib.util.find_spec("bpy") else "")


@pytest.fixture
def material(rng: np.random.Generator) -> Image:
    """Smooth bumps, half of it metal."""
    height = blobs((64, 64), rng)
    down, across = np.gradient(np.pad(height, 1, mode="wrap"))
    normals = unit(np.stack([-across, down, np.full_like(down, 0.15)], axis=2)[1:-1, 1:-1].astype(np.float32))
    metallic = np.broadcast_to(np.arange(64) < 32, (64, 64))
    planes = [blobs((64, 64, 3), rng), normals, 0.2 + 0.6 * height[..., None], metallic[..., None]]
    return Image(
        np.concatenate(planes, axis=2, dtype=np.float32), ("R", "G", "B", *NORMAL, "roughness", "metallic")
    )


@pytest.mark.skipif(not BLENDER, reason="TEXLOOM_BLENDER names no interpreter with bpy")
def test_spheres_of_all_layouts_are_the_same(material: Image, tmp_path: Path) -> None:
    names = [name for name in SHOWN if name != "arnold" or importlib.util.find_spec("OpenImageIO")]
    for name in names:
        write_layout(material.wrapping(True), tmp_path / name, "moss", Delivery(name), {})
    signs = np.array([1, 1, 1, 1, -1, 1, 1, 1], np.float32)  # of green of the normals
    flipped = Image(material.pixels * signs, material.channels)
    write_layout(flipped.wrapping(True), tmp_path / "wrong" / "unreal", "moss", Delivery("unreal"), {})
    script = Path(__file__).with_name("render_sphere.py")
    for folder in (tmp_path, tmp_path / "wrong"):
        subprocess.run([BLENDER, str(script), str(folder), str(SIDE)], check=True, capture_output=True)

    def shown(file: str) -> np.ndarray:
        return np.asarray(PIL.Image.open(tmp_path / file).convert("RGB"), float)

    expected = shown("blender.png")
    assert expected.std() > 20
    differences = {name: np.abs(shown(f"{name}.png") - expected).mean() for name in names}
    assert max(differences.values()) < 1, differences
    assert np.abs(shown("wrong/unreal.png") - expected).mean() > 3


@pytest.mark.skipif(not BLENDER, reason="TEXLOOM_BLENDER names no interpreter with bpy")
@pytest.mark.parametrize("place", [0, 2])
def test_the_preview_is_what_blender_shows(material: Image, place: int, tmp_path: Path) -> None:
    """Of slopes that hide nothing; metal is brighter there, as its light is also reflected between microfacets."""
    normals = unit(material.pixels[..., 3:6] * np.array([1, 1, 5], np.float32))
    planes = [material.pixels[..., :3], normals, material.pixels[..., 6:]]
    gentle = Image(np.concatenate(planes, axis=2), material.channels)
    write_layout(gentle.wrapping(True), tmp_path, "moss", Delivery("blender"), {})
    lights = light_directions(4, 50.0)
    script = Path(__file__).with_name("render_plane.py")
    arguments = [str(tmp_path / "moss.usda"), "64", *map(str, lights[place]), str(tmp_path / "plane.npy")]
    subprocess.run([BLENDER, str(script), *arguments], check=True, capture_output=True)
    shown = np.load(tmp_path / "plane.npy").clip(0, 1)
    ours = [lit(gentle, light, LitPreviewParams(brightness=1, ambient=0)).clip(0, 1) for light in lights]

    def likeness(light: int, part: slice) -> float:
        return float(np.corrcoef(shown[:, part].ravel(), ours[light][:, part].ravel())[0, 1])

    metal, rest, whole = slice(32), slice(32, None), slice(None)
    assert likeness(place, rest) > 0.99
    assert likeness(place, metal) > 0.94
    assert max(likeness(light, whole) for light in range(4) if light != place) < 0.9
    assert shown[:, rest].mean() == pytest.approx(ours[place][:, rest].mean(), rel=0.03)
