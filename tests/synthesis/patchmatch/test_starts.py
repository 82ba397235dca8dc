import numpy as np

from tests.synthetic import blobs, picture
from texloom.stages.synthesis._patchmatch.starts import best_start


def test_repetition_and_other_colours_are_avoided(rng: np.random.Generator) -> None:
    wide = blobs((96, 192, 3), rng)
    exemplar, other = picture(wide[:, :96]), picture(wide[:, 96:])
    repeated = picture(np.tile(wide[:48, 96:144], (2, 2, 1)))
    darker = picture(0.8 * wide[:, 96:])
    assert best_start(exemplar, [repeated, other, darker]) == 1
    assert best_start(exemplar, [darker, repeated]) == 0
    assert best_start(exemplar, [other]) == 0
