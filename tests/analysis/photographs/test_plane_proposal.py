"""Planes of known pose, and photographs without any."""

from __future__ import annotations

import dataclasses
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.photographs import unit_square
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs import plane_proposal as module
from texloom.stages.analysis.photographs.depth_cues import DepthCues
from texloom.stages.analysis.photographs.plane_candidates import Cells, PlaneCandidate, plane_candidates
from texloom.stages.analysis.photographs.plane_proposal import (
    PlaneProposalParams,
    find_planes,
    plane_proposal,
)
from texloom.stages.analysis.photographs.plane_ranking import RankedPlane
from texloom.stages.common.features.line_segments import Frame, Segments
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (360, 480)
FINE = 3  # px of a rendered px
BRICK = 24  # px of a brick's height


def bricks(rows: int, columns: int, staggered: bool, rng: np.random.Generator) -> np.ndarray:
    """Dark bricks with bright joints, from the edges of the outermost bricks."""
    joint = BRICK // 8
    wall = np.full((rows * BRICK, columns * 2 * BRICK), 0.7, np.float32)
    for row in range(rows):
        for column in range(-1, columns):
            left = (2 * column + 1 + (row % 2 if staggered else 1)) * BRICK
            ends = max(0, left + joint), left + 2 * BRICK - joint
            wall[row * BRICK + joint : (row + 1) * BRICK - joint, ends[0] : ends[1]] = rng.uniform(0.1, 0.4)
    return wall[joint:-joint, 0 if staggered else joint : -joint or None]


def pixels(points: Any) -> np.ndarray:
    """Row and column of points in space (right, down, away) through a lens of 450 px."""
    at = np.asarray(points, float)
    return 450 * at[:, 1::-1] / at[:, 2:] + (np.array(SHAPE) - 1) / 2


def rectangle(height: float, width: float, tilt: float, turn: float, roll: float) -> np.ndarray:
    """Corners in space of a rectangle 5 away."""
    import cv2

    square = np.array([[-width, -height, 0], [width, -height, 0], [width, height, 0], [-width, height, 0]]) / 2
    return square @ cv2.Rodrigues(np.array([tilt, turn, roll]))[0].T + [0, 0, 5]


def rendered(walls: list[tuple[np.ndarray, np.ndarray]], rng: np.random.Generator) -> Image:
    """Textures on planes between their corners, before a dim background."""
    import cv2

    light = 0.5 + 0.1 * smooth_noise(SHAPE, 4, rng)
    fine = (FINE * SHAPE[1], FINE * SHAPE[0])
    for texture, corners in walls:
        height, width = texture.shape
        source = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
        target = (corners[:, ::-1] + 0.5) * FINE - 0.5
        matrix = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
        values, inside = (
            cv2.resize(cv2.warpPerspective(plane, matrix, fine), SHAPE[::-1], interpolation=cv2.INTER_AREA)
            for plane in (texture, np.ones_like(texture))
        )
        light = values + (1 - inside) * light
    return picture(np.clip(light + rng.normal(0, 0.01, SHAPE), 0, 1))


def corner_error(true: np.ndarray, proposed: np.ndarray) -> float:
    """The largest distance between corners, as a share of the shortest side."""
    side = np.hypot(*(np.roll(true, -1, axis=0) - true).T).min()
    return float(np.hypot(*(proposed - true).T).max() / side)


@pytest.mark.parametrize("staggered", [False, True])
@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.1), (0.2, -0.5, 0.1), (-0.5, 0.1, 0.0), (0.3, 0.45, -0.15)])
def test_corners_of_planes_of_known_pose(
    pose: tuple[float, float, float], staggered: bool, rng: np.random.Generator
) -> None:
    corners = pixels(rectangle(2.4, 3.2, *pose))
    proposal = plane_proposal(rendered([(bricks(10, 7, staggered, rng), corners)], rng), PlaneProposalParams())
    assert len(proposal.corners) == 1
    assert corner_error(corners, proposal.corners[0]) < 0.01


def large_tiles(rng: np.random.Generator) -> np.ndarray:
    """A row of tiles of upright grain, from joint to joint."""
    wall = np.tile(0.25 + 0.1 * rng.random((1, 120)).repeat(4, axis=1), (360, 1))
    for joint in (0, 357):
        wall[joint : joint + 3] = 0.8
    for joint in (0, 120, 240, 360, 477):
        wall[:, joint : joint + 3] = 0.8
    return wall.astype(np.float32)


def test_joints_that_are_far_apart_lie_on_one_plane(rng: np.random.Generator) -> None:
    corners = pixels(rectangle(2.9, 3.8, -0.4, 0.1, 0.0))
    proposal = plane_proposal(rendered([(large_tiles(rng), corners)], rng), PlaneProposalParams(extend=False))
    assert corner_error(corners, proposal.corners[0]) < 0.02


@pytest.mark.parametrize(("repetition", "goes_on"), [(0.9, True), (0.8, False)])
def test_a_plane_is_extended_that_is_less_even_then_but_repeats(
    repetition: float, goes_on: bool, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall = np.tile(large_tiles(rng), (2, 1))[90:-90]
    photo = rendered([(wall, pixels(rectangle(4.4, 4.2, -0.3, 0.0, 0.0)))], rng)

    def less_even(_: Any, candidate: PlaneCandidate, *__: Any) -> RankedPlane:
        return RankedPlane(candidate, repetition, evenness=0.1, straightness=1.0)

    monkeypatch.setattr(module, "measured", less_even)
    assert (plane_proposal(photo, PlaneProposalParams()).table["extended"] > 1.3) == goes_on


def test_a_plane_beyond_the_photograph_is_cut_to_what_is_shown() -> None:
    cells = Cells(SHAPE)
    rows, columns = np.arange(-540.0, 360.0, 45), np.arange(-480.0, 960.0, 48)  # a sixth of it is shown
    corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=2).reshape(-1, 2)
    down, across = ([corners, corners + step] for step in ((45, 0), (0, 48)))
    ends = cells.places(np.concatenate([np.stack(each, axis=1) for each in (down, across)]))
    points = [np.array([1.0, 0, 0]), np.array([0, 1.0, 0])]
    (candidate,) = plane_candidates(Segments(ends), points, cells)
    found = cells.pixels(candidate.corners)
    assert corner_error(np.array([[0, 0], [0, 479], [359, 479], [359, 0]], float), found) < 0.15


def test_both_walls_of_a_corner(rng: np.random.Generator) -> None:
    edge, up = np.array([0, 0, 4]), np.array([0, -1.2, 0])
    left, right = np.array([-2.3, 0, 5.9]), np.array([2.2, 0, 6])
    walls = [pixels([a + up, b + up, b - up, a - up]) for a, b in ((left, edge), (edge, right))]
    photo = rendered([(bricks(12, 8, False, rng), corners) for corners in walls], rng)
    found = find_planes(photo)
    proposed = Frame(SHAPE).pixels(found.corners(3))
    assert len(proposed) == 2
    for corners in walls:
        assert min(corner_error(corners, other) for other in proposed) < 0.01
    assert len(found.corners(1)) == 1
    taken = [plane_proposal(photo, PlaneProposalParams(plane=number)) for number in (1, 2)]
    for proposal, number in zip(taken, (1, 2), strict=True):
        np.testing.assert_allclose(proposal.corners[0], proposed[number - 1], rtol=1e-5)
        assert proposal.table["taken"] == number
    assert (taken[0].picture.pixels != taken[1].picture.pixels).any()
    with pytest.raises(InputError, match="there is no plane 8; 2 are proposed"):
        plane_proposal(photo, PlaneProposalParams(plane=8))


def test_a_photographed_wall_is_straightened() -> None:
    """Two joints of skimage:brick that run along the same number of courses apart are parallel in the plane."""
    import skimage.data

    proposed = plane_proposal(Image.of(skimage.data.brick()), PlaneProposalParams()).corners[0]
    joints = np.array([[512, 7], [0, 70.5], [512, 427.5], [0, 365.7]])
    place = unit_square(proposed, *joints.T)[:, 1]
    assert abs(place[0] - place[1]) < 0.01
    assert abs(place[2] - place[3]) < 0.01


def test_no_plane_is_proposed_where_a_file_tells(tmp_path: Path) -> None:
    import skimage.data

    (tmp_path / "wall.json").write_text(
        '{"patches": [{"corners": [[0, 0], [0, 9], [9, 9], [9, 0]], "size": "1x1"}]}'
    )
    params = PlaneProposalParams.model_validate({"geometry": tmp_path / "wall.json"})
    assert plane_proposal(Image.of(skimage.data.brick()), params).corners.shape == (0, 4, 2)


def test_no_plane_without_lines_in_two_directions(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    columns = np.tile(np.linspace(0, 40 * np.pi, 320), (240, 1))
    for plane in (smooth_noise((240, 320), 2, rng), 0.5 + 0.4 * np.sign(np.sin(columns)), np.full((60, 80), 0.5)):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            result = plane_proposal(picture(plane), PlaneProposalParams())
        assert result.corners.shape == (0, 4, 2)
        assert "no plane is evident" in caplog.text


def gravel_on(rows: np.ndarray, columns: np.ndarray) -> Image:
    """Stones at places of a flat texture, px, without lines."""
    import skimage.data
    from scipy.ndimage import map_coordinates

    values = map_coordinates(skimage.data.gravel() / 255.0, [rows, columns], order=1, mode="reflect")
    return picture(values.astype(np.float32))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_cylinder_of_stones_is_no_frontal_plane(axis: int) -> None:
    rows, columns = np.indices((400, 400)).astype(float)
    place = [rows * 0.8, columns * 0.8]
    place[axis] = 256 + 230 * np.arcsin((place[axis] / 160 - 1) * 0.89) / 1.1
    with pytest.raises(InputError, match=r"curved surface.*control points of the surface.*--set plane=0"):
        plane_proposal(gravel_on(*place), PlaneProposalParams())
    assert not len(plane_proposal(gravel_on(*place), PlaneProposalParams(plane=0)).corners)


def test_a_ground_of_stones_is_no_frontal_plane() -> None:
    rows, columns = np.indices((400, 400)).astype(float)
    away = 1 / (0.3 + rows / 400)
    with pytest.raises(InputError, match=r"finer to one side.*--set geometry=my\.yaml"):
        plane_proposal(gravel_on(100 * away, 256 + (columns - 200) * away / 2), PlaneProposalParams())


def test_lines_that_converge_are_not_frontal(rng: np.random.Generator) -> None:
    from texloom.stages.analysis.photographs.depth_cues import depth_cues
    from texloom.stages.common.features.line_segments import Segments

    towards = np.array([-0.2, 0.1])
    starts = rng.uniform((0.1, -0.8), (0.6, 0.8), (80, 2))
    segments = Segments(np.stack([starts, starts + 0.2 * (towards - starts)], axis=1))
    point = np.array([*towards, 1])
    cues = depth_cues(picture(np.full((60, 80), 0.5)), segments, [point / np.sqrt((point**2).sum())])
    assert cues.converging > 0.99
    assert "converge" in cues.reason


def test_several_surfaces_are_not_frontal(rng: np.random.Generator) -> None:
    parts = np.full((240, 320), 0.8)
    parts[:, :170] = 0.3 + 0.2 * smooth_noise((240, 170), 1, rng)
    parts[130:] = 0.05
    with pytest.raises(InputError, match="its parts differ"):
        plane_proposal(picture(np.clip(parts, 0, 1)), PlaneProposalParams())


def test_weak_signs_of_depth_count_where_parts_differ(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo = picture(smooth_noise((240, 320), 2, rng))
    as_found = module.as_frontal

    def uneven(*of: Any) -> RankedPlane:
        return dataclasses.replace(as_found(*of), repetition=0.2, evenness=0.6)

    monkeypatch.setattr(module, "depth_cues", lambda *_: DepthCues(0.0, False, False, "a little finer"))
    assert find_planes(photo).hint == "a little finer"
    monkeypatch.setattr(module, "as_frontal", uneven)
    assert "a little finer, and its parts differ" in find_planes(photo).doubt


@pytest.mark.parametrize("converge", [False, True])
def test_a_frontal_surface_that_comes_before_a_plane_is_examined(
    converge: bool, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = pixels(rectangle(2.9, 3.8, -0.4, 0.1, 0.0))
    photo = rendered([(large_tiles(rng), corners)], rng)
    as_found = module.as_frontal

    def frontal(*of: Any) -> RankedPlane:
        return dataclasses.replace(as_found(*of), repetition=0.45, evenness=0.6, straightness=1.0)

    def barely(*of: Any) -> list[RankedPlane]:
        return [dataclasses.replace(plane, repetition=0.5, evenness=0.5, straightness=0.4) for plane in found(*of)]

    found = module.ranked
    monkeypatch.setattr(module, "as_frontal", frontal)
    monkeypatch.setattr(module, "ranked", barely)
    monkeypatch.setattr(module, "depth_cues", lambda *_: DepthCues(0.3 * converge, False, False))
    planes = find_planes(photo)
    assert planes.best == int(converge)
    assert ("several surfaces" in planes.hint) != converge


def test_a_wall_comes_before_clutter(rng: np.random.Generator) -> None:
    """Rectangles of all sizes on a frontal plane have longer lines in all than the bricks."""
    wall = pixels(rectangle(1.5, 2.2, 0.2, -0.5, 0.1) + np.array([-0.9, 0.3, 0]))
    clutter = np.full((200, 300), 0.5, np.float32)
    for _ in range(60):
        top, left = (int(rng.integers(0, side - 8)) for side in clutter.shape)
        height, width = rng.integers(4, 80, 2)
        clutter[top : top + height, left : left + width] = rng.uniform(0.1, 0.9)
    plate = np.array([[5.0, 200], [5, 470], [350, 470], [350, 200]])
    scene = rendered([(clutter, plate), (bricks(10, 7, True, rng), wall)], rng)
    found = find_planes(scene)
    assert found.best == 1
    assert corner_error(wall, Frame(SHAPE).pixels(found.planes[0].candidate.corners)) < 0.03


def test_a_plane_straightens_to_two_degrees(rng: np.random.Generator) -> None:
    """Directions of the proposed sides, laid flat by the true geometry."""
    corners = pixels(rectangle(2.4, 3.2, 0.3, 0.45, -0.15))
    (proposed,) = plane_proposal(
        rendered([(bricks(10, 7, True, rng), corners)], rng), PlaneProposalParams()
    ).corners
    flat = unit_square(corners, *proposed.T) * (2.4, 3.2)
    sides = np.roll(flat, -1, axis=0) - flat
    off = np.degrees(np.arctan2(np.abs(sides).min(axis=1), np.abs(sides).max(axis=1)))
    assert off.max() < 2


def test_a_trunk_that_turns_away_little_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """Stones that become finer to one side, less than what is refused."""
    rows, columns = np.indices((400, 400)).astype(float)
    image = gravel_on(0.8 * rows, 240 * (np.exp(columns / 400) - 1))
    with caplog.at_level(logging.WARNING):
        table = plane_proposal(image, PlaneProposalParams()).table
    assert "a little finer to one side" in table["doubt"]
    assert "--set geometry=my.yaml" in caplog.text
    assert plane_proposal(image, PlaneProposalParams(plane=0)).table["doubt"] == ""
    assert plane_proposal(gravel_on(rows, columns), PlaneProposalParams()).table["doubt"] == ""
