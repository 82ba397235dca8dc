from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import texloom
from tests.photographs import unit_square
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.analysis.structure.dog_mask import DogMaskParams
from texloom.stages.interactive.photo_session import PhotoSession
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Document, InputError

SHAPE = (96, 128)
CORNERS = [[20.0, 30.0], [25.0, 95.0], [90.0, 120.0], [85.0, 5.0]]
LEFT = {"name": "left", "corners": [[10.5, 3], [12, 50], [80, 60], [88, 5]], "size": "1.5x2"}
RIGHT = {"name": "right", "corners": [[12, 45], [8, 120], [92, 121], [80, 50]], "size": "2.25x2"}


@pytest.fixture(scope="module")
def photo() -> Image:
    return picture(smooth_noise((*SHAPE, 3), 1.5, np.random.default_rng(3)))


def field_of(photo: Image, file: Path) -> Any:
    document = Document.of(file, yaml.safe_load(file.read_text()))
    return jacobian_field(photo, JacobianFieldParams(geometry=document))


def edited(photo: Image) -> PhotoSession:
    """A session in which everything was changed."""
    session = PhotoSession(photo, {"patches": [LEFT], "without": [[[0, 0], [0, 9], [9, 9]]]})
    session.place("right", RIGHT["corners"], size=(2, 2.25))
    session.place("wrong", CORNERS)
    session.remove("wrong")
    session.move("left", (1, -1.5))
    session.distortion()
    session.move_corner("right", 2, (91.25, 118))
    session.move_control("left", (1, 2), (30, 35.1234567), weight=1e-5 + 1)
    session.stroke("region", [(20, 20), (60, 100)], 15)
    session.outline("region", [(70, 10), (70, 30), (85, 20)])
    session.stroke("region", [(40, 60)], 4, erase=True)
    session.stroke("features.joints", [(30, 30), (50, 30)], 1.5)
    return session


def test_the_distortion_is_bit_identical_to_that_of_the_saved_file(photo: Image, tmp_path: Path) -> None:
    session = edited(photo)
    session.save(tmp_path / "wall.yaml")
    file = tmp_path / "wall_geometry.yaml"
    wanted = field_of(photo, file)
    assert wanted.features.any()
    assert 0 < wanted.region.sum() < wanted.region.size
    for name, value in vars(session.distortion()).items():
        np.testing.assert_array_equal(value, getattr(wanted, name), err_msg=name)
    # and so is that of a session which begins with the file
    again = PhotoSession(photo, Document.of(file, yaml.safe_load(file.read_text())))
    assert again.patches == ("left", "right")
    np.testing.assert_array_equal(again.distortion().jacobian, wanted.jacobian)
    np.testing.assert_array_equal(again.pixels("region"), session.pixels("region"))


def test_the_saved_flow_runs_with_the_distortion_of_the_session(tmp_path: Path) -> None:
    import skimage

    brick = skimage.data.brick()[:128, :128]
    skimage.io.imsave(tmp_path / "brick.png", brick)
    session = PhotoSession(brick, detail=0.5)
    session.place("wall", [[120, 4], [10, 15], [10, 110], [120, 124]], size=(1, 1))
    flow = session.save(tmp_path / "wall.yaml", "brick.png")
    done = texloom.run(flow, size=64, store=tmp_path / "store", out=tmp_path / "out")
    np.testing.assert_array_equal(done["surface"].jacobian, session.distortion().jacobian)
    assert done["texture"].image.shape[:2] == (64, 64)


def test_only_the_patch_that_moves_is_computed_again(photo: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    from texloom.stages.interactive import photo_session

    session = PhotoSession(photo, {"patches": [LEFT, RIGHT]})
    session.move_control("left", (1, 1), (30, 20))  # before: a plane's corner may change the focal length of all
    computed = []
    measured = photo_session.coverage

    def counted(patch: Any, shape: Any) -> Any:
        computed.append(patch.name)
        return measured(patch, shape)

    monkeypatch.setattr(photo_session, "coverage", counted)
    session.distortion()
    session.move_control("left", (2, 1), (60, 20))
    session.distortion()
    session.stroke("hole", [(40, 60)], 5)
    session.distortion()
    assert computed == ["patch 'left'", "patch 'right'", "patch 'left'"]


def test_a_plane_that_becomes_curved_lies_as_before(photo: Image) -> None:
    plane, curved = (PhotoSession(photo, {"patches": [{"corners": CORNERS, "beyond": 0.05}]}) for _ in range(2))
    points, _ = plane.controls("patch_1")
    curved.move_control("patch_1", (1, 1), tuple(points[1, 1]))
    np.testing.assert_allclose(curved.distortion().jacobian, plane.distortion().jacobian, rtol=1e-5, atol=1e-5)


def test_corners_of_a_curved_patch_take_the_others_along(photo: Image) -> None:
    session = PhotoSession(photo)
    session.place("wall", CORNERS)
    before, _ = session.controls("wall")
    session.move_control("wall", (1, 1), tuple(before[1, 1]))
    session.move_corner("wall", 2, (93, 126))
    moves = session.controls("wall")[0] - before
    np.testing.assert_allclose(moves[3, 3], (3, 6), atol=1e-9)
    np.testing.assert_allclose(moves[1, 2], np.array([3, 6]) * 2 / 9, atol=1e-9)
    np.testing.assert_allclose(moves[0], 0, atol=1e-9)


def test_the_coarse_distortion_is_that_of_the_photograph_reduced(photo: Image) -> None:
    session = PhotoSession(photo, {"patches": [LEFT], "hole": [[[20, 20], [20, 60], [60, 60]]]}, coarse_side=64)
    coarse, fine = session.coarse(), session.distortion()
    assert coarse.jacobian.shape == (48, 64, 4)
    whole = fine.jacobian.reshape(48, 2, 64, 2, 4).mean(axis=(1, 3)) * fine.scale / 2 / coarse.scale
    inside = coarse.region & fine.region[::2, ::2] & fine.region[1::2, 1::2]
    np.testing.assert_allclose(coarse.jacobian[inside], whole[inside], rtol=0.02, atol=0.03)
    assert (coarse.hole != fine.hole[::2, ::2]).mean() < 0.02


def test_a_preview_shows_a_plane_from_the_front() -> None:
    place = unit_square(CORNERS, *np.indices(SHAPE).astype(float))
    checks = (np.floor(4 * place[..., 0]) + np.floor(6 * place[..., 1])) % 2
    session = PhotoSession(picture(np.repeat(checks[..., None], 3, 2)))
    session.place("floor", CORNERS, size=(2, 3))
    shown = session.preview("floor", 96)
    assert shown.shape == (64, 96, 4)
    centres = shown[8::16, 8::16, 0] > 127
    np.testing.assert_array_equal(centres, np.indices((4, 6)).sum(axis=0) % 2 == 1)
    assert (shown[..., 3] == 255).all()
    session.move("floor", (-60, 0))
    assert 0 < (session.preview("floor", 96)[..., 3] == 0).mean() < 1


def test_a_texture_from_the_reduced_photograph(photo: Image) -> None:
    session = PhotoSession(photo, {"patches": [LEFT]})
    made = session.texture((48, 64))
    assert made.shape == (48, 64, 3)
    assert made.std() > 5
    np.testing.assert_array_equal(made, session.texture((48, 64)))


def test_validity_says_what_is_wrong_while_a_patch_is_moved(photo: Image) -> None:
    session = PhotoSession(photo, {"patches": [LEFT, RIGHT]})
    session.move_corner("right", 0, (200, 200))
    problems = session.validity()
    assert problems["left"] is None
    assert problems["right"] == "patch 'right': crosses the horizon: no plane in perspective has such corners"
    with pytest.raises(InputError, match="patch 'right': crosses the horizon"):
        session.coarse()
    session.move_corner("right", 0, (12, 45))
    assert session.validity() == {"left": None, "right": None}
    session.coarse()


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda session: session.coarse(), "patches: there is none; place one"),
        (lambda session: session.preview("wall"), "patch 'wall': there is none of this name"),
        (lambda session: session.place("wall", [[0, 0], [1, 1]]), r"want 4 points \(row, column\)"),
        (lambda session: session.stroke("regoin", [(1, 1)], 3), "area 'regoin': want one of region, without, hole"),
    ],
)
def test_bad_requests_are_refused(photo: Image, act: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        act(PhotoSession(photo))


def test_cleared_areas_are_gone(photo: Image) -> None:
    session = edited(photo)
    for area in ("region", "without", "features.joints"):
        session.clear(area)
    assert session.content().keys() == {"patches"}
    assert not session.distortion().features.any()


def test_planes_are_proposed() -> None:
    import skimage.data

    session = PhotoSession(skimage.data.brick())
    assert session.propose() == ("plane_1",)
    assert session.validity() == {"plane_1": None}
    assert session.coarse().region.mean() > 0.7


def test_filling_takes_what_is_connected_and_alike() -> None:
    levels = np.full((64, 64), 40, np.uint8)
    levels[10:30, 10:30] = levels[40:60, 40:60] = 200
    session = PhotoSession(levels)
    session.fill("hole", (20, 20), 5)
    assert np.array_equal(np.argwhere(session.pixels("hole"))[[0, -1]], [[10, 10], [29, 29]])
    session.fill("hole", (15, 15), 5, erase=True)
    session.fill("hole", (-3, 70), 5)
    assert not session.pixels("hole").any()


def test_marking_takes_features_of_the_whole_photograph() -> None:
    levels = np.full((64, 64), 120, np.uint8)
    levels[:, 30:33] = 20
    session = PhotoSession(levels)
    session.mark("features.joints", DogMaskParams(inner=1, outer=8))
    columns = np.flatnonzero(session.pixels("features.joints").any(axis=0))
    assert {30, 31, 32} <= set(columns) <= set(range(28, 35))


def test_streamlines_follow_the_texture(photo: Image) -> None:
    session = PhotoSession(photo)
    session.place("frontal", [[0, 0], [0, 127], [95, 127], [95, 0]])
    down, across = session.streamlines(across=8)
    assert len(down) == 48
    np.testing.assert_allclose(down[..., 1], np.broadcast_to(down[:, :1, 1], down.shape[:2]), atol=1e-6)
    np.testing.assert_allclose(across[..., 0], np.broadcast_to(across[:, :1, 0], across.shape[:2]), atol=1e-6)
    assert (np.diff(down[..., 0], axis=1) > 0).all()


def test_patches_are_replaced_unchecked(photo: Image) -> None:
    session = PhotoSession(photo, {"patches": [LEFT]})
    session.replace([RIGHT, {"name": "wrong", "corners": RIGHT["corners"][::-1]}])
    assert session.patches == ("right", "wrong")
    assert session.validity()["right"] is None
    assert session.validity()["wrong"] is not None
