from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import LATTICES, difference, picture, smooth_noise, stamped, tiled
from texloom.stages.analysis.regularity.autocorrelation import (
    Autocorrelation,
    AutocorrelationParams,
    autocorrelation,
)
from texloom.stages.analysis.regularity.lattice import LatticeParams, lattice
from texloom.stages.common.grids import working_size
from texloom.stages.vocabulary.arrays import Image


def of(image: Image, **params: float) -> Autocorrelation:
    return autocorrelation(image, AutocorrelationParams(**params))


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
    result = of(image, peaks=1000, min_correlation=0.0)
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
    measured = []
    for hidden in (0.0, rng.random((120, 130, 3))):
        pixels = np.dstack([np.where(usable > 0, exemplar.pixels, hidden), usable])
        measured.append(of(Image(pixels.astype(np.float32), ("R", "G", "B", "A"))))
    np.testing.assert_array_equal(measured[0].correlation, measured[1].correlation)
    np.testing.assert_array_equal(measured[0].peaks, measured[1].peaks)


def test_peaks_of_large_exemplars_are_at_their_own_size(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(working_size, "MOST_PIXELS", 20_000)
    image, generators = tiled(smooth_noise((30, 44, 3), 3.0, rng), 11, (240, 280))
    result = of(image, peaks=8)
    assert result.density.shape == (121, 141)
    steps = result.peaks @ np.linalg.inv(generators)
    np.testing.assert_allclose(steps, np.rint(steps), atol=0.05)
    found = lattice(image, result.density, LatticeParams(beta=3))
    assert difference(found.generators, generators) < 0.5
