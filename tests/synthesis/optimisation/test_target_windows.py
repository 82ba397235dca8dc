import numpy as np
import pytest

from texloom.stages.synthesis.optimisation.target_windows import target_windows
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps


@pytest.mark.parametrize("wrap", [NOWHERE, TORUS, Wraps(True, False)])
@pytest.mark.parametrize("side", [20, 64])
def test_every_small_part_lies_within_a_window(wrap: Wraps, side: int) -> None:
    sides, part = (50, 33), 6
    windows = list(target_windows(sides, wrap, side, part + 2))
    for top in range(sides[0] if wrap.down else sides[0] - part + 1):
        for left in range(sides[1] if wrap.across else sides[1] - part + 1):
            own = np.zeros(sides, bool)
            own[np.ix_(np.arange(top, top + part) % sides[0], np.arange(left, left + part) % sides[1])] = True
            assert any(
                own[window.place].sum() == part**2 and not (own[window.place] & window.border).any()
                for window in windows
            )


def test_lines_go_on_beyond_the_border() -> None:
    for window in target_windows((9, 8), TORUS, 64, 4):
        assert (np.diff(window.rows) == 1).all()
        assert np.array_equal(window.place[0][:, 0], window.rows % 9)
        assert window.border[0].all()
