"""Regions that are used too often become dearer."""

import numpy as np
import pytest
import skimage.data

from texloom.stages.kernels.patchmatch.search import add_prices, find_parts
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.optimisation.overuse import Overuse
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import NOWHERE

PLACES = (96, 120)
UNIT = 1000
START = np.stack(np.indices((64, 64)), axis=2).astype(np.uint32)


def used(times: int, more: int = 0) -> np.ndarray:
    """Counts of even use, with ``more`` in the middle of the left half."""
    counts = np.full(PLACES, times, np.int32)
    counts[40:56, 20:40] += more
    return counts


def penalty(overuse: Overuse) -> np.ndarray:
    """Of each patch."""
    prices = np.zeros(PLACES, np.float32)
    overuse.charge(prices, UNIT)
    return prices


def test_only_what_is_used_too_often_becomes_dearer() -> None:
    overuse = Overuse(PLACES, 1.2, None, None)
    overuse.adjust(used(4), 50.0)
    assert not penalty(overuse).any()
    overuse.adjust(used(4, 8), 50.0)
    first = penalty(overuse)
    assert first[48, 30] > 0
    assert not first[:, 60:].any()
    overuse.adjust(used(4, 8), 50.0)
    assert penalty(overuse)[48, 30] == pytest.approx(2 * first[48, 30], abs=1)
    for _ in range(100):
        overuse.adjust(used(4, 100), 50.0)
    assert penalty(overuse).max() == 0.5 * 50 * UNIT
    for _ in range(100):
        overuse.adjust(used(4), 50.0)
    assert not penalty(overuse).any()


def test_a_small_result_may_show_a_piece_once() -> None:
    overuse = Overuse(PLACES, 1.2, None, None)
    counts = np.zeros(PLACES, np.int32)
    counts[20:60, 20:60] = 1
    overuse.adjust(counts, 50.0)
    assert not penalty(overuse).any()


def test_masked_places_have_no_share() -> None:
    usable = np.zeros((103, 127), bool)
    usable[:, 60:] = True
    allowed = Allowed(usable, 103, 127, 8)
    overuse = Overuse(PLACES, 1.2, allowed, None)
    counts = 3 * allowed.places.astype(np.int32)
    overuse.adjust(counts, 50.0)
    assert not penalty(overuse).any(), "even use of the rest is fair"


def test_wanted_use_is_fair() -> None:
    wanted = np.ones(PLACES, np.float32)
    wanted[:, :60] = 0.25
    overuse = Overuse(PLACES, 1.2, None, wanted)
    overuse.adjust((12 * wanted).astype(np.int32), 50.0)
    assert not penalty(overuse).any()
    overuse.adjust(used(6), 50.0)
    assert penalty(overuse)[:, :50].min() > 0
    assert not penalty(overuse)[:, 70:].any()


def test_a_result_repeats_less() -> None:
    exemplar = Image.of(skimage.data.gravel()[:128, :128])
    start = initialise(exemplar, InitialiseParams(size=(320, 320)), np.random.default_rng(1)).match
    spread = []
    for most in (None, 1.2):
        params = OptimiseParams(preset="fast", most_use=most, whole_cells=False, relaxed_seams=False)
        made = optimise(exemplar, start, params, np.random.default_rng(1))
        spread.append(made.occurrence[16:-16, 16:-16].max())
    assert spread[1] < 0.95 * spread[0]


def test_no_phase_of_a_lattice_becomes_dearer_than_another() -> None:
    """Only what is dearer than the rest of its phase counts."""
    phase = LatticePhase(np.array([[0, 24], [16, 0]], np.float32), START, NOWHERE)
    parts = phase.parts(PLACES, 1.0)
    overuse = Overuse(PLACES, 1.2, None, None, parts)
    overuse.adjust(used(4, 8), 50.0)
    prices = penalty(overuse)
    assert prices[48, 30] > 0
    assert all(prices[parts == part].min() == 0 for part in np.unique(parts))
    courses = LatticePhase(np.array([[0, 60]], np.float32), START, NOWHERE).parts(PLACES, 1.0)
    counts = used(4)
    counts[:, 20:30] = counts[:, 80:90] = 100
    found = []
    for part in (None, courses):
        overuse = Overuse(PLACES, 1.2, None, None, part)
        overuse.adjust(counts, 50.0)
        found.append(penalty(overuse)[:, 20:30].mean())
    assert found[1] < 0.3 * found[0], "the phase is used as often everywhere"


def test_parts_of_a_lattice_are_those_of_its_cells() -> None:
    phase = LatticePhase(np.array([[3, 24], [16, -5]], np.float32), START, NOWHERE)
    parts = phase.parts((30, 40), 0.5)
    doubled = phase.parts((60, 80), 1.0)
    assert (parts == doubled[::2, ::2]).all()
    assert (doubled[:-3, :-24] == doubled[3:, 24:]).mean() > 0.95
    assert len(np.unique(doubled)) == 36


def test_prices_are_added_as_far_as_they_are_above_the_least_of_their_part() -> None:
    random = np.random.default_rng(3)
    prices = random.integers(0, 4, (3, 4)).astype(np.float32)
    parts = random.integers(0, 5, (28, 37)).astype(np.uint8)
    cell = np.indices(parts.shape) // np.array([10, 10])[:, None, None]
    own = prices[cell[0], cell[1]]
    found = np.zeros((3, 4, 6), bool)
    find_parts(parts, (10, 10), found)
    expected = np.zeros(found.shape, bool)
    expected[cell[0], cell[1], parts] = True
    np.testing.assert_array_equal(found, expected)
    least = np.array([own[parts == part].min(initial=9) for part in range(6)], np.float32)
    for given, limit in ((None, np.zeros(1, np.float32)), (parts, least)):
        made = np.full(parts.shape, 7, np.float32)
        add_prices(prices, (10, 10), given, limit, limit.min(), made)
        np.testing.assert_array_equal(made, 7 + own - (0 if given is None else least[parts]))
