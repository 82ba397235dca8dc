"""The flow that makes a plane without end, from files to files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.pipelines.media.test_material_set import save
from tests.synthesis.semi_procedural.exemplars import wall
from tests.synthetic import smooth_noise
from texloom.stages.vocabulary.declare import InputError

SIDE = 96
QUICK = {"preset": "fast", "plane.side": "64", "hexagons.side": "64"}


def noise(channels: int, seed: int) -> np.ndarray:
    values = smooth_noise((SIDE, SIDE, channels), 1.5, np.random.default_rng(seed))
    return np.rint((values - values.min()) / np.ptp(values) * 255).astype(np.uint8)


@pytest.fixture
def material(tmp_path: Path) -> Path:
    folder = tmp_path / "sand"
    folder.mkdir()
    save(folder / "sand_albedo.png", noise(3, 1))
    save(folder / "sand_roughness.png", noise(3, 2)[..., 0])
    save(folder / "sand_ao.png", noise(3, 3)[..., 0])
    return folder


def test_files_of_a_material_hold_what_the_preview_shows(
    ran: Callable[..., dict[str, Any]], material: Path, tmp_path: Path
) -> None:
    made = ran(tmp_path / "out", "endless", {"exemplar": material}, **QUICK)
    assert {"gaussian_1.data.png", "gaussian_2.data.png", "inverse.data.png", "endless.glsl"} <= set(made)
    assert {"endless.hlsl", "endless.gdshader", "endless.osl", "hex.glsl", "texture.hex.mtlx", "maps/"} <= set(made)
    assert "gaussian_3.data.png" not in made
    codes = made["gaussian_1.data.png"]
    assert codes.dtype == np.uint16
    assert codes.shape == (SIDE, SIDE, 4)
    assert abs(codes.mean() / 65535 - 0.5) < 0.001
    preview, texture = made["preview.png"].astype(float), made["texture.png"].astype(float)
    assert preview.shape == (64, 64, 3)
    np.testing.assert_allclose(preview.mean(axis=(0, 1)), texture.mean(axis=(0, 1)), atol=12)


def test_a_picture_has_one_page_and_contours_are_refused(
    ran: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    save(tmp_path / "sand.png", noise(3, 4))
    made = ran(tmp_path / "out", "endless", {"exemplar": tmp_path / "sand.png"}, **QUICK)
    assert not {"gaussian_2.data.png", "gaussian_2.exr", "gaussian_3.exr", "maps/", "cells.png"} & set(made)
    contours = np.abs(smooth_noise((SIDE, SIDE), 7, np.random.default_rng(4)))
    save(tmp_path / "contours.png", np.uint8(np.where(contours < 0.1 * contours.max(), 10, 230)))
    with pytest.raises(InputError, match="wang_tiles keeps it, --set accept=true goes on"):
        ran(tmp_path / "none", "endless", {"exemplar": tmp_path / "contours.png"}, **QUICK)
    assert not (tmp_path / "none").exists()


def test_a_lattice_is_laid_as_cells(ran: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    folder = tmp_path / "wall"
    folder.mkdir()
    pixels = np.rint(np.clip(wall().pixels, 0, 1) * 255).astype(np.uint8)
    save(folder / "wall_albedo.png", pixels[..., :3])
    save(folder / "wall_roughness.png", pixels[..., 6])
    made = ran(tmp_path / "out", "endless", {"exemplar": folder}, **{"cell_preview.side": "200"})
    assert {"cells.glsl", "cells.hlsl", "cells.gdshader", "cells.osl", "cells.json", "cells/"} <= set(made)
    assert not {"gaussian_1.data.png", "hex.glsl", "texture.png", "preview.png"} & set(made)
    assert made["cells_window.data.png"].dtype == np.uint16
    assert made["cells_preview.png"].shape == (200, 200, 3)
    assert made["suitability.json"]["chosen"] == ["cells"]
    assert made["cells_plane.json"]["cells"] >= 16
