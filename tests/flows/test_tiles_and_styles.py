"""The flows of tiles between materials, of versions that fit, and of pictures restyled, from files to files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import texloom
from tests.pipelines.media.test_material_set import save
from tests.synthetic import blobs
from texloom.stages.vocabulary.declare import InputError

SIDE, TILE = 48, 40
QUICK = {"preset": "fast"}


def grain(colour: tuple[float, float, float], rng: np.random.Generator) -> np.ndarray:
    values = 0.5 + 0.5 * blobs((SIDE, SIDE), rng, 1.0)[..., None]
    return np.rint(values * colour * 255).astype(np.uint8)


def opened(file: Path) -> np.ndarray:
    return np.asarray(Pillow.open(file))


def test_tiles_between_materials_are_sheets_with_the_files_of_engines(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    for name, colour in (("sand", (1.0, 0.6, 0.1)), ("pond", (0.1, 0.4, 1.0))):
        folder = tmp_path / name
        folder.mkdir()
        save(folder / f"{name}_albedo.png", grain(colour, rng))
        save(folder / f"{name}_height.png", np.full((SIDE, SIDE), 60000 if name == "sand" else 9000, np.uint16))
    out = tmp_path / "out"
    texloom.run(
        "transition_tiles",
        {"exemplars": (str(tmp_path / "sand"), str(tmp_path / "pond"))},
        params={**QUICK, "tile": TILE},
        store=tmp_path / "store",
        out=out,
    )
    assert opened(out / "corners.png").shape == opened(out / "edges.png").shape == (4 * TILE, 4 * TILE, 3)
    tiles = json.loads((out / "tiles.json").read_text())
    side, columns = tiles["blob"]["size"], tiles["blob"]["columns"]
    assert (side, len(tiles["blob"]["tiles"])) == (2 * TILE, 48)
    blob, height = opened(out / "blob.png"), opened(out / "blob" / "height.png")
    assert blob.shape[:2] == height.shape == (len(tiles["blob"]["tiles"]) // columns * side, columns * side)
    for sheet, files in {
        "corners": ("tsx", "tres", "png.meta"),
        "blob": ("tsx", "tres", "png.meta", "asset"),
    }.items():
        assert all((out / f"{sheet}.{suffix}").stat().st_size > 500 for suffix in files)
        assert f'"{sheet}.png"' in (out / f"{sheet}.tsx").read_text()
        assert f'"res://{sheet}.png"' in (out / f"{sheet}.tres").read_text()
    is_sand = blob[..., 0] > blob[..., 2]
    assert (is_sand == (height > 34500)).mean() > 0.97  # but where both are mixed
    for table in ("borders.json", "edges_borders.json"):
        assert json.loads((out / table).read_text())["albedo"]["ratio"] < 1.1


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_versions_are_udim_tiles_that_fit_in_all_maps(
    strength: float, tmp_path: Path, rng: np.random.Generator
) -> None:
    folder, out = tmp_path / "moss", tmp_path / "out"
    folder.mkdir()
    colors = np.rint(blobs((SIDE, SIDE, 3), rng) * 255).astype(np.uint8)
    save(folder / "moss_albedo.png", colors)
    save(folder / "moss_roughness.png", colors[..., 0])
    texloom.run(
        "vary",
        {"exemplar": str(folder)},
        params={**QUICK, "tile": TILE, "variants": "2x1", "strength": strength},
        udim="2x1",
        store=tmp_path / "store",
        out=out,
    )
    both = opened(out / "texture.png").astype(int)
    cut = {path.name for path in (out / "maps").glob("*.png")}
    assert cut == {f"moss_{role}.100{one}.png" for role in ("base_color", "roughness") for one in (1, 2)}
    versions = [opened(out / "maps" / f"moss_base_color.100{one}.png").astype(int) for one in (1, 2)]
    np.testing.assert_array_equal(np.concatenate(versions, axis=1), both)
    for one, version in enumerate(versions, 1):
        roughness = opened(out / "maps" / f"moss_roughness.100{one}.png")
        assert np.corrcoef(roughness.ravel(), version[..., 0].ravel())[0, 1] > 0.95
    assert np.abs(versions[0] - versions[1])[6:-6, 6:-6].mean() > 2
    assert json.loads((out / "borders.json").read_text())["albedo"]["ratio"] < 1.1


def restyled(tmp_path: Path, **sources: Any) -> Path:
    texloom.run("restyle", sources, params=QUICK, store=tmp_path / "store", out=tmp_path / "out")
    return tmp_path / "out" / "texture.png"


def test_light_parts_of_a_picture_are_made_of_light_parts_of_the_exemplar(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    slope = np.linspace(20, 220, SIDE)[:, None, None] * [1.0, 0.8, 0.4]
    save(
        tmp_path / "bark.png", np.rint(slope + rng.uniform(-15, 15, (SIDE, SIDE, 3))).clip(0, 255).astype(np.uint8)
    )
    signs = np.full((SIDE, 60, 3), 30, np.uint8)
    signs[12:36, 20:40] = 225
    save(tmp_path / "sign.png", signs)
    made = opened(restyled(tmp_path, exemplar=str(tmp_path / "bark.png"), picture=str(tmp_path / "sign.png")))
    assert made.shape == signs.shape
    inside, outside = made[16:32, 24:36].mean(axis=(0, 1)), made[:, :12].mean(axis=(0, 1))
    assert (inside - outside > np.array([60, 50, 25])).all()
    assert inside[0] > 1.5 * inside[2]  # the colours are the exemplar's


def test_a_picture_to_restyle_is_needed(tmp_path: Path, rng: np.random.Generator) -> None:
    save(tmp_path / "bark.png", grain((1.0, 0.8, 0.4), rng))
    with pytest.raises(InputError, match="picture"):
        restyled(tmp_path, exemplar=str(tmp_path / "bark.png"))
    assert not (tmp_path / "out").exists()
