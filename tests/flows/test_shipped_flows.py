"""Flows that ship, run whole on small pictures: those of masks, of pictures that stay, and of materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skimage.data
from scipy.spatial import cKDTree

from tests.pipelines.media.test_material_export import saved
from tests.pipelines.media.test_material_set import save
from texloom.pipelines.store import exr

SIDES = (66, 72)


@pytest.fixture(scope="module")
def gravel() -> np.ndarray:
    """In colour."""
    grey = skimage.data.gravel()[200 : 200 + SIDES[0], 100 : 100 + SIDES[1]]
    return np.stack([grey, 255 - grey // 2, grey // 3], axis=2)


def deep(picture: np.ndarray) -> np.ndarray:
    """With 16 bits that 8 do not hold."""
    steps = np.arange(SIDES[1], dtype=np.uint16)
    return picture.astype(np.uint16) * 256 + (steps if picture.ndim == 2 else steps[:, None])


def marks(*boxes: tuple[slice, slice]) -> np.ndarray:
    marked = np.zeros(SIDES, bool)
    for box in boxes:
        marked[box] = True
    return marked


@pytest.mark.parametrize("bits", [8, 16])
def test_a_picture_made_tileable_stays_but_for_its_borders(
    ran: Any, gravel: np.ndarray, bits: int, tmp_path: Path
) -> None:
    save(tmp_path / "gravel.png", gravel if bits == 8 else deep(gravel))
    exports = ran(tmp_path / "out", "make_tileable", {"picture": tmp_path / "gravel.png"}, **{"band.width": "10"})
    before, after = saved(tmp_path / "gravel.png"), exports["texture.png"]
    assert after.dtype == before.dtype
    np.testing.assert_array_equal(after[10:-10, 10:-10], before[10:-10, 10:-10])
    assert (after != before).any()
    seams = exports["scores.json"]["seams"]
    assert seams["score"] == 1
    assert seams["value"] < 1.3 < seams["ceiling"]
    assert "given" in exports["scores.json"]["contents"]["reason"]


def test_scores_of_a_picture_from_elsewhere(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    save(tmp_path / "exemplar.png", gravel)
    save(tmp_path / "made.png", np.tile(gravel, (2, 1, 1)))
    sources = {"exemplar": tmp_path / "exemplar.png", "picture": tmp_path / "made.png"}
    exports = ran(tmp_path / "out", "score", sources, size="72x100")
    np.testing.assert_array_equal(exports["texture.png"], saved(tmp_path / "made.png")[16:116])
    assert exports["scores.json"]["coherence"]["score"] > 0.9
    assert exports["scores.json"]["copying"]["score"] == 0
    assert exports["report.html"].stat().st_size > 0


def test_filled_holes_do_not_tell_what_was_in_them(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    holes = marks(np.s_[20:32, 40:55], np.s_[50:53, 10:60])
    save(tmp_path / "holes.png", holes.astype(np.uint8) * 255)
    runs = []
    for color in (0, 255):
        path = tmp_path / f"{color}.png"
        save(path, np.where(holes[..., None], np.uint8(color), gravel))
        sources = {"picture": path, "holes": tmp_path / "holes.png"}
        runs.append(ran(tmp_path / f"out{color}", "fill", sources))
    first, second = runs
    np.testing.assert_array_equal(first["texture.png"], second["texture.png"])
    assert first["scores.json"] == second["scores.json"]
    assert first["scores.json"]["coherence"]["score"] > 0.6
    np.testing.assert_array_equal(first["texture.png"][~holes], saved(tmp_path / "0.png")[~holes])


def test_transparent_pixels_are_the_holes(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    hole = marks(np.s_[20:40, 30:50])
    save(tmp_path / "cut.png", np.dstack([gravel, np.where(hole, 0, 255).astype(np.uint8)]))
    filled = ran(tmp_path / "filled", "fill", {"picture": tmp_path / "cut.png"})
    assert (filled["texture.png"][..., 3] == 255).all()
    np.testing.assert_array_equal(filled["texture.png"][~hole], saved(tmp_path / "cut.png")[~hole])


@pytest.mark.parametrize(("flow", "params"), [("fill", {}), ("make_tileable", {"band.width": "10"})])
def test_maps_of_a_material_that_is_edited_stay(
    ran: Any, gravel: np.ndarray, flow: str, params: dict[str, str], tmp_path: Path
) -> None:
    hole = marks(np.s_[20:40, 30:50])
    maps = {"s_albedo": gravel, "s_rough": gravel[..., 1], "s_height": deep(gravel[..., 0])}
    for name, levels in maps.items():
        save(tmp_path / "stones" / f"{name}.png", levels)
    save(tmp_path / "holes.png", hole.astype(np.uint8) * 255)
    holes = {"holes": tmp_path / "holes.png"} if flow == "fill" else {}
    exports = ran(tmp_path / "out", flow, {"picture": tmp_path / "stones", **holes}, **params)
    edited = exports["maps/"]
    kept = ~hole if holes else np.pad(np.ones((SIDES[0] - 20, SIDES[1] - 20), bool), 10)
    for name in maps:
        made, before = saved(edited / f"{name}.png"), saved(tmp_path / "stones" / f"{name}.png")
        assert made.dtype == before.dtype
        np.testing.assert_array_equal(made[kept], before[kept], err_msg=name)
        assert (made != before)[~kept].any()
    if holes:  # the EXR knows the names and bits of the files
        again = ran(tmp_path / "again", flow, {"picture": exports["texture.exr"], **holes}, **params)["maps/"]
        assert {path.stem for path in again.glob("*.png")} == {*maps}
        for name in maps:
            made, before = saved(again / f"{name}.png"), saved(edited / f"{name}.png")
            assert made.dtype == before.dtype
            np.testing.assert_array_equal(made[kept], before[kept], err_msg=name)


def test_masked_places_leave_no_trace(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    logo = marks(np.s_[10:24, 12:40])
    save(tmp_path / "mask.png", 255 - logo.astype(np.uint8) * 255)
    runs = []
    for name, color in (("red", (255, 0, 0)), ("white", (255, 255, 255))):
        path = tmp_path / f"{name}.png"
        save(path, np.where(logo[..., None], np.array(color, np.uint8), gravel))
        sources = {"exemplar": path, "mask": tmp_path / "mask.png"}
        small = {"size": "96x80", "preset": "fast"}
        runs.append(ran(tmp_path / name, "self_tuning", sources, **small))
    first, second = runs
    np.testing.assert_array_equal(first["texture.png"], second["texture.png"])
    np.testing.assert_array_equal(first["usable.png"] > 0, ~logo)
    assert first["scores.json"] == second["scores.json"]
    assert first["scores.json"]["colors"]["score"] > 0.9


def test_a_drift_is_evened_and_a_picture_gives_another(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    light = np.linspace(1.0, 0.25, SIDES[1])[None, :, None]
    save(tmp_path / "drifting.png", (gravel * light).astype(np.uint8))
    save(tmp_path / "shade.png", np.linspace(40, 220, 50, dtype=np.uint8)[:, None].repeat(50, 1))
    sources = {"exemplar": tmp_path / "drifting.png", "control": tmp_path / "shade.png"}
    exports = ran(tmp_path / "out", "self_tuning", sources, size="64x64", preset="fast")
    even, toned = (exports[name].astype(float) for name in ("even.png", "texture.png"))
    top, bottom = (toned / np.maximum(even, 1)).mean(axis=(1, 2))[[8, -8]]
    assert bottom > 1.5 * top
    strips = even.mean(axis=(0, 2)).reshape(4, 16).mean(axis=1)
    assert strips.max() < 1.4 * strips.min(), "the drifting exemplar has 2.5 times the light on one side"


def test_a_material_comes_back_whole(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    save(tmp_path / "set" / "gravel_albedo.png", gravel)
    save(tmp_path / "set" / "gravel_height.png", gravel[..., 0].astype(np.uint16) * 257)
    small = {"size": "48x40", "preset": "fast"}
    exports = ran(tmp_path / "out", "materials", {"exemplar": tmp_path / "set"}, **small)
    files = {path.name for path in exports["maps/"].iterdir()}
    assert files == {"gravel_albedo.png", "gravel_height.png", "material.exr", "material.mtlx"}
    assert saved(exports["maps/"] / "gravel_height.png").dtype == np.uint16
    page = exports["report.html"].read_text()
    assert 'id="map-height"' in page
    assert 'id="lit"' in page
    assert exports["scores.json"]["seams"]["value"] is not None


def test_a_picture_becomes_a_material_in_register(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    """Colour and roughness of a pixel of the result are near those of one pixel of the picture."""
    picture = save(tmp_path / "gravel.png", gravel)
    own = ran(tmp_path / "own", "material_from_colour", {"picture": picture})
    files = {"gravel_albedo", "gravel_height", "gravel_normal", "gravel_roughness", "gravel_ao"}
    named = {path.stem for path in own["maps/"].glob("*.png")}
    assert {name.rpartition("_")[2] for name in named} == {name.rpartition("_")[2] for name in files}
    assert "estimated/" not in own
    small = {"size": "48x40", "preset": "fast", "relief": "0.03", "tone.even": "never"}
    made = ran(tmp_path / "made", "material_synthesis", {"picture": picture}, **small)
    estimated, maps = (read_channels(made[folder] / "material.exr") for folder in ("estimated/", "maps/"))
    assert set(estimated) == set(maps) >= {"height", "normal.X", "normal.Y", "normal.Z", "roughness", "ao"}
    assert maps["height"].shape == (40, 48)
    names = ("R", "G", "B", "roughness")
    own_pixels, pixels = (np.stack([one[name].ravel() for name in names], axis=1) for one in (estimated, maps))
    mixed = np.column_stack([pixels[:, :3], np.random.default_rng(1).permutation(pixels[:, 3])])
    near, far = (cKDTree(own_pixels).query(values)[0].mean() for values in (pixels, mixed))
    assert near < 0.7 * far


def test_a_texture_follows_painted_labels(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    """Red gravel in the upper half of the exemplar, and in the left half of the result."""
    row, column = np.indices(SIDES)
    upper, left = row < SIDES[0] // 2, column < SIDES[1] // 2
    colors = np.array([[20, 60, 200], [200, 60, 20]], np.uint8)
    red = (gravel[..., :1] * np.where(upper[..., None], [1.0, 0.3, 0.3], [0.3, 0.3, 1.0])).astype(np.uint8)
    sources = {
        "exemplar": red,
        "exemplar_guide": colors[upper.astype(int)],
        "target_guide": colors[left.astype(int)],
    }
    for name, pixels in sources.items():
        save(tmp_path / f"{name}.png", pixels)
    files = {name: tmp_path / f"{name}.png" for name in sources}
    exports = ran(tmp_path / "out", "self_tuning", files, preset="fast", tileable="true")
    own, made = saved(files["exemplar"]).astype(int), exports["texture.png"].astype(int)
    assert made.shape == gravel.shape
    sign = np.sign(own[..., 0] - own[..., 2])
    assert (np.sign(made[..., 0] - made[..., 2]) == np.where(left, sign[0, 0], sign[-1, 0])).mean() > 0.95


def test_a_collage_becomes_coherent_and_keeps_its_pieces(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    collage = np.concatenate([gravel[:, 40:], gravel[:, :40]], axis=1)
    save(tmp_path / "exemplar.png", gravel)
    save(tmp_path / "layout.png", collage)
    sources = {"exemplar": tmp_path / "exemplar.png", "layout": tmp_path / "layout.png"}
    exports = ran(tmp_path / "out", "rectify", sources, strength="1", preset="fast")
    kept = exports["joints.png"] == 0
    assert kept.mean() > 0.7
    laid = saved(tmp_path / "layout.png")
    assert (exports["texture.png"] == laid)[kept].mean() > 0.9
    assert (exports["texture.png"] != laid).any()


def read_channels(path: Path) -> dict[str, np.ndarray]:
    """The planes of an exported EXR, by name."""
    _, parts = exr.load(path)
    return {name: plane for planes in parts.values() for name, plane in planes.items()}


def spot_of(folder: Path, *boxes: tuple[slice, slice]) -> Path:
    save(folder / "spot.png", marks(*boxes).astype(np.uint8) * 255)
    return folder / "spot.png"


REVISED = {"preset": "fast", "revised.margin": "16"}


@pytest.mark.parametrize("bits", [8, 16])
def test_a_revised_picture_stays_but_for_its_region(
    ran: Any, gravel: np.ndarray, bits: int, tmp_path: Path
) -> None:
    """The PNG has as many bits, and so does a revision of the EXR."""
    path = save(tmp_path / "texture.png", gravel if bits == 8 else deep(gravel))
    exemplar = save(tmp_path / "exemplar.png", gravel[:, ::-1])
    box, other = np.s_[20:34, 30:44], np.s_[40:50, 50:60]
    sources = {"texture": path, "exemplar": exemplar, "region": spot_of(tmp_path, box)}
    exports = ran(tmp_path / "out", "revise", sources, **REVISED)
    before, after, made = saved(path), exports["texture.png"], marks(box)
    assert after.dtype == before.dtype
    np.testing.assert_array_equal(after[~made], before[~made])
    assert (after[made] != before[made]).any()
    assert "maps/" not in exports
    assert exports["scores.json"]["coherence"]["score"] > 0.5
    sources |= {"texture": exports["texture.exr"], "region": spot_of(tmp_path, other)}
    twice = read_channels(ran(tmp_path / "again", "revise", sources, **REVISED)["texture.exr"])
    for name, plane in read_channels(exports["texture.exr"]).items():
        np.testing.assert_array_equal(twice[name][~marks(other)], plane[~marks(other)])


def test_maps_of_a_material_are_revised_together(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    """Normals too whose length is not 1."""
    height = gravel[..., 0].astype(np.uint16) * 250
    normal = np.stack([gravel[..., 0] // 8 + 112, gravel[..., 1] // 8 + 112, gravel[..., 2] // 8 + 220], axis=2)
    for folder, step in (("texture", 1), ("exemplar", -1)):
        save(tmp_path / folder / "stone_normal_dx.png", normal[:, ::step])
        save(tmp_path / folder / "stone_albedo.png", gravel[:, ::step])
        save(tmp_path / folder / "stone_height.png", height[:, ::step])
    made = marks(np.s_[20:34, 30:44])
    sources = {"texture": tmp_path / "texture", "exemplar": tmp_path / "exemplar"}
    sources["region"] = spot_of(tmp_path, np.s_[20:34, 30:44])
    exports = ran(tmp_path / "out", "revise", sources, **REVISED)
    for name in ("stone_albedo.png", "stone_height.png", "stone_normal_dx.png"):
        before, after = saved(tmp_path / "texture" / name), saved(exports["maps/"] / name)
        assert after.dtype == before.dtype
        np.testing.assert_array_equal(after[~made], before[~made])
        assert (after[made] != before[made]).any()


def test_a_refined_texture_has_no_worse_joints(ran: Any, gravel: np.ndarray, tmp_path: Path) -> None:
    path = save(tmp_path / "gravel.png", gravel)
    small = {"size": "88x80", "texture.preset": "fast", "refined.places": "2", "refined.tries": "1", "rounds": "1"}
    exports = ran(tmp_path / "out", "refine", {"exemplar": path}, **small)
    changed = exports["changed.png"] > 0
    assert changed.shape == exports["texture.png"].shape[:2] == (80, 88)
    assert exports["report.html"].stat().st_size > 0
    places = exports["places.json"]
    assert places["after"] <= places["before"]
    assert changed.any() == any(place["improved"] for place in places["places"])
