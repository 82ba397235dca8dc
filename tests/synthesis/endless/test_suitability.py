"""Whether a texture may be made endless by blending."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, wall
from texloom.stages.synthesis.endless.endless_suitability import (
    EndlessSuitabilityParams,
    endless_suitability,
    why_not,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

ACCEPT = EndlessSuitabilityParams(accept=True)


def noise(side: int = 160) -> Image:
    values = smooth_noise((side, side, 3), 1.5, np.random.default_rng(2))
    return picture((values - values.min()) / np.ptp(values))


def outlines(side: int = 160) -> Image:
    """Dark contours of light regions, which lie at random."""
    values = smooth_noise((side, side), 10, np.random.default_rng(4))
    return picture(np.where(np.abs(values / values.std()) < 0.12, 0.05, 0.8))


def test_noise_is_stochastic(caplog: pytest.LogCaptureFixture) -> None:
    table = endless_suitability(noise(), EndlessSuitabilityParams()).table
    assert (table["chosen"], table["because"], table["verdict"]) == (["noise"], "it is stochastic", "stochastic")
    assert table["difference"] == max(table["differences"]) < 0.06
    assert table["repetition"] < 0.3
    assert not caplog.records


def test_bricks_repeat_and_are_laid_as_cells(caplog: pytest.LogCaptureFixture) -> None:
    bricks = wall((160, 200), 25.0, 0.0, np.random.default_rng(3))
    table = endless_suitability(bricks, EndlessSuitabilityParams()).table
    assert table["chosen"] == ["cells"]
    assert table["because"] == "it has courses that blending would destroy"
    assert why_not(table).endswith(" and it has courses")
    assert table["repetition"] > 0.4
    assert not caplog.records
    blended = endless_suitability(bricks, EndlessSuitabilityParams(way="noise")).table
    assert blended["chosen"] == ["noise"]
    assert blended["because"] == f"though {why_not(table)}"
    assert "wang_tiles keeps it" in caplog.text
    asked = endless_suitability(noise(), EndlessSuitabilityParams(way="cells")).table
    assert (asked["chosen"], asked["because"]) == (["cells"], "they were asked for")


def courses(rng: np.random.Generator) -> Image:
    """Bricks of any length and tone in rows of 20 px."""
    pixels = np.full((200, 240), 0.1)
    for top in range(0, 200, 20):
        left = -int(rng.integers(0, 30))
        while left < 240:
            width = int(rng.integers(22, 55))
            pixels[top : top + 18, max(0, left) : max(0, left + width - 2)] = rng.uniform(0.3, 0.6)
            left += width
    return picture(pixels + 0.05 * rng.random(pixels.shape))


def test_courses_of_bricks_that_differ_are_structured() -> None:
    table = endless_suitability(courses(np.random.default_rng(0)), ACCEPT).table
    assert (table["periods"], table["verdict"]) == ("courses", "structured")
    assert table["because"].startswith("it has courses that")


def flagstones() -> Image:
    """Grainy stones of a fifth of the side, between narrow joints."""
    rng = np.random.default_rng(6)
    places = np.stack(np.meshgrid(*[np.arange(20, 200, 40)] * 2), axis=2).reshape(-1, 2) + rng.uniform(
        -9, 9, (25, 2)
    )
    apart = np.sort(np.hypot(*(np.indices((200, 200))[..., None] - places.T[:, None, None])), axis=2)
    joint = apart[..., 1] - apart[..., 0] < 2
    grain = smooth_noise((200, 200), 1.0, rng)
    return picture(np.where(joint, 0.05, 0.3 + 0.06 * grain / grain.std()).astype(np.float32))


def test_narrow_joints_of_large_stones_are_found() -> None:
    """Though few gradients are theirs."""
    table = endless_suitability(flagstones(), ACCEPT).table
    assert table["element size"] == pytest.approx(0.18, abs=0.03)
    assert table["verdict"] == "structured"
    assert "its element size is 0.1" in why_not(table)
    assert endless_suitability(noise(), ACCEPT).table["element size"] == 0


def test_contours_would_be_blended_away(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        table = endless_suitability(outlines(), ACCEPT).table
    assert table["verdict"] == "structured"
    assert table["difference"] > 0.15
    assert "wang_tiles keeps it" in caplog.text
    with pytest.raises(InputError, match="its difference is"):
        endless_suitability(outlines(), EndlessSuitabilityParams())


def test_contours_of_hue_alone_are_seen() -> None:
    """Stones in mortar as light as they are: blends are compared by all components of colour."""
    light = smooth_noise((160, 160), 4, np.random.default_rng(4))
    light = 0.5 + 0.1 * light / light.std()
    region = smooth_noise((160, 160), 10, np.random.default_rng(4))
    hue = np.where(np.abs(region - region.mean()) < 0.3 * region.std(), 0.1, -0.02)
    colored = picture(np.square(np.stack([light + hue, light, light - hue], axis=2)))
    grey = picture(np.square(light))
    found = [endless_suitability(image, ACCEPT).table["difference"] for image in (grey, colored)]
    assert found[0] < 0.06
    assert found[1] > 0.12


def test_a_lattice_whose_cells_are_not_found_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    bricks = wall((160, 200), 25.0, 0.0, np.random.default_rng(3))
    monkeypatch.setattr("texloom.stages.synthesis.endless.endless_suitability._FOUND", 1.1)
    with pytest.raises(InputError, match=r"it has .*; the flow wang_tiles keeps it"):
        endless_suitability(bricks, EndlessSuitabilityParams())


def test_large_pictures_are_measured_at_reduced_size_and_flat_ones_at_all() -> None:
    assert endless_suitability(noise(600), EndlessSuitabilityParams()).table["verdict"] == "stochastic"
    flat = endless_suitability(picture(np.full((40, 40), 0.5)), EndlessSuitabilityParams()).table
    assert flat["difference"] == flat["repetition"] == 0
