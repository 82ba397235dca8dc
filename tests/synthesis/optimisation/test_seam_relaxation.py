"""Seams move to where they are seen least."""

import numpy as np
import pytest

from texloom.stages.common.grids.working_size import square_means
from texloom.stages.kernels.core import threads
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.seam_relaxation import relax_seams
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts, pairs
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIDE, SIZE = 160, 8
PLACES = (SIDE - SIZE + 1, SIDE - SIZE + 1)


def stones() -> np.ndarray:
    """Stones of 40 px of several tones between dark joints, CIELAB."""
    rows, columns = np.indices((SIDE, SIDE))
    lightness = 40.0 + 12 * ((rows // 40 * 7 + columns // 40 * 3) % 4)
    lightness[(rows % 40 < 4) | (columns % 40 < 4)] = 10
    return np.stack([lightness, 0 * lightness, 0 * lightness], axis=2).astype(np.float32)


def joined(at: int, height: int = 120, width: int = 120) -> np.ndarray:
    """A part of the exemplar, two stones farther right of a line."""
    match = np.indices((height, width)).astype(np.int32)
    match[0, :, at:] = (match[0, :, at:] + 80) % 120
    return match


def seam_cost(match: np.ndarray, lab: np.ndarray) -> float:
    costs = SeamCosts(lab, gradients=True, squared=True, offset=8.0)
    total = 0
    for axis in (0, 1):
        one, other = pairs(np.moveaxis(match + SIZE // 2, 0, 2), axis)
        total += int(costs.between(axis, one.reshape(-1, 2).copy(), other.reshape(-1, 2).copy()).sum())
    return total / UNIT


@pytest.mark.parametrize("wrap", [NOWHERE, Wraps(False, True)])
def test_a_seam_moves_to_the_joint(wrap: Wraps) -> None:
    lab = stones()
    match = joined(56)  # 20 px beside a joint, as patches begin half a patch before their middle
    before = seam_cost(match, lab)
    relax_seams(match, square_means(lab, 2), SIZE, wrap, None, PLACES)
    assert seam_cost(match, lab) < 0.4 * before
    assert (match >= 0).all()
    assert (match < np.array(PLACES)[:, None, None]).all()


def test_what_is_not_allowed_does_not_spread() -> None:
    lab = stones()
    usable = np.ones((SIDE, SIDE), bool)
    usable[:, 64:] = False
    allowed = Allowed(usable, SIDE, SIDE, SIZE)
    match = joined(56)
    before = match.copy()
    relax_seams(match, square_means(lab, 2), SIZE, NOWHERE, allowed, PLACES)
    changed = (match != before).any(axis=0)
    assert allowed.places[match[0][changed], match[1][changed]].all()


def test_bits_do_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    lab, results = stones(), []
    for count in (1, 3):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        match = joined(50, 140, 150)
        relax_seams(match, square_means(lab, 2), SIZE, Wraps(True, True), None, PLACES)
        results.append(match)
    assert np.array_equal(*results)
