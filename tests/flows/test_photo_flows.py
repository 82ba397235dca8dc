"""The flows of photographs, run whole on small pictures with geometry in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data

from tests.pipelines.media.test_material_export import saved
from tests.pipelines.media.test_material_set import save
from texloom.stages.vocabulary.declare import InputError

SIDES = (100, 110)
PLANE = "patches: [{name: ground, corners: [[-10, 20], [-10, 90], [110, 120], [110, -10]], size: 80x100}]\n"
REGION = "region: [[[2, 2], [2, 107], [97, 107], [97, 2]]]\n"
HOLE = "hole: [[[40, 40], [40, 60], [60, 60], [60, 40]]]\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photograph, a picture of features, and geometry that names it."""
    path = tmp_path_factory.mktemp("photographs")
    grey = skimage.data.gravel()[: SIDES[0], : SIDES[1]]
    save(path / "photo.png", np.stack([grey, 255 - grey // 2, grey // 3], axis=2))
    save(path / "bright.png", np.where(grey > 150, 255, 0).astype(np.uint8))
    (path / "plane.yaml").write_text(PLANE + REGION + HOLE)
    (path / "marked.yaml").write_text(PLANE + REGION + "features: {bright: bright.png}\n")
    return path


def test_a_flat_texture(ran: Any, folder: Path, tmp_path: Path) -> None:
    photo = {"photo": folder / "photo.png"}
    params = {"surface.geometry": str(folder / "plane.yaml"), "size": "64"}
    exports = ran(tmp_path / "plain", "photo_to_texture", photo, **params)
    assert exports["texture.png"].shape[:2] == (64, 64)
    assert exports["grid.png"].shape[:2] == exports["streamlines.png"].shape[:2] == SIDES
    assert exports["sources.png"].shape[:2] == (64, 64)
    assert exports["texture.png"].std() > 0.7 * saved(folder / "photo.png").std()
    params |= {"surface.geometry": str(folder / "marked.yaml")}
    one = ran(tmp_path / "marked", "photo_to_texture", photo, **params)
    two = ran(tmp_path / "two", "photo_to_texture", photo, **params, **{"features.directional": "true"})
    assert (one["texture.png"] != exports["texture.png"]).any()
    assert (one["texture.png"] != two["texture.png"]).any()


def test_what_a_picture_of_features_holds_enters_the_key(opened: Any, folder: Path) -> None:
    import cv2

    photo = {"photo": folder / "photo.png"}
    params = {"surface.geometry": str(folder / "marked.yaml")}
    before = opened("photo_to_texture", photo, **params).plan()[0]
    kept = (folder / "bright.png").read_bytes()
    try:
        cv2.imwrite(str(folder / "bright.png"), np.zeros(SIDES, np.uint8))
        after = opened("photo_to_texture", photo, **params).plan()[0]
    finally:
        (folder / "bright.png").write_bytes(kept)
    assert before.name == after.name == "surface"
    assert before.key != after.key


def test_a_hole_is_filled(ran: Any, folder: Path, tmp_path: Path) -> None:
    photo = saved(folder / "photo.png")
    hole = np.zeros(SIDES, bool)
    hole[40:61, 40:61] = True
    ratios = []
    for seed in range(1, 7):
        exports = ran(
            tmp_path / str(seed),
            "photo_completion",
            {"photo": folder / "photo.png"},
            seed,
            **{"surface.geometry": str(folder / "plane.yaml")},
        )
        np.testing.assert_array_equal(exports["texture.png"][~hole], photo[~hole])
        assert (exports["texture.png"][hole] != photo[hole]).any(axis=1).mean() > 0.9
        assert exports["texture.png"][hole].std() > 0.5 * photo[hole].std()
        steps = np.abs(np.diff(exports["texture.png"].astype(float), axis=1)).mean(axis=2)
        ratios.append(steps[42:59, 42:58].mean() / steps[20:80, 20:80].mean())
    # about as sharp as what is around it; a hole this small differs by a tenth from seed to seed
    assert 0.75 < np.mean(ratios) < 1.25


def test_texture_of_one_photograph_in_another(ran: Any, folder: Path, tmp_path: Path) -> None:
    scene = np.full((*SIDES, 3), 90, np.uint8)
    scene[:, 50:] = 230
    save(tmp_path / "scene.png", scene)
    exports = ran(
        tmp_path / "out",
        "photo_to_photo",
        {"photo": folder / "photo.png", "scene": tmp_path / "scene.png"},
        **{"surface.geometry": str(folder / "marked.yaml"), "place.geometry": str(folder / "plane.yaml")},
    )
    placed = exports["texture.png"]
    np.testing.assert_array_equal(placed[:40], scene[:40])
    assert placed[40:61, 40:61].std() > 15
    # the scene's shadow stays
    assert placed[40:61, 52:61].mean() > 1.1 * placed[40:61, 40:49].mean()


def test_a_surface_is_laid_flat_and_made_larger(ran: Any, folder: Path, tmp_path: Path) -> None:
    exports = ran(
        tmp_path,
        "photo_self_tuning",
        {"photo": folder / "photo.png"},
        **{"geometry": str(folder / "plane.yaml"), "size": "64", "preset": "fast"},
    )
    flat = exports["flat.png"]
    assert exports["grid.png"].shape[:2] == SIDES
    assert exports["foreign.png"].shape[:2] == flat.shape[:2]
    assert exports["texture.png"].shape == (64, 64, 3)
    assert exports["texture.png"].std() > 0.5 * flat[..., :3].std()
    assert exports["scores.json"]["colors"]["score"] > 0.5


def test_a_photograph_becomes_a_tileable_texture_with_its_decisions(ran: Any, folder: Path, tmp_path: Path) -> None:
    params = {"geometry": str(folder / "plane.yaml"), "size": "64", "preset": "fast"}
    exports = ran(tmp_path / "file", "photo_material", {"photo": folder / "photo.png"}, **params)
    assert exports["texture.png"].shape == (64, 64, 3)
    assert exports["exemplar.png"].shape[2] == 4
    assert exports["planes.png"].shape[:2] == SIDES
    rows = {row["what"]: row for row in exports["decisions.json"]["decisions"]}
    assert list(rows) == [
        "lens distortion",
        "surface",
        "exemplar",
        "foreign parts",
        "light",
        "repetition",
        "texture",
    ]
    assert rows["surface"]["decided"] == "the geometry file says where surfaces lie"
    assert all(row["change"].startswith("--") for row in rows.values())
    assert rows["surface"]["change"] == "--set geometry=my.yaml", "there are no planes to take"
    assert "--set geometry=my.yaml" in exports["report.html"].read_text()


def test_patches_become_an_atlas_that_is_whole(ran: Any, folder: Path, tmp_path: Path) -> None:
    params = {"surface.geometry": str(folder / "plane.yaml"), "preset": "fast", "start.block": "16"}
    exports = ran(tmp_path, "photo_atlas", {"photo": folder / "photo.png"}, **params)
    flat, keep = exports["flat.png"][..., :3], exports["flat.png"][..., 3] == 255
    (part,) = exports["patches.json"]["patches"]
    assert exports["texture.png"].shape[:2] == flat.shape[:2] == (part["height"], part["width"])
    assert 0.05 < (~keep).mean() < 0.6
    assert exports["texture.png"][~keep].std() > 0.5 * flat[keep].std()


def test_the_better_flat_texture_is_chosen(ran: Any, folder: Path, tmp_path: Path) -> None:
    exports = ran(
        tmp_path,
        "photo_flattening",
        {"photo": folder / "photo.png"},
        **{"surface.geometry": str(folder / "plane.yaml"), "size": "64"},
    )
    table = exports["choice.json"]
    assert exports["texture.png"].shape == (64, 64, 3)
    assert table["chosen"] == max(table["totals"], key=table["totals"].get)
    assert table["because"].startswith(table["chosen"])


def test_a_file_that_is_wrong_stops_all_before_anything_runs(opened: Any, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    for content, message in (
        ("patches: [{corners: [[1, 1", r"wrong\.yaml: not valid YAML"),
        (PLANE + "region: gone.png\n", r"gone\.png: no such file"),
        (PLANE.replace("20], [-10, 90]", "90], [-10, 20]"), r"patch 'ground': the corners"),
        (PLANE + "region: [[[1, 1], [1, 5], [5, 5]]]\n", r"region \(patch 'ground'\): \d+ px remain"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=message) as caught:
            opened("photo_to_texture", {"photo": folder / "photo.png"}, **{"surface.geometry": str(path)})
        assert "\n" not in str(caught.value)
