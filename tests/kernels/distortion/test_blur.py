import numpy as np

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.blur import blur_along


def test_blur_along_lines() -> None:
    rng = np.random.default_rng(4)
    shape = (14, 17)
    planes = rng.random((*shape, 3), np.float32)
    jacobian = (np.array([1, 0.3, -0.2, 0.8]) + 0.2 * rng.random((*shape, 4))).astype(np.float32)
    usable = rng.random(shape) < 0.9
    sigma = np.where(rng.random(shape) < 0.8, 1.5 * rng.random(shape), 0).astype(np.float32)
    for axis in (0, 1):
        out = np.empty_like(planes)
        blur_along(planes, jacobian, usable, sigma, axis, out, 0, 5)
        blur_along(planes, jacobian, usable, sigma, axis, out, 5, 14)
        np.testing.assert_allclose(out, naive.blur_along(planes, jacobian, usable, sigma, axis), atol=1e-5)
