"""Conventions that the content of maps contradicts, on surfaces whose truth is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from texloom.pipelines.media.sources import open_source
from texloom.stages.vocabulary.color import srgb_from_linear

SIDES = (96, 112)


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Heights, 0..1, and their normals, green up."""
    height = gaussian_filter(np.random.default_rng(5).random(SIDES), 3, mode="wrap")
    height = (height - height.min()) / np.ptp(height)
    down, across = (np.roll(height, -1, axis) - np.roll(height, 1, axis) for axis in (0, 1))
    normals = np.dstack([-5 * across, 5 * down, np.ones(SIDES)])
    return height, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def told(folder: Path, normal: np.ndarray | None = None, **maps: np.ndarray) -> tuple[str, ...]:
    """What is told of a material of these maps, 0..1; of vectors -1..1 for normals."""
    rng = np.random.default_rng(1)
    folder.mkdir()
    maps |= {"albedo": rng.random((*SIDES, 3))}
    if normal is not None:
        maps["normal"] = (normal + 1) / 2
    for name, values in maps.items():
        codes = np.rint(values * 255).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"{name}.png"), codes[..., ::-1] if codes.ndim == 3 else codes)
    return tuple(note.partition(f"{folder}: ")[2] for note in open_source("exemplar", str(folder)).notes)


@pytest.mark.parametrize("with_height", [True, False])
def test_green_by_slopes_of_heights_or_alone(tmp_path: Path, with_height: bool) -> None:
    height, normal = surface()
    maps = {"height": height} if with_height else {}
    assert told(tmp_path / "gl", normal, **maps) == ()
    (note,) = told(tmp_path / "dx", normal * [1, -1, 1], **maps)
    assert note.startswith("normal: green seems to point down (")
    assert "a name that ends in dx, or 'normal_convention: directx' in a YAML file" in note
    (tmp_path / "dx" / "normal.png").rename(tmp_path / "dx" / "normal_dx.png")
    assert open_source("exemplar", str(tmp_path / "dx")).notes == ()


def test_udim_tiles_are_measured_as_one(tmp_path: Path) -> None:
    height, normal = surface()
    told(tmp_path / "dx", normal * [1, -1, 1], height=height)
    for path in list((tmp_path / "dx").iterdir()):
        whole = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert whole is not None
        path.unlink()
        for number, half in zip((1001, 1002), np.split(whole, 2, axis=1), strict=True):
            assert cv2.imwrite(str(path.with_suffix(f".{number}.png")), half)
    source = open_source("exemplar", str(tmp_path / "dx"))
    assert (source.height, source.width) == SIDES
    assert len(source.notes) == 1
    assert "green seems to point down" in source.notes[0]


def test_a_depth_and_gloss_are_told(tmp_path: Path) -> None:
    height, normal = surface()
    (note,) = told(tmp_path / "depth", normal, height=1 - height)
    assert note.startswith("height: seems to be a depth")
    assert told(tmp_path / "rough", roughness=height, specular=1 - height) == ()
    (note,) = told(tmp_path / "gloss", roughness=height, specular=height)
    assert note.startswith("roughness: seems to be gloss")


@pytest.mark.parametrize("blue", [-1, 0, 1])
def test_normals_of_two_channels_are_rebuilt(tmp_path: Path, blue: int) -> None:
    height, normal = surface()
    (note,) = told(tmp_path / "two", np.dstack([normal[..., :2], np.full(SIDES, blue)]), height=height)
    assert note.startswith("normal: the third channel is empty; z was rebuilt")
    image = open_source("exemplar", str(tmp_path / "two")).read()
    planes = [image.channels.index(f"normal.{axis}") for axis in "XYZ"]
    np.testing.assert_allclose(image.pixels[..., planes], normal, atol=0.04)
    assert image.pixels[..., planes[2]].min() > 0


def test_flat_normals_stay(tmp_path: Path) -> None:
    flat = np.zeros((*SIDES, 3))
    flat[..., 2] = 1
    assert told(tmp_path / "flat", flat) == ()


def test_normals_through_a_curve_and_pictures_that_are_none(tmp_path: Path) -> None:
    _, normal = surface()
    (note,) = told(tmp_path / "curve", np.asarray(srgb_from_linear((normal + 1) / 2)) * 2 - 1)
    assert "right if an sRGB curve is taken off" in note
    assert any(
        "is this file one?" in note for note in told(tmp_path / "none", np.full((*SIDES, 3), 0.2) * surface()[1])
    )
    inside = normal * [1, 1, -1]
    assert any("z is not positive in 100 %" in note for note in told(tmp_path / "inside", inside))
