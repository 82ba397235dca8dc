"""Parts of one surface, and of several."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.evenness import picture_evenness, without_drift
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.analysis.photographs.one_off_bands import one_off_bands
from texloom.stages.vocabulary.declare import InputError

ALL = np.ones((200, 280), np.bool_)


def patches(tones: Sequence[float], rng: np.random.Generator) -> np.ndarray:
    """Rough strips of these tones side by side."""
    width = ALL.shape[1] // len(tones)
    parts = [tone + 0.05 * smooth_noise((ALL.shape[0], width), 1, rng) for tone in tones]
    return np.clip(np.concatenate(parts, axis=1), 0.01, 1)


def test_one_surface_is_even_and_several_are_not(rng: np.random.Generator) -> None:
    assert picture_evenness(picture(patches((0.4,) * 4, rng)), ALL) > 0.85
    assert picture_evenness(picture(patches((0.1, 0.4, 0.15, 0.6), rng)), ALL) < 0.3


def test_what_is_masked_does_not_count(rng: np.random.Generator) -> None:
    image = picture(patches((0.4, 0.4, 0.05, 0.4), rng))
    usable = ALL.copy()
    usable[:, 136:214] = False
    assert picture_evenness(image, usable) > 0.85 > 0.5 > picture_evenness(image, ALL)


def test_slight_drifts_of_a_plain_surface_do_not_count() -> None:
    plain = np.broadcast_to(np.linspace(0.4, 0.42, ALL.shape[1]), ALL.shape)
    assert picture_evenness(picture(plain), ALL) > 0.85


def test_several_surfaces_are_refused_and_taken_when_asked(rng: np.random.Generator) -> None:
    image = picture(patches((0.1, 0.4, 0.15, 0.6), rng))
    little = {"area": 0.2}  # of the photograph, so that none of the strips is a tenth of it
    table = {"taken": 1, "unasked": False, "extended": 1.0, "planes": [little]}
    with pytest.raises(
        InputError, match=r"as several surfaces do .evenness 0\.\d\d.*geometry.*unlike=1000"
    ) as known:
        foreign_parts(image, ForeignPartsParams(), plane=table)
    assert "plane=" not in str(known.value)
    for taken, other in ((1, 2), (2, 1)):
        table |= {"taken": taken, "planes": [little, little]}
        with pytest.raises(InputError, match=rf"another plane .--set plane={other}, by planes\.png"):
            foreign_parts(image, ForeignPartsParams(), plane=table)
    assert foreign_parts(image, ForeignPartsParams(unlike=1000)).table["doubt"] == ""


def test_a_surface_that_may_be_several_is_told(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = picture(patches((0.369, 0.431, 0.369, 0.431), rng))
    with caplog.at_level(logging.WARNING):
        table = foreign_parts(image, ForeignPartsParams()).table
    assert 0.45 <= table["evenness"] < 0.66
    assert "as several surfaces may" in table["doubt"]
    assert table["doubt"] in caplog.text


def test_a_slight_drift_of_light_is_removed_and_a_strong_one_is_kept(rng: np.random.Generator) -> None:
    y, x = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 90), indexing="ij")
    rough = smooth_noise(x.shape, 1, rng)
    shown = np.ones(x.shape, np.bool_)
    for reach, is_removed in ((6.0, True), (40.0, False)):
        lightness = 60 + 0.5 * rough + reach * (0.4 * x + 0.1 * y * y)
        lab = np.stack([lightness, 0 * x, 0.05 * reach * y], axis=2).astype(np.float32)
        even = without_drift(lab, shown)
        assert (np.ptp(cv2.GaussianBlur(even[..., 0], (0, 0), 8)) < 1.5) == is_removed
        assert is_removed or np.array_equal(even, lab)


def wall_with_a_band(rng: np.random.Generator, bands: Sequence[int]) -> np.ndarray:
    """Plain plaster, darker to the right, with rows of a cornice."""
    wall = np.broadcast_to(np.linspace(0.42, 0.36, 280), ALL.shape) + 0.004 * smooth_noise(ALL.shape, 1, rng)
    for top in bands:
        wall[top : top + 18] *= np.where(np.arange(18) % 6 < 3, 1.9, 0.7)[:, None]
    return np.asarray(wall)


def test_a_band_that_does_not_repeat_is_found_whole_and_many_are_the_surface(rng: np.random.Generator) -> None:
    image = picture(wall_with_a_band(rng, [60]))
    found = one_off_bands(image, ALL)
    assert found[62:76].all()
    assert not found[:56].any()
    assert not found[84:].any()
    assert not one_off_bands(picture(wall_with_a_band(rng, [10, 50, 90, 130, 170])), ALL).any()
    assert not one_off_bands(picture(wall_with_a_band(rng, [])), ALL).any()


def test_a_surface_is_kept_beside_its_cornice(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = picture(wall_with_a_band(rng, [20]))
    with caplog.at_level(logging.WARNING):
        made = foreign_parts(image, ForeignPartsParams(unlike=900))  # so that looks alone find nothing
    assert made.table["by"] == "looks"
    assert made.table["doubt"].startswith("a band")
    assert not made.mask.color[22:36].any()
    assert made.mask.color[60:].all()
    assert "masked" in caplog.text
