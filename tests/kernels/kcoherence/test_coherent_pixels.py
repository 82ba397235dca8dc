import numpy as np
import pytest

from tests.kernels.kcoherence import naive
from tests.wraps import WRAPS
from texloom.stages.kernels.kcoherence.coherent_pixels import CopySource, PartialResult, resynthesise
from texloom.stages.vocabulary.facts import Wraps


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("radius", [1, 2])
@pytest.mark.parametrize("soften", [False, True])
def test_pixels_are_made_like_the_naive_ones(
    wrap: Wraps, radius: int, soften: bool, rng: np.random.Generator
) -> None:
    exemplar = rng.integers(0, 9, (13, 15, 3)).astype(np.float32)  # whole numbers: sums are exact, and often equal
    maps = rng.random((13, 15, 4), np.float32)
    candidates = rng.integers(0, 13, (13, 15, 3, 2)).astype(np.int32)
    candidates[rng.random((13, 15)) < 0.3] = -1
    last = np.array([13, 15]) - 1 - radius
    nearest_valid = rng.integers(radius, last + 1, (13, 15, 2)).astype(np.int32)
    match = np.stack([rng.integers(0, 13, (10, 11)), rng.integers(0, 15, (10, 11))], axis=2).astype(np.int32)
    canvas, pixels = (source[match[..., 0], match[..., 1]] for source in (exemplar, maps))
    valid = rng.random((10, 11)) < 0.6
    order = rng.permutation(np.argwhere(~valid))

    result = PartialResult(canvas, pixels, match, valid)
    expected = PartialResult(*(array.copy() for array in result))
    known = CopySource(exemplar, maps, candidates, nearest_valid)
    for row, column in order:
        y, x = naive.resynthesise_pixel((row, column), radius, wrap, known, expected)
        for array, value in zip(expected, (exemplar[y, x], maps[y, x], (y, x), True), strict=True):
            array[row, column] = value
        for down, across in ((-1, 0), (0, -1), (0, 1), (1, 0)) if soften else ():
            near = (row + down, column + across)
            near = (near[0] % 10 if wrap.down else near[0], near[1] % 11 if wrap.across else near[1])
            # a neighbour that is valid; the pixel itself has just become so, but is none
            if 0 <= near[0] < 10 and 0 <= near[1] < 11 and expected.valid[near]:
                for plane, source in ((expected.features, exemplar), (expected.pixels, maps)):
                    plane[near] = (plane[near] + source[y + down, x + across]) * np.float32(0.5)
    # candidates are filled in where the kernel asks for them
    known = known._replace(candidates=candidates.copy())
    known.candidates[::2] = -2
    done, asked = 0, 0
    while done < len(order):
        done, row, column = resynthesise(order, done, radius, wrap, soften, known, result)
        if done < len(order):
            assert (known.candidates[row, column] == -2).all()
            known.candidates[row, column] = candidates[row, column]
            asked += 1
    assert asked > 3
    for fast, slow in zip(result, expected, strict=True):
        np.testing.assert_array_equal(fast, slow)
    assert valid.all()
