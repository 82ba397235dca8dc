"""Flat textures from rendered photographs of textures that are known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.photographs import analysed, made, repeating, surfaces, unit_square
from tests.synthetic import picture
from texloom.stages.analysis.photographs.hole_window import HoleWindowParams, hole_window
from texloom.stages.analysis.photographs.unroll import UnrollParams, unroll
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.synthesis.photographs.place_texture import PlaceTextureParams, place_texture
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.sizes import size_value

SIDE = 128
FINER = 6  # samples a px and side of the rendering
PLANE = [[10.0, 44.0], [10.0, 84.0], [128.0, 180.0], [128.0, -52.0]]  # of a plane of 2 x 1
REGION = [[14, 0], [14, SIDE - 1], [SIDE - 1, SIDE - 1], [SIDE - 1, 0]]
CELLS = 8  # of a checkerboard, across
COURSES = 7  # in a unit of the plane, down
DIRECTION = np.array([4.8, 6.4])  # periods of stripes in a unit of the plane, down and across
HALF = 0.8  # angle that is seen of a column, to each side

Pattern = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""of places down and across the texture"""


def stripes(down: np.ndarray, across: np.ndarray) -> np.ndarray:
    return np.asarray(np.floor(2 * (down * DIRECTION[0] + across * DIRECTION[1])) % 2)


def checkers(down: np.ndarray, across: np.ndarray) -> np.ndarray:
    return np.asarray((np.floor(down * CELLS) + np.floor(across * CELLS)) % 2)


def courses(down: np.ndarray, across: np.ndarray) -> np.ndarray:
    return np.asarray(np.floor(2 * down * COURSES) % 2 * (1 - 0.3 * np.sin(40 * across) ** 2))


def samples() -> tuple[np.ndarray, np.ndarray]:
    rows, columns = (np.indices((SIDE * FINER, SIDE * FINER)) + 0.5) / FINER - 0.5
    return rows, columns


def rendered(fine: np.ndarray) -> Image:
    """Every pixel a mean over its area."""
    return picture(fine.reshape(SIDE, FINER, SIDE, FINER).mean(axis=(1, 3)))


def plane(pattern: Pattern) -> Image:
    """A plane that runs away from the viewer."""
    down, across = np.moveaxis(unit_square(PLANE, *samples()), 2, 0)
    return rendered(pattern(2 * down, across))


def column(pattern: Pattern) -> tuple[Image, dict[str, Any]]:
    """A column of radius 1, its axis 4 away, and the patch that it is; texture units are lengths on its surface."""
    focal, middle = 1.2 * SIDE, (SIDE - 1) / 2
    rows, columns = samples()
    slope = (columns - middle) / focal
    root = np.sqrt(np.maximum(16 - 15 * (1 + slope**2), 0))
    depth = (4 - root) / (1 + slope**2)
    photo = rendered(pattern((rows - middle) / focal * depth + 4, np.arctan2(slope * depth, 4 - depth) + 4))
    bow = 4 / 3 * np.tan(HALF / 2)
    side, near = np.sin(HALF), np.cos(HALF)
    handle = side - bow * near, -near - bow * side
    arc = [(-side, -near), (-handle[0], handle[1]), handle, (side, -near)]
    space = np.array([[[down, x, 4 + z] for x, z in arc] for down in np.linspace(-1.2, 1.2, 4)])
    controls = focal * space[..., :2] / space[..., 2:] + middle
    return photo, {
        "controls": controls.tolist(),
        "weights": space[..., 2].tolist(),
        "size": size_value((2.4, 2 * HALF)),
    }


def direction_of(flat: np.ndarray) -> np.ndarray:
    """Periods a pixel, down and across, of the strongest wave."""
    window = np.outer(np.hanning(len(flat)), np.hanning(len(flat)))
    spectrum = np.abs(np.fft.fft2((flat - flat.mean()) * window, (1024, 1024)))[:512]
    peak = np.array(np.unravel_index(spectrum.argmax(), spectrum.shape))
    return np.array([peak[0], (peak[1] + 512) % 1024 - 512]) / 1024


def true_texture(pattern: Pattern, scale: float) -> Image:
    """The flat texture as it should be."""
    rows, columns = samples()
    return rendered(pattern((rows + 0.5) / scale, (columns + 0.5) / scale))


def check_stripes(flat: np.ndarray, scale: float) -> None:
    measured, expected = direction_of(flat), DIRECTION / scale
    assert np.hypot(*measured) == pytest.approx(np.hypot(*expected), rel=0.07)
    assert np.arctan2(*measured) == pytest.approx(np.arctan2(*expected), abs=np.radians(5))


def scores(pattern: Pattern, flat: Image, scale: float) -> dict[str, float]:
    """The mean scores of the axes of it beside the true texture."""
    lines = metrics(true_texture(pattern, scale), flat, MetricsParams()).table["measures"].values()
    axes: dict[str, list[float]] = {}
    for line in lines:
        if line["score"] is not None:
            axes.setdefault(line["axis"], []).append(line["score"])
    return {axis: sum(known) / len(known) for axis, known in axes.items()}


def recovered(photo: Image, folder: Path, content: dict[str, Any]) -> tuple[Image, float]:
    """The flat texture, and its elements in a unit."""
    surface = surfaces(photo, folder, **content)
    levels, look = analysed(photo, surface)
    return made(levels, look, size=(SIDE, SIDE), inputs=repeating(levels)).image, surface.scale


def patch_of_plane() -> dict[str, Any]:
    return {"patches": [{"corners": PLANE, "size": "1x2"}], "region": [REGION]}


def test_stripes_of_a_plane(tmp_path: Path) -> None:
    flat, scale = recovered(plane(stripes), tmp_path, patch_of_plane())
    check_stripes(flat.pixels[..., 0], scale)
    assert scores(stripes, flat, scale)["fidelity"] > 0.92


def test_stripes_of_a_column(tmp_path: Path) -> None:
    """A curved surface, whose border is foreshortened."""
    photo, patch = column(stripes)
    flat, scale = recovered(photo, tmp_path, {"patches": [patch]})
    check_stripes(flat.pixels[..., 0], scale)
    assert scores(stripes, flat, scale)["fidelity"] > 0.82


@pytest.mark.parametrize(
    ("repeats", "distant", "most"), [(True, False, 0.06), (False, False, 0.2), (False, True, 0.15)]
)
def test_a_checkerboard_has_its_cells(repeats: bool, distant: bool, most: float, tmp_path: Path) -> None:
    """[Eisenacher2008]_ Figure 16: few cells of the photograph are sharp."""
    photo = plane(checkers)
    surface = surfaces(photo, tmp_path, **patch_of_plane())
    levels, look = analysed(photo, surface, distant=distant)
    flat = made(levels, look, size=(SIDE, SIDE), inputs=repeating(levels) if repeats else {}).image
    if repeats:
        assert scores(checkers, flat, surface.scale)["fidelity"] > 0.92
    seen = flat.pixels[..., 0] > 0.5
    # straight: all cells together are those of one checkerboard
    rows, columns = (np.arange(SIDE) / surface.scale)[:, None], np.arange(SIDE) / surface.scale
    starts = np.arange(0, 2, 0.1) / CELLS
    boards = [checkers(rows + i, columns + j) > 0 for i in starts for j in starts]
    board = min(boards, key=lambda one: np.count_nonzero(one != seen))
    assert np.mean(board != seen) < most
    measured, expected = (
        sum(np.count_nonzero(np.diff(one, axis=axis)) for axis in (0, 1)) for one in (seen, board)
    )
    assert measured == pytest.approx(expected, rel=0.25)


def test_courses_stay_straight(tmp_path: Path) -> None:
    """Of a wall that runs away from the viewer: laid flat, and in the texture made from it."""
    photo = plane(courses)
    surface = surfaces(photo, tmp_path, **patch_of_plane())
    levels, look = analysed(photo, surface)
    laid = unroll(levels.image, levels.jacobian, levels.valid, UnrollParams()).image.pixels
    texture = made(levels, look, size=(SIDE, SIDE), inputs=repeating(levels)).image
    for light, shown in ((laid[..., 0], laid[..., 3] > 0), (texture.pixels[..., 0], np.ones((SIDE, SIDE), bool))):
        wave = np.exp(-2j * np.pi * COURSES / surface.scale * np.arange(len(light)))
        phases = wave @ np.where(shown, light - light[shown].mean(), 0)
        phases = phases[shown.sum(axis=0) > 1.5 * surface.scale / COURSES]
        off = np.angle(phases / phases.mean()) / (2 * np.pi)
        assert np.quantile(np.abs(off), 0.95) < 0.03


def test_light_on_a_checkerboard_is_evened(tmp_path: Path) -> None:
    """Cells lit from one side come out as those lit evenly do."""
    photo = plane(checkers)
    lit = Image(photo.pixels * np.linspace(0.4, 1, SIDE, dtype=np.float32)[None, :, None], photo.channels)
    surface = surfaces(lit, tmp_path, **patch_of_plane())
    white = {}
    for even in (0.0, 1.0):
        levels, look = analysed(lit, surface, even=even)
        flat = made(levels, look, size=(SIDE, SIDE)).image.pixels[..., 0]
        bright = flat[flat > 0.7 * np.median(flat[flat > flat.mean()])]
        white[even] = bright.std() / bright.mean()
    assert white[1.0] < 0.7 * white[0.0]


def test_a_hole_is_filled_in_step(tmp_path: Path) -> None:
    """What repeats goes on where it is hidden, less exactly where its generators are not given."""
    photo = plane(stripes)
    hole = [[48, 50], [48, 80], [68, 84], [68, 44]]
    surface = surfaces(photo, tmp_path, hole=[hole], **patch_of_plane())
    levels, look = analysed(photo, surface)
    repeats = repeating(levels)
    window = hole_window(
        surface.hole, surface.jacobian, HoleWindowParams(), surface.region, levels.corner, repeats["chart"]
    )
    bent = {"target_jacobian": window.jacobian, "fixed": window.fixed, "fixed_match": window.fixed_match}
    for inputs, most in (({}, 0.2), (repeats | {"target_chart": window.chart}, 0.1)):
        off = []
        for seed in range(1, 6):
            positions = made(levels, look, seed, bent | inputs).positions
            assert positions is not None
            filled = place_texture(
                positions, levels.sharp, levels.jacobian, window.jacobian, photo, window.hole,
                PlaceTextureParams(), levels.known, window.corner,
            ).image  # fmt: skip
            np.testing.assert_array_equal(filled.pixels[~surface.hole], photo.color[~surface.hole])
            off.append(np.abs(filled.pixels - photo.color)[surface.hole].mean())
        assert np.median(off) < most
