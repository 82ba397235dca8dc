"""The standard normal distribution, compared with the standard library's."""

from statistics import NormalDist

import numpy as np

from texloom.stages.numerics.normal_distribution import normal_quantiles, normal_shares

NORMAL = NormalDist()


def test_quantiles_are_those_of_the_standard_library() -> None:
    shares = np.concatenate([np.linspace(1e-9, 1 - 1e-9, 501), [1e-14, 0.074999, 0.075, 0.925, 1 - 1e-12]])
    np.testing.assert_allclose(normal_quantiles(shares), [NORMAL.inv_cdf(share) for share in shares], atol=1e-6)


def test_shares_are_those_of_the_standard_library() -> None:
    values = np.linspace(-6, 6, 301)
    np.testing.assert_allclose(normal_shares(values), [NORMAL.cdf(value) for value in values], atol=1e-7)


def test_shares_lead_back_to_quantiles() -> None:
    shares = np.linspace(0.001, 0.999, 99).reshape(9, 11)
    np.testing.assert_allclose(normal_shares(normal_quantiles(shares)), shares, atol=1e-6)
