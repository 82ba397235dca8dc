import numpy as np

from texloom.stages.kernels.per_pixel.flat_windows import project_windows


def test_products_of_windows_and_a_basis(rng: np.random.Generator) -> None:
    planes = rng.random((2, 7 + 8, 9 + 8), np.float32)
    middle, basis = rng.random(8, np.float32), rng.random((50, 8), np.float32)
    out = np.empty((7, 9, 8), np.float32)
    for span in ((0, 3), (3, 7)):
        project_windows(planes, 2, middle, basis, out, *span)
    for y, x in np.ndindex(7, 9):
        window = planes[:, y : y + 9 : 2, x : x + 9 : 2].transpose(1, 2, 0).ravel()
        np.testing.assert_allclose(out[y, x], window @ basis - middle, rtol=1e-4)
