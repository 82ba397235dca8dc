import numpy as np

from tests.kernels.distortion import naive
from tests.synthetic import smooth_noise
from texloom.stages.kernels.distortion.line_integral import convolve_lines


def test_means_are_those_of_the_slow_walk(rng: np.random.Generator) -> None:
    noise = rng.random((24, 31), np.float32)
    angle = (np.pi * smooth_noise((24, 31), 4.0, rng)).astype(np.float32)
    out = np.zeros_like(noise)
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=2)
    convolve_lines(noise, direction, 6, out, 0, 13)
    convolve_lines(noise, direction, 6, out, 13, 24)
    slow = [[naive.line_mean(noise, angle, 6, y, x) for x in range(31)] for y in range(24)]
    np.testing.assert_allclose(out, slow, rtol=1e-6)


def test_a_level_field_smears_along_rows(rng: np.random.Generator) -> None:
    noise = rng.random((5, 9), np.float32)
    out = np.zeros_like(noise)
    level = np.zeros((5, 9, 2), np.float32)
    level[..., 1] = 1
    convolve_lines(noise, level, 2, out, 0, 5)
    np.testing.assert_allclose(out[2, 4], noise[2, 2:7].mean(), rtol=1e-6)
    np.testing.assert_allclose(out[2, 0], noise[2, :3].mean(), rtol=1e-6)
