"""Regions that are used too often become dearer."""

import numpy as np
import pytest
import skimage.data

from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import OptimiseParams, optimise
from texloom.stages.synthesis.optimisation.overuse import Overuse
from texloom.stages.vocabulary.arrays import Image

PLACES = (96, 120)
UNIT = 1000


def used(times: int, more: int = 0) -> np.ndarray:
    """Counts of even use, with ``more`` in the middle of the left half."""
    counts = np.full(PLACES, times, np.int32)
    counts[40:56, 20:40] += more
    return counts


def test_only_what_is_used_too_often_becomes_dearer() -> None:
    overuse = Overuse(PLACES, 1.2, None, None)
    overuse.adjust(used(4), 50.0)
    assert not overuse.penalty(UNIT).any()
    overuse.adjust(used(4, 8), 50.0)
    first = overuse.penalty(UNIT)
    assert first[48, 30] > 0
    assert not first[:, 60:].any()
    overuse.adjust(used(4, 8), 50.0)
    assert overuse.penalty(UNIT)[48, 30] == pytest.approx(2 * first[48, 30], abs=1)
    for _ in range(100):
        overuse.adjust(used(4, 100), 50.0)
    assert overuse.penalty(UNIT).max() == 0.5 * 50 * UNIT
    for _ in range(100):
        overuse.adjust(used(4), 50.0)
    assert not overuse.penalty(UNIT).any()


def test_a_small_result_may_show_a_piece_once() -> None:
    overuse = Overuse(PLACES, 1.2, None, None)
    counts = np.zeros(PLACES, np.int32)
    counts[20:60, 20:60] = 1
    overuse.adjust(counts, 50.0)
    assert not overuse.penalty(UNIT).any()


def test_masked_places_have_no_share() -> None:
    usable = np.zeros((103, 127), bool)
    usable[:, 60:] = True
    allowed = Allowed(usable, 103, 127, 8)
    overuse = Overuse(PLACES, 1.2, allowed, None)
    counts = 3 * allowed.places.astype(np.int32)
    overuse.adjust(counts, 50.0)
    assert not overuse.penalty(UNIT).any(), "even use of the rest is fair"


def test_wanted_use_is_fair() -> None:
    wanted = np.ones(PLACES, np.float32)
    wanted[:, :60] = 0.25
    overuse = Overuse(PLACES, 1.2, None, wanted)
    overuse.adjust((12 * wanted).astype(np.int32), 50.0)
    assert not overuse.penalty(UNIT).any()
    overuse.adjust(used(6), 50.0)
    assert overuse.penalty(UNIT)[:, :50].min() > 0
    assert not overuse.penalty(UNIT)[:, 70:].any()


def test_a_result_repeats_less() -> None:
    exemplar = Image.of(skimage.data.gravel()[:128, :128])
    start = initialise(exemplar, InitialiseParams(size=(320, 320)), np.random.default_rng(1)).match
    spread = []
    for most in (None, 1.2):
        params = OptimiseParams(preset="fast", most_use=most, whole_cells=False, relaxed_seams=False)
        made = optimise(exemplar, start, params, np.random.default_rng(1))
        spread.append(made.occurrence[16:-16, 16:-16].max())
    assert spread[1] < 0.95 * spread[0]


def test_lattices_are_not_limited() -> None:
    brick = Image.of(skimage.data.brick()[:96, :96])
    start = initialise(brick, InitialiseParams(size=(160, 160)), np.random.default_rng(1)).match
    generators = np.array([[0, 24], [48, 0]], np.float32)
    contours = edges(brick, EdgesParams()).strength
    made = [
        optimise(
            brick, start, OptimiseParams(preset="fast", most_use=most), np.random.default_rng(1),
            generators=generators, contours=contours,
        ).match
        for most in (None, 1.2)
    ]  # fmt: skip
    assert (made[0] == made[1]).all()
