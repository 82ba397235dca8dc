"""The flows of photographs, run whole on small pictures with geometry in YAML."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import skimage.data

from tests.pipelines.flows import Events
from tests.pipelines.media.test_material_export import saved
from tests.pipelines.media.test_material_set import save
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.declare import InputError

SIDES = (100, 110)
PLANE = "patches: [{name: ground, corners: [[-10, 20], [-10, 90], [110, 120], [110, -10]], size: [100, 80]}]\n"
REGION = "region: [[[2, 2], [2, 107], [97, 107], [97, 2]]]\n"
HOLE = "hole: [[[40, 40], [40, 60], [60, 60], [60, 40]]]\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photograph, a picture of features, and geometry that names it."""
    found = tmp_path_factory.mktemp("photographs")
    grey = skimage.data.gravel()[: SIDES[0], : SIDES[1]]
    save(found / "photo.png", np.stack([grey, 255 - grey // 2, grey // 3], axis=2))
    save(found / "bright.png", np.where(grey > 150, 255, 0).astype(np.uint8))
    (found / "plane.yaml").write_text(PLANE + REGION + HOLE)
    (found / "marked.yaml").write_text(PLANE + REGION + "features: {bright: bright.png}\n")
    return found


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store(tmp_path_factory.mktemp("store"))


def opened(store: Store, flow: str, sources: dict[str, Path], **params: str) -> Run:
    given = Overrides({name: str(path) for name, path in sources.items()}, params)
    return Run(load_flow(find_flow(flow), given), store)


def ran(store: Store, out: Path, flow: str, sources: dict[str, Path], **params: str) -> dict[str, np.ndarray]:
    exports = execute(opened(store, flow, sources, **params), Events(), out)
    return {name: saved(path) for name, path in exports.items() if path.suffix == ".png"}


def test_a_flat_texture(store: Store, folder: Path, tmp_path: Path) -> None:
    photo = {"photo": folder / "photo.png"}
    given = {"surface.geometry": str(folder / "plane.yaml"), "size": "64"}
    found = ran(store, tmp_path / "plain", "photo_to_texture", photo, **given)
    assert found["texture.png"].shape[:2] == (64, 64)
    assert found["grid.png"].shape[:2] == found["streamlines.png"].shape[:2] == SIDES
    assert found["sources.png"].shape[:2] == (64, 64)
    assert found["texture.png"].std() > 0.7 * saved(folder / "photo.png").std()
    given |= {"surface.geometry": str(folder / "marked.yaml")}
    one = ran(store, tmp_path / "marked", "photo_to_texture", photo, **given)
    two = ran(store, tmp_path / "two", "photo_to_texture", photo, **given, **{"features.directional": "true"})
    assert (one["texture.png"] != found["texture.png"]).any()
    assert (one["texture.png"] != two["texture.png"]).any()


def test_what_a_picture_of_features_holds_enters_the_key(store: Store, folder: Path) -> None:
    import cv2

    photo = {"photo": folder / "photo.png"}
    given = {"surface.geometry": str(folder / "marked.yaml")}
    before = opened(store, "photo_to_texture", photo, **given).plan()[0]
    kept = (folder / "bright.png").read_bytes()
    try:
        cv2.imwrite(str(folder / "bright.png"), np.zeros(SIDES, np.uint8))
        after = opened(store, "photo_to_texture", photo, **given).plan()[0]
    finally:
        (folder / "bright.png").write_bytes(kept)
    assert before.name == after.name == "surface"
    assert before.key != after.key


def test_a_hole_is_filled(store: Store, folder: Path, tmp_path: Path) -> None:
    photo = saved(folder / "photo.png")
    found = ran(
        store,
        tmp_path,
        "photo_completion",
        {"photo": folder / "photo.png"},
        **{"surface.geometry": str(folder / "plane.yaml")},
    )
    hole = np.zeros(SIDES, bool)
    hole[40:61, 40:61] = True
    np.testing.assert_array_equal(found["texture.png"][~hole], photo[~hole])
    assert (found["texture.png"][hole] != photo[hole]).any(axis=1).mean() > 0.9
    assert found["texture.png"][hole].std() > 0.5 * photo[hole].std()


def test_texture_of_one_photograph_in_another(store: Store, folder: Path, tmp_path: Path) -> None:
    scene = np.full((*SIDES, 3), 90, np.uint8)
    save(tmp_path / "scene.png", scene)
    found = ran(
        store,
        tmp_path / "out",
        "photo_to_photo",
        {"photo": folder / "photo.png", "scene": tmp_path / "scene.png"},
        **{"surface.geometry": str(folder / "marked.yaml"), "place.geometry": str(folder / "plane.yaml")},
    )
    placed = found["texture.png"]
    assert (placed[:40] == 90).all()
    assert placed[40:61, 40:61].std() > 15


def test_a_file_that_is_wrong_stops_all_before_anything_runs(store: Store, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    for content, said in (
        ("patches: [{corners: [[1, 1", r"wrong\.yaml: not valid YAML"),
        (PLANE + "region: gone.png\n", r"gone\.png: no such file"),
        (PLANE.replace("20], [-10, 90]", "90], [-10, 20]"), r"patch 'ground': the corners"),
        (PLANE + "region: [[[1, 1], [1, 5], [5, 5]]]\n", r"region \(patch 'ground'\): \d+ px remain"),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=said) as caught:
            opened(store, "photo_to_texture", {"photo": folder / "photo.png"}, **{"surface.geometry": str(path)})
        assert "\n" not in str(caught.value)
