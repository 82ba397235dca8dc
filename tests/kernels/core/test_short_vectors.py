import numba
import numpy as np

from texloom.stages.kernels.core.short_vectors import ONE, copy_eight, paired, squared_distance, sum_of_projections


def test_vectors(rng: np.random.Generator) -> None:
    vectors = rng.integers(-700, 700, (20, 8)).astype(np.int16)
    bases = rng.integers(-700, 700, (5, 8, 8)).astype(np.int16)
    vectors[3], bases[2, 0] = [1, *(0,) * 7], range(1024, 1024 + 16 * 2048, 2 * 2048)  # halfway, thrice
    out = np.zeros((2, 16), np.int16)
    _compiled_sum()(out, vectors, paired(bases.reshape(-1, 8)))
    pairs = zip((3, 1, 19), bases[2:], strict=True)
    expected = sum(np.rint(vectors[row].astype(int) @ basis.astype(int) / ONE) for row, basis in pairs)
    np.testing.assert_array_equal(out[1, :8], expected)
    assert not out[0].any()
    assert not out[1, 8:].any()
    for size in (8, 16):
        rows = rng.integers(-8000, 8000, (7, size)).astype(np.int16)
        rows[0, 0], rows[1, 0] = 16000, -16000
        for one, other in ((0, 1), (2, 6), (4, 4)):
            expected = ((rows[one].astype(int) - rows[other]) ** 2).sum()
            assert _compiled_distance()(rows, one, other, (0,) * size) == expected


def test_copy(rng: np.random.Generator) -> None:
    vectors, out = rng.integers(-700, 700, (4, 16)).astype(np.int16), np.zeros((3, 8), np.int16)
    _compiled_copy()(out, vectors)
    np.testing.assert_array_equal(out, [np.zeros(8), vectors[1, 8:], np.zeros(8)])


def _compiled_copy():
    @numba.njit
    def run(out, vectors):
        copy_eight(out, np.int64(1), vectors, np.int64(3))

    return run


def _compiled_sum():
    @numba.njit
    def run(out, vectors, bases):
        sum_of_projections(out, np.int64(2), vectors, (3, 1, 19), bases, np.int64(8))

    return run


def _compiled_distance():
    @numba.njit
    def run(rows, one, other, length):
        return squared_distance(rows, one, rows, other, length)

    return run
