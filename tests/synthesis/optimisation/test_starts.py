import numpy as np

from tests.synthetic import blobs, picture
from texloom.stages.synthesis.optimisation.starts import best_start

ALIKE = {"energy": 100.0, "price": 30.0}


def test_repetition_and_other_colours_are_avoided(rng: np.random.Generator) -> None:
    wide = blobs((96, 192, 3), rng)
    exemplar, other = picture(wide[:, :96]), picture(wide[:, 96:])
    repeated = picture(np.tile(wide[:48, 96:144], (2, 2, 1)))
    darker = picture(0.8 * wide[:, 96:])
    assert best_start(exemplar, [repeated, other, darker], [ALIKE] * 3) == 1
    assert best_start(exemplar, [darker, repeated], [ALIKE] * 2) == 0
    assert best_start(exemplar, [other], [ALIKE]) == 0


def test_of_results_alike_that_of_less_energy_or_penalty_is_chosen(rng: np.random.Generator) -> None:
    exemplar = picture(blobs((96, 96, 3), rng))
    for less in ({"energy": 90.0}, {"price": 20.0}):
        assert best_start(exemplar, [exemplar, exemplar], [ALIKE, ALIKE | less]) == 1
