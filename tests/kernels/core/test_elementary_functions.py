"""Elementary functions beside NumPy's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from texloom.stages.kernels.core import elementary_functions as functions

UNIT = np.finfo(np.float64).eps
ANGLES = np.concatenate([np.linspace(-50, 50, 20001), [0.0, -0.0, np.pi, 1e-300, 1e5]])
POSITIVE = np.exp(np.linspace(-600, 600, 20001))


@pytest.mark.parametrize(
    ("own", "other", "values", "units"),
    [
        (functions.exp, np.exp, np.linspace(-700, 700, 20001), 2),
        (functions.log, np.log, POSITIVE, 2),
        (functions.cbrt, np.cbrt, np.concatenate([-POSITIVE, POSITIVE]), 2),
        (lambda x: functions.power(x, 1 / 2.4), lambda x: x ** (1 / 2.4), POSITIVE, 400),
        (lambda x: functions.power(x, 2.4), lambda x: x**2.4, np.linspace(1e-3, 2, 20001), 32),
    ],
)
def test_relative_errors(
    own: Callable[[Any], Any], other: Callable[[Any], Any], values: np.ndarray, units: float
) -> None:
    exact = other(values.astype(np.longdouble))  # NumPy's own doubles differ in the last bits between processors
    np.testing.assert_allclose(own(values), exact, rtol=units * UNIT, atol=0)


@pytest.mark.parametrize(("own", "other"), [(functions.sin, np.sin), (functions.cos, np.cos)])
def test_waves(own: Callable[[Any], Any], other: Callable[[Any], Any]) -> None:
    np.testing.assert_allclose(own(ANGLES), other(ANGLES), rtol=0, atol=2 * UNIT)
    np.testing.assert_allclose(functions.phasor(ANGLES), np.exp(1j * ANGLES), rtol=0, atol=3 * UNIT)


def test_arctan2() -> None:
    line = np.array([0.0, -0.0, 1.0, -1.0, 1e-200, 1e200, 0.3, -0.4, 0.41421356])
    down, across = np.meshgrid(line, line)
    np.testing.assert_allclose(functions.arctan2(down, across), np.arctan2(down, across), rtol=2 * UNIT)
    z = np.empty(down.shape, np.complex128)
    z.real, z.imag = across, down
    np.testing.assert_array_equal(functions.phase_of(z), functions.arctan2(down, across))


def test_special_values() -> None:
    with np.errstate(all="raise", under="ignore"):
        np.testing.assert_array_equal(functions.exp([0.0, -1e4, 1e4, np.nan]), [1, 0, np.inf, np.nan])
        np.testing.assert_array_equal(functions.log([1.0, 0.0, -1.0, np.inf]), [0, -np.inf, np.nan, np.inf])
        np.testing.assert_array_equal(functions.log2(2.0 ** np.arange(-9, 9)), np.arange(-9, 9))
        np.testing.assert_array_equal(functions.cbrt([0.0, 8.0, -27.0]), [0, 2, -3])
        np.testing.assert_array_equal(functions.power([0.0, 1.0], 2.4), [0, 1])


def test_types_are_those_of_numpy() -> None:
    assert functions.exp(np.float32([1.0])).dtype == np.float32
    assert functions.exp(np.arange(3)).dtype == np.float64
    assert isinstance(functions.log(2.0), float)
    assert functions.phasor(np.float32([1.0])).dtype == np.complex64


def test_complex_products(rng: np.random.Generator) -> None:
    one, other = (rng.integers(-9, 9, (4, 5)) + 1j * rng.integers(-9, 9, (4, 5)) for _ in range(2))
    np.testing.assert_array_equal(functions.complex_product(one, other), one * other)
    np.testing.assert_array_equal(functions.squared_size(one), np.rint(np.abs(one) ** 2))
