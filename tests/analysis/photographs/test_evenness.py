"""Parts of one surface, and of several."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.photographs.evenness import picture_evenness
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
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
    with pytest.raises(InputError, match=r"as several surfaces do .evenness 0\.\d\d.*--set plane=2.*unlike=1000"):
        foreign_parts(image, ForeignPartsParams())
    assert foreign_parts(image, ForeignPartsParams(unlike=1000)).table["doubt"] == ""


def test_a_surface_that_may_be_several_is_told(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = picture(patches(list(np.linspace(0.355, 0.445, 7)), rng))
    with caplog.at_level(logging.WARNING):
        table = foreign_parts(image, ForeignPartsParams()).table
    assert 0.45 <= table["evenness"] < 0.66
    assert "as several surfaces may" in table["doubt"]
    assert table["doubt"] in caplog.text
