"""Compaction of oriented textures."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.orientation_field import OrientationFieldParams, orientation_field
from texloom.stages.arrays import Image
from texloom.stages.color import srgb_from_linear
from texloom.stages.declare import InputError
from texloom.stages.synthesis.compact_oriented import (
    CompactedOriented,
    CompactOrientedParams,
    check_size,
    compact_oriented,
    signed_angles,
)
from texloom.stages.synthesis.reconstruct import ReconstructParams, reconstruct

SHAPE = (72, 96)


def rings() -> tuple[Image, np.ndarray]:
    """Dashed rings, and the direction along them."""
    rows, columns = np.indices(SHAPE) - np.array([36.0, 48.0])[:, None, None]
    radius, around = np.hypot(rows, columns), np.arctan2(rows, columns)
    dashes = np.sin(radius.astype(int) // 7 * 2.4 + around * radius / 6) > 0
    tone = 0.15 + 0.6 * (0.5 + 0.5 * np.sin(2 * np.pi * radius / 7)) * (0.4 + 0.6 * dashes)
    return picture(tone), ((around + np.pi / 2) % np.pi).astype(np.float32)


def run(texture: Image, angle: np.ndarray, control: Image | None = None, **params: object) -> CompactedOriented:
    given = CompactOrientedParams(
        **{"size": (24, 24), "spacing": 2, "orientation_updates": 0, "coarsest": 20, **params}
    )  # type: ignore[arg-type]
    return compact_oriented(texture, texture.pixels * 100, angle, given, np.random.default_rng(3), control)


def off(angle: np.ndarray, true: np.ndarray) -> float:
    """Median by which directions differ, a half turn being none, away from the middle; degrees."""
    turned = np.abs((angle - true + np.pi / 2) % np.pi - np.pi / 2)
    rows, columns = np.indices(SHAPE) - np.array([36, 48])[:, None, None]
    return float(np.degrees(np.median(turned[np.hypot(rows, columns) > 14])))


def test_what_turns_is_held_once() -> None:
    """Along the rings the same small picture lacks far less than with one direction for all."""
    texture, angle = rings()
    fixed, turned = (run(texture, directions) for directions in (np.full_like(angle, 0.4), angle))
    assert turned.energy[-1]["inverse"] < 0.6 * fixed.energy[-1]["inverse"]
    assert turned.energy[-1]["energy"] < 0.7 * fixed.energy[-1]["energy"]


def test_every_pixel_is_copied_from_where_it_says_with_its_direction() -> None:
    texture, angle = rings()
    control = picture(np.broadcast_to(np.linspace(0, 1, 24), (18, 24)).copy())
    result = run(texture, angle, control)
    row, column = result.source[..., 0], result.source[..., 1]
    np.testing.assert_array_equal(result.image.pixels, texture.pixels[row, column])
    np.testing.assert_array_equal(result.source_angle, result.angle[row, column])
    assert off(result.angle, angle) < 0.01
    assert result.control is not None
    encoded = srgb_from_linear(result.control.pixels[..., 0])
    carried = np.interp((column + 0.5) / 4 - 0.5, np.arange(24), srgb_from_linear(np.linspace(0, 1, 24)))
    np.testing.assert_allclose(encoded, carried, atol=0.03)


def test_pieces_of_the_start_go_with_those_before_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice among some makes less visible where they meet than the first does."""
    texture, angle = rings()
    seams = []
    for tries in (1, 12):
        monkeypatch.setattr("texloom.stages.synthesis.compact_oriented._CANDIDATES", tries)
        seams.append(run(texture, angle, iterations=1, size=(30, 30), block=10, coarsest=30).energy[0]["seams"])
    assert seams[1] < 0.9 * seams[0]


def test_jacobians_turn_rows_of_the_compaction_along_the_directions() -> None:
    texture, angle = rings()
    result = run(texture, angle, iterations=1)
    along = result.jacobian.reshape(*SHAPE, 2, 2) @ np.array([0, 1], np.float32)
    np.testing.assert_allclose(along, np.stack([np.sin(result.angle), np.cos(result.angle)], axis=2), atol=1e-6)
    a, b, c, d = np.moveaxis(result.jacobian, 2, 0)
    np.testing.assert_allclose(a * d - b * c, 1, atol=1e-5)


def test_energy_never_rises_while_directions_stand() -> None:
    texture, angle = rings()
    rounds = run(texture, angle, size=(44, 40), orientation_updates=1, tolerance=0, iterations=5).energy
    assert {(line["level"], line["turned"]) for line in rounds} == {(1, 0), (2, 0), (2, 1)}
    for before, after in pairwise(rounds):
        if (before["level"], before["turned"]) == (after["level"], after["turned"]):
            assert after["energy"] <= before["energy"] * (1 + 1e-6)
        assert after["energy"] == pytest.approx(after["inverse"] + after["forward"] + after["seams"])


def test_wrong_directions_are_improved() -> None:
    texture, angle = rings()
    wrong = ((angle + 0.25 * np.sin(np.arange(SHAPE[0]) / 9)[:, None]) % np.pi).astype(np.float32)
    result = run(texture, wrong, orientation_updates=3)
    assert off(wrong, angle) > 9
    assert off(result.angle, angle) < 0.7 * off(wrong, angle)
    assert result.energy[-1]["energy"] < run(texture, wrong).energy[-1]["energy"]


def test_signed_angles_agree_with_their_neighbours() -> None:
    """Around the rings a whole turn fits without a break; what was given stays but for half turns."""
    _, angle = rings()
    turn = signed_angles(angle)
    np.testing.assert_allclose((turn - angle) % np.pi % 3.1415, 0, atol=1e-3)
    away = np.hypot(*(np.indices(SHAPE) - np.array([36, 48])[:, None, None])) > 6
    for one, other, both in (
        (turn[:, 1:], turn[:, :-1], away[:, 1:] & away[:, :-1]),
        (turn[1:], turn[:-1], away[1:] & away[:-1]),
    ):
        assert (np.cos(one - other)[both] > 0.8).all()


def test_the_texture_is_made_again_along_its_directions() -> None:
    """Of the small picture in one direction, as `reconstruct` is told by the Jacobians."""
    texture, angle = rings()
    small = run(texture, angle, size=(28, 28))
    given = ReconstructParams(solver="discrete", occurrence=50.0, coarsest=12, patch_size=3)
    random = np.random.default_rng(2)
    again = reconstruct(small.image, given, random, target_jacobian=small.jacobian)
    assert again.image.pixels.shape == texture.pixels.shape
    assert off(orientation_field(again.image, OrientationFieldParams()).angle, angle) < 12


def test_same_bits_for_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    texture, angle = rings()
    found = []
    for threads in "13":
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        found.append(run(texture, angle, orientation_updates=1, iterations=3))
    np.testing.assert_array_equal(found[0].source, found[1].source)
    np.testing.assert_array_equal(found[0].angle, found[1].angle)


def test_wrong_sizes_are_said() -> None:
    texture, _ = rings()
    with pytest.raises(InputError, match="size=73x24 px is larger than the texture of 72x96 px"):
        check_size(CompactOrientedParams(size=(73, 24)), {"texture": texture})
