"""Compaction of oriented textures."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.control.orientation_field import OrientationFieldParams, orientation_field
from texloom.stages.common.geometry.orientation import signed_angles
from texloom.stages.synthesis.inverse.compact_oriented import (
    CompactedOriented,
    CompactOrientedParams,
    compact_oriented,
)
from texloom.stages.synthesis.reconstruction.reconstruct import ReconstructParams, reconstruct
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

SHAPE = (72, 96)


def radius() -> np.ndarray:
    """Distance from the middle, px."""
    return np.asarray(np.hypot(*(np.indices(SHAPE) - np.array([36.0, 48.0])[:, None, None])))


def rings() -> tuple[Image, np.ndarray]:
    """Dashed rings, and the direction along them."""
    rows, columns = np.indices(SHAPE) - np.array([36.0, 48.0])[:, None, None]
    distance, around = radius(), np.arctan2(rows, columns)
    dashes = np.sin(distance.astype(int) // 7 * 2.4 + around * distance / 6) > 0
    tone = 0.15 + 0.6 * (0.5 + 0.5 * np.sin(2 * np.pi * distance / 7)) * (0.4 + 0.6 * dashes)
    return picture(tone), ((around + np.pi / 2) % np.pi).astype(np.float32)


def run(
    texture: Image, angle: np.ndarray, control: Image | None = None, seed: int = 3, **params: object
) -> CompactedOriented:
    defaults = {"size": (24, 24), "spacing": 2, "orientation_updates": 0, "coarsest": 20}
    checked = CompactOrientedParams.model_validate(defaults | params)
    return compact_oriented(texture, texture.pixels * 100, angle, checked, np.random.default_rng(seed), control)


def off(angle: np.ndarray, true: np.ndarray, counted: np.ndarray) -> float:
    """Median difference of orientations at some pixels, degrees, less one angle that is the same everywhere.

    By that the compaction is rotated.
    """
    difference = (angle - true)[counted]
    turn = np.angle(np.exp(2j * difference).mean()) / 2
    return float(np.degrees(np.median(np.abs((difference - turn + np.pi / 2) % np.pi - np.pi / 2))))


def test_the_orientation_field_lowers_the_energy() -> None:
    """Along the rings the same small picture lacks far less than with one direction for all."""
    texture, angle = rings()
    constant, along = (run(texture, directions).energy[-1] for directions in (np.full_like(angle, 0.4), angle))
    assert along["inverse"] < 0.6 * constant["inverse"]
    assert along["energy"] < 0.7 * constant["energy"]


def bricks() -> tuple[Image, np.ndarray]:
    """Sharp bricks of 9 x 20 px in courses around a point below the picture, and the direction of the courses."""
    rows, columns = np.indices((96, 120)) - np.array([130.0, 60.0])[:, None, None]
    distance, around = np.hypot(rows, columns), np.arctan2(rows, columns)
    course = np.floor(distance / 9)
    along = around * (course + 0.5) * 9 + (course % 2) * 10
    tone = 0.12 + 0.02 * ((np.floor(along / 20) * 7 + course * 3) % 5)
    tone[(distance % 9 < 1.6) | (along % 20 < 1.6)] = 0.6
    return picture(tone), ((around + np.pi / 2) % np.pi).astype(np.float32)


def test_bricks_along_their_courses_take_less_than_in_one_direction() -> None:
    texture, angle = bricks()
    true, *constant = (
        run(texture, directions, size=(32, 40)).energy[-1]
        for directions in (angle, np.full_like(angle, 0.4), np.zeros_like(angle), np.full_like(angle, np.pi / 2))
    )
    assert true["energy"] < 0.9 * min(line["energy"] for line in constant)
    assert true["inverse"] < 0.8 * min(line["inverse"] for line in constant)


@pytest.mark.parametrize(("side", "seed"), [(26, 3), (40, 3), (26, 4)])
def test_directions_that_are_15_degrees_wrong_are_refined_to_4(side: int, seed: int) -> None:
    """Also where the first small compaction is a poor one, as with seed 4."""
    texture, true = bricks()
    wave = np.tanh(2 * np.sin(np.arange(120) / 14))
    wrong = ((true + np.radians(15) * wave) % np.pi).astype(np.float32)
    result = run(texture, wrong, seed=seed, size=(side, side), neighbourhood=11, orientation_updates=3)
    inner = np.zeros(true.shape, bool)
    inner[4:-4, 4:-4] = True
    assert off(wrong, true, inner) > 10
    assert off(result.angle, true, inner) < 4
    as_given = run(texture, wrong, seed=seed, size=(side, side), neighbourhood=11)
    assert result.energy[-1]["energy"] < as_given.energy[-1]["energy"]


def test_every_pixel_is_interpolated_at_where_it_says_with_its_direction() -> None:
    texture, angle = rings()
    control = picture(np.broadcast_to(np.linspace(0, 1, 24), (18, 24)).copy())
    result = run(texture, angle, control)
    row, column = result.source[..., 0], result.source[..., 1]
    around = np.stack(
        [
            np.roll(texture.pixels, shift, (0, 1))[row, column]
            for shift in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
    )
    slack = 0.15  # of cubic interpolation
    inside = (result.image.pixels >= around.min(axis=0) - slack) & (
        result.image.pixels <= around.max(axis=0) + slack
    )
    assert inside[(row > 0) & (row < SHAPE[0] - 1) & (column > 0) & (column < SHAPE[1] - 1)].all()
    np.testing.assert_array_equal(result.source_angle, result.angle[row, column])
    assert off(result.angle, angle, radius() > 14) < 0.01
    assert result.control is not None
    encoded = srgb_from_linear(result.control.pixels[..., 0])
    carried = np.interp((column + 0.5) / 4 - 0.5, np.arange(24), srgb_from_linear(np.linspace(0, 1, 24)))
    np.testing.assert_allclose(encoded, carried, atol=0.03)


def test_blocks_of_the_start_fit_those_before_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice among some makes less visible where they meet than the first does."""
    texture, angle = rings()
    seams = []
    for tries in (1, 12):
        monkeypatch.setattr("texloom.stages.synthesis.inverse.compact_oriented._CANDIDATES", tries)
        seams.append(run(texture, angle, iterations=1, size=(30, 30), block=10, coarsest=30).energy[0]["seams"])
    assert seams[1] < 0.9 * seams[0]


def test_jacobians_rotate_rows_of_the_compaction_along_the_orientation_field() -> None:
    texture, angle = rings()
    result = run(texture, angle, iterations=1)
    along = result.jacobian.reshape(*SHAPE, 2, 2) @ np.array([0, 1], np.float32)
    np.testing.assert_allclose(along, np.stack([np.sin(result.angle), np.cos(result.angle)], axis=2), atol=1e-6)
    a, b, c, d = np.moveaxis(result.jacobian, 2, 0)
    np.testing.assert_allclose(a * d - b * c, 1, atol=1e-5)


def test_energy_never_rises_for_one_orientation_field() -> None:
    texture, angle = rings()
    rounds = run(texture, angle, size=(44, 40), orientation_updates=1, tolerance=0, iterations=5).energy
    solved = [(line["turned"], line["level"], line["height"], line["width"]) for line in rounds]
    small, whole = {(1, 14, 14)}, {(1, 22, 20), (2, 44, 40)}
    assert set(solved) == {(update, *one) for update in (0, 1) for one in small | whole}
    for one, other, (before, after) in zip(solved, solved[1:], pairwise(rounds), strict=False):
        if one == other:
            assert after["energy"] <= before["energy"] * (1 + 1e-6)
        assert after["energy"] == pytest.approx(after["inverse"] + after["forward"] + after["seams"])


def test_a_wrong_orientation_field_is_improved() -> None:
    texture, angle = rings()
    wrong = ((angle + 0.25 * np.sin(np.arange(SHAPE[0]) / 9)[:, None]) % np.pi).astype(np.float32)
    result = run(texture, wrong, orientation_updates=3)
    assert off(wrong, angle, radius() > 14) > 8
    assert off(result.angle, angle, radius() > 14) < 0.7 * off(wrong, angle, radius() > 14)
    assert result.energy[-1]["energy"] < run(texture, wrong).energy[-1]["energy"]


def test_signed_angles_agree_with_their_neighbours() -> None:
    """Around the rings a whole turn fits without a break; angles change by half turns only."""
    _, angle = rings()
    signed = signed_angles(angle)
    np.testing.assert_allclose((signed - angle) % np.pi % 3.1415, 0, atol=1e-3)
    away = np.where(radius() > 6, 0, np.nan)
    for axis in (0, 1):
        assert np.nanmin(np.cos(np.diff(signed + away, axis=axis))) > 0.8


def test_reconstruct_orients_the_texture_by_the_jacobians() -> None:
    texture, angle = rings()
    small = run(texture, angle, size=(28, 28))
    params = ReconstructParams(solver="discrete", coarsest=12, patch_size=3)
    again = reconstruct(small.image, params, np.random.default_rng(2), target_jacobian=small.jacobian)
    assert again.image.pixels.shape == texture.pixels.shape
    assert off(orientation_field(again.image, OrientationFieldParams()).angle, angle, radius() > 14) < 12


def test_same_bits_for_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    texture, angle = rings()
    results = run_with_threads(lambda: run(texture, angle, orientation_updates=1, iterations=3), monkeypatch)
    np.testing.assert_array_equal(*(result.source for result in results))
    np.testing.assert_array_equal(*(result.angle for result in results))


def test_wrong_sizes_are_refused() -> None:
    texture, _ = rings()
    with pytest.raises(InputError, match="size: 24 x 73 px is larger than the texture of 96 x 72 px"):
        run(texture, np.zeros(SHAPE, np.float32), size=(73, 24))


def test_every_level_holds_a_neighbourhood(rng: np.random.Generator) -> None:
    texture = picture(smooth_noise((110, 120), 2, rng))
    result = run(
        texture, np.zeros((110, 120), np.float32), size=(16, 16), neighbourhood=11, coarsest=8, iterations=1
    )
    assert [row["level"] for row in result.energy] == [1]


def test_normals_turn_with_the_texture() -> None:
    """Those that rise from the middle of rings are alike in a compaction, and rise from the middle again."""
    texture, angle = rings()
    rows, columns = np.indices(SHAPE) - np.array([36.0, 48.0])[:, None, None]
    around = np.arctan2(rows, columns)
    normals = np.stack([0.6 * np.cos(around), -0.6 * np.sin(around), np.full(SHAPE, 0.8)], axis=2)
    whole = Image(np.concatenate([texture.pixels, normals.astype(np.float32)], axis=2), ("Y", *NORMAL))
    params = CompactOrientedParams(size=(28, 28), spacing=2, orientation_updates=0, coarsest=20)
    small = compact_oriented(whole, texture.pixels * 100, angle, params, np.random.default_rng(3))
    means = small.image.pixels[..., 1:3].mean(axis=(0, 1))
    assert np.hypot(*means) > 0.5
    discrete = ReconstructParams(solver="discrete", coarsest=12, patch_size=3)
    again = reconstruct(small.image, discrete, np.random.default_rng(2), target_jacobian=small.jacobian)
    along = (again.image.pixels[..., 1:3] * normals[..., :2]).sum(axis=2)[radius() > 14] / 0.36
    assert np.median(along) > 0.9
    np.testing.assert_allclose(np.linalg.norm(again.image.pixels[..., 1:], axis=2), 1, atol=0.02)
