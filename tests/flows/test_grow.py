"""The flow that continues the trend of an exemplar."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

import texloom
from tests.ageing import ageing
from tests.pipelines.media.test_material_set import save
from tests.synthetic import blobs
from texloom.pipelines.media.sources import open_source
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def material(tmp_path: Path, rng: np.random.Generator) -> Path:
    """One whose height is its red, so that register shows."""
    folder = tmp_path / "rusting"
    folder.mkdir()
    colors = ageing((64, 64), rng).srgb
    save(folder / "rusting_albedo.png", colors)
    save(folder / "rusting_height.png", colors[..., 0].astype(np.uint16) * 257)
    return folder


def test_a_material_ages_over_three_times_its_width(material: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    texloom.run(
        "grow",
        {"exemplar": str(material)},
        params={"size": "192x64", "preset": "fast"},
        store=tmp_path / "store",
        out=out,
    )
    albedo = np.asarray(Pillow.open(out / "texture.png")).astype(int)
    rusty = (albedo[..., 0] - albedo[..., 2] > 20).mean(axis=0).reshape(6, 32).mean(axis=1)
    assert rusty[0] < 0.3 < 0.7 < rusty[-1]
    assert np.corrcoef(rusty, np.arange(6))[0, 1] > 0.9
    height = np.asarray(Pillow.open(out / "maps" / "rusting_height.png")) / 257
    assert np.abs(height - albedo[..., 0]).mean() < 2
    wanted = open_source("exemplar", str(out / "target.exr")).read()
    assert wanted.pixels.shape[:2] == (64, 192)
    assert {"progression.png", "progression.exr", "target.png", "orientation.png", "trend.json"} <= {
        path.name for path in out.iterdir()
    }


def test_what_has_no_trend_is_refused_and_leaves_nothing(tmp_path: Path, rng: np.random.Generator) -> None:
    file = tmp_path / "even.png"
    save(file, np.rint(blobs((64, 64, 3), rng, 1.0) * 255).astype(np.uint8))
    with pytest.raises(InputError, match="has no trend"):
        texloom.run(
            "grow", {"exemplar": str(file)}, params={"size": 96}, store=tmp_path / "store", out=tmp_path / "out"
        )
    assert not (tmp_path / "out").exists()
