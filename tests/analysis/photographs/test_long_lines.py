"""Long lines of surfaces whose lines are known."""

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.photographs.long_lines import long_lines


def beams(turned: bool = False) -> np.ndarray:
    """Two dark beams across a plain wall."""
    wall = np.full((200, 200), 0.6)
    wall[40:50] = wall[120:130] = 0.2
    return wall.T if turned else wall


@pytest.mark.parametrize("turned", [False, True])
def test_both_edges_of_beams_count_over_their_length(turned: bool) -> None:
    wall = picture(beams(turned))
    assert long_lines(wall, np.ones((200, 200), np.bool_)) == pytest.approx(4, abs=0.4)


def test_beams_that_are_masked_or_short_do_not_count() -> None:
    usable = np.ones((200, 200), np.bool_)
    usable[30:60] = usable[110:140] = False
    assert long_lines(picture(beams()), usable) == 0
    short = np.full((200, 200), 0.6)
    short[40:50, 40:60] = short[120:130, 100:120] = 0.2
    assert long_lines(picture(short), np.ones((200, 200), np.bool_)) == 0
