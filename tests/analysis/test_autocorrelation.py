from __future__ import annotations

import numpy as np
import pytest

from stages.analysis.autocorrelation import Autocorrelation, AutocorrelationParams, autocorrelation
from stages.analysis.lattice import LatticeParams, lattice
from stages.analysis.surer_lattice import SurerLatticeParams, surer_lattice
from stages.arrays import Image
from tests.synthetic import LATTICES, difference, picture, smooth_noise, stamped, tiled


def of(image: Image, **params: float) -> Autocorrelation:
    return autocorrelation(image, AutocorrelationParams(**params))  # type: ignore[arg-type]


@pytest.mark.parametrize("jitter", [0.0, 0.05])
@pytest.mark.parametrize("name", LATTICES)
def test_known_lattices_are_found(name: str, jitter: float) -> None:
    image = stamped(LATTICES[name], np.random.default_rng(4), jitter=jitter)
    result = lattice(image, of(image).density, LatticeParams(beta=3))
    assert difference(result.generators, LATTICES[name]) < 1


def test_peaks_of_an_exact_tiling_are_its_lattice(rng: np.random.Generator) -> None:
    image, generators = tiled(smooth_noise((30, 44, 3), 2.0, rng), 11, (240, 280))
    result = of(image, peaks=8)
    steps = result.peaks @ np.linalg.inv(generators)
    np.testing.assert_allclose(steps, np.rint(steps), atol=0.05)
    np.testing.assert_allclose(result.dominance[:, 1], 1, atol=0.1)
    assert (np.diff(result.dominance[:, 0]) <= 0).all()
    assert (result.peaks[:, 0] > -0.5).all()


def test_regions_of_dominance_are_those_of_their_definition(rng: np.random.Generator) -> None:
    image = picture(smooth_noise((90, 100, 3), 3.0, rng))
    result = of(image, peaks=1000, lowest=0.0)
    both = np.concatenate([result.peaks, -result.peaks, np.zeros((1, 2), np.float32)])
    heights = np.concatenate([result.dominance[:, 1], result.dominance[:, 1], [1.0]])
    for place, (dominance, height) in zip(result.peaks, result.dominance, strict=True):
        higher = both[heights > height + 1e-6]
        assert np.hypot(*(higher - place).T).min() == pytest.approx(dominance, abs=0.2)


def test_density_is_symmetric_and_peaks_at_one(rng: np.random.Generator) -> None:
    density = of(stamped(LATTICES["hexagonal"], rng)).density
    assert density.shape == (289, 321)
    assert density.max() == 1
    np.testing.assert_allclose(density, density[::-1, ::-1], atol=1e-5)


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_a_flat_picture_has_no_peaks(value: float) -> None:
    result = of(picture(np.full((60, 70), value)))
    assert not result.density.any()
    assert result.peaks.shape == result.dominance.shape == (0, 2)


def test_masked_pixels_are_not_seen(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(smooth_noise((20, 24, 3), 2.0, rng), 0, (120, 130))
    usable = np.ones((120, 130, 1), np.float32)
    usable[30:60, 40:90] = 0
    found = []
    for hidden in (0.0, rng.random((120, 130, 3))):
        pixels = np.where(usable > 0, exemplar.pixels, hidden)
        found.append(of(Image(np.concatenate([pixels, usable], axis=2).astype(np.float32), ("R", "G", "B", "A"))))
    np.testing.assert_array_equal(found[0].correlation, found[1].correlation)
    np.testing.assert_array_equal(found[0].peaks, found[1].peaks)


SQUARE, DOUBLE = (np.diag(sides).astype(np.float32) for sides in ((20.0, 20.0), (20.0, 40.0)))
NONE = np.zeros((0, 2), np.float32)


@pytest.mark.parametrize(
    ("first", "second", "chosen"),
    [
        ((SQUARE, 0.6, 9.0), (DOUBLE, 0.5, 9.0), "first"),
        ((SQUARE, 0.5, 9.0), (DOUBLE, 0.6, 9.0), "second"),
        ((DOUBLE, 0.6, 9.0), (SQUARE, 0.59, 9.0), "second"),
        ((SQUARE, 0.59, 9.0), (DOUBLE, 0.6, 9.0), "first"),
        ((NONE, 0.0, 0.0), (SQUARE, 0.6, 9.0), "second"),
        ((NONE, 0.0, 0.0), (NONE, 0.0, 0.0), "none"),
        # neither is sure, so the significant one, if there is one
        ((SQUARE, 0.3, 5.0), (DOUBLE, 0.2, 5.0), "none"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.2, 7.0), "second"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.5, 1.0), "second"),
        # of too few points to tell: only features that match are believed
        ((SQUARE, 0.5, 0.0), (DOUBLE, 0.1, 0.0), "first"),
        ((DOUBLE, 0.1, 0.0), (SQUARE, 0.5, 0.0), "none"),
    ],
)
def test_the_surer_lattice_is_taken(
    first: tuple[np.ndarray, float, float], second: tuple[np.ndarray, float, float], chosen: str
) -> None:
    result = surer_lattice(*first, *second, SurerLatticeParams())
    assert result.chosen == chosen
    expected = {"first": first[0], "second": second[0], "none": NONE}[chosen]
    np.testing.assert_array_equal(result.generators, expected)
    assert len(result.best) == (0 if not len(first[0]) + len(second[0]) else 2)
    if len(result.best):
        given = first if result.best is first[0] else second
        assert (result.confidence, result.significance) == given[1:]
