"""The patches of a photograph side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.photographs import surfaces, unit_square
from tests.synthetic import picture
from texloom.stages.analysis.photographs.patch_atlas import PatchAtlas, PatchAtlasParams, patch_atlas
from texloom.stages.vocabulary.declare import InputError

SHAPE = (120, 160)
LEFT = [[20.0, 10.0], [15.0, 70.0], [110.0, 75.0], [100.0, 5.0]]
RIGHT = [[10.0, 85.0], [20.0, 150.0], [105.0, 155.0], [115.0, 90.0]]


def laid_out(
    folder: Path, without: list[list[float]] | None = None, generators: np.ndarray | None = None, **params: int
) -> PatchAtlas:
    """Of a photograph of two checkerboards, of 4x4 cells and of 4x6."""
    photo = np.zeros(SHAPE)
    for corners, cells in ((LEFT, (4, 4)), (RIGHT, (4, 6))):
        place = unit_square(corners, *np.indices(SHAPE).astype(float))
        inside = ((place > 0) & (place < 1)).all(axis=2)
        photo = np.where(inside, 0.2 + 0.6 * (np.floor(place * cells).sum(axis=2) % 2), photo)
    image = picture(np.repeat(photo[..., None], 3, axis=2))
    patches = [{"corners": LEFT, "size": "4x4"}, {"corners": RIGHT, "size": "6x4"}]
    surface = surfaces(image, folder, patches=patches, without=[without] if without else [])
    return patch_atlas(
        image, surface.region, surface.controls, surface.spaces, surface.sizes, surface.scale,
        PatchAtlasParams(**params), generators,
    )  # fmt: skip


def test_patches_are_seen_from_the_front_at_one_scale(tmp_path: Path) -> None:
    made = laid_out(tmp_path, gap=5)
    first, second = made.table["patches"]
    assert first["height"] == first["width"] == second["height"]
    assert second["width"] == pytest.approx(1.5 * second["height"], abs=1)
    assert max(second["column"] - first["width"], second["row"] - first["height"]) == 5
    for part, cells in ((first, (4, 4)), (second, (4, 6))):
        shown = made.image.color[part["row"] :, part["column"] :][: part["height"], : part["width"], 0]
        rows, columns = (
            ((np.arange(n) + 0.5) * side / n).astype(int)
            for n, side in zip(cells, (part["height"], part["width"]), strict=True)
        )
        wanted = 0.2 + 0.6 * (np.indices(cells).sum(axis=0) % 2)
        np.testing.assert_allclose(shown[np.ix_(rows, columns)], wanted, atol=0.05)


def test_what_is_hidden_is_not_kept(tmp_path: Path) -> None:
    hidden = laid_out(tmp_path, [[40, 20], [40, 50], [70, 50], [70, 20]])
    whole = laid_out(tmp_path)
    np.testing.assert_array_equal(hidden.keep, hidden.image.pixels[..., 3] > 0)
    assert 0.02 < whole.keep.mean() - hidden.keep.mean() < 0.2


def test_what_is_unsharp_is_not_shown_and_cropped(tmp_path: Path) -> None:
    image = picture(np.full((*SHAPE, 3), 0.5))
    surface = surfaces(image, tmp_path, patches=[{"corners": LEFT, "size": "4x4"}])
    given = surface.region, surface.controls, surface.spaces, surface.sizes, surface.scale
    level = np.zeros(SHAPE, np.float32)
    whole = patch_atlas(image, *given, PatchAtlasParams(), level=level)
    left, right = (int(column) for column in (np.array(LEFT)[:, 1].min(), np.array(LEFT)[:, 1].max()))
    level[:, (left + right) // 2 :] = 1.6
    part = patch_atlas(image, *given, PatchAtlasParams(), level=level)
    assert 0.3 < part.keep.mean() / whole.keep.mean() < 0.7
    assert part.largest.width < 0.75 * whole.largest.width
    kept = patch_atlas(image, *given, PatchAtlasParams(blur=1.7), level=level)
    np.testing.assert_array_equal(kept.largest.pixels, whole.largest.pixels)


def test_large_patches_are_reduced(tmp_path: Path) -> None:
    assert max(part["width"] for part in laid_out(tmp_path, max_side=30).table["patches"]) == 30


def test_patches_of_too_many_pixels_are_refused() -> None:
    """256 of 8192 px a side would take 275 GB."""
    controls, sizes = np.ones((256, 4, 4, 3), np.float32), np.ones((256, 2), np.float32)
    image, region = picture(np.zeros((*SHAPE, 3))), np.ones(SHAPE, bool)
    with pytest.raises(InputError, match=r"max_side: 256 patches are 1073741824 px in all, at most 268435456"):
        patch_atlas(image, region, controls, controls, sizes, 1e6, PatchAtlasParams(max_side=2048))


def test_a_region_beside_all_patches_is_refused(tmp_path: Path) -> None:
    image, nothing = picture(np.zeros((*SHAPE, 3))), np.zeros(SHAPE, bool)
    surface = surfaces(image, tmp_path, patches=[{"corners": LEFT, "size": "4x4"}])
    with pytest.raises(InputError, match="region: no patch shows any of it"):
        patch_atlas(image, nothing, surface.controls, surface.spaces, surface.sizes, 10.0, PatchAtlasParams())


def test_patches_that_repeat_are_in_phase(tmp_path: Path) -> None:
    first = laid_out(tmp_path).table["patches"][0]
    side = first["width"] / 4
    made = laid_out(tmp_path, generators=np.array([[side, side], [side, -side]], np.float32), gap=5)
    parts = made.table["patches"]
    cells = [(part[name] - start) / side for part in parts for name, start in (("row", 0), ("column", 0))]
    assert np.abs(cells - np.rint(cells)).max() < 1.5 / side
    assert np.rint(cells).sum() % 2 == 0  # dark cells continue dark ones
    assert max(parts[1]["column"] - first["width"], parts[1]["row"] - first["height"]) < 5 + 2 * side
    largest = max(parts, key=lambda part: part["width"])
    np.testing.assert_array_equal(made.largest.pixels.shape[:2], (largest["height"], largest["width"]))
