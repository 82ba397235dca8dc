"""Energies of compactions of several sizes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import TsvqParams, check_channels, tsvq
from texloom.stages.evaluation.energy_curve import EnergyCurve, EnergyCurveParams, check_sizes, energy_curve
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features, outlines
from texloom.stages.synthesis.inverse.atlas import AtlasParams, atlas
from texloom.stages.synthesis.inverse.energy import ExactEnergy
from texloom.stages.synthesis.inverse.size_search import knee
from texloom.stages.vocabulary.declare import InputError, Outline


def run(seed: int = 3, **params: int) -> EnergyCurve:
    texture = picture(smooth_noise((64, 72), 2.5, np.random.default_rng(1)))
    features = control_features(texture, ControlFeaturesParams()).planes
    tree = tsvq(features, TsvqParams(neighbourhood=5))
    candidates = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=3)).candidates
    options = EnergyCurveParams(**{"least": 10, "most": 60, "sizes": 4, "samples": 1000, **params})
    return energy_curve(texture, features, tree.nodes, tree.leaf, candidates, options, np.random.default_rng(seed))


def test_larger_compactions_have_less_energy() -> None:
    curve = run()
    rows = curve.table["rows"]
    assert [row["side"] for row in rows] == [10, 18, 33, 60]
    energies = [row["energy"] for row in rows]
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < 0.3 * energies[0]
    for row in rows:
        assert row["pixels"] == row["side"] ** 2
        assert row["energy"] == pytest.approx(row["inverse"] + row["forward"])
        assert 0 < row["share"] < 1
        assert row["means"] <= row["patches"] <= row["crop"]
        assert row["way"] == pytest.approx((row["crop"] - row["inverse"]) / (row["crop"] - row["patches"]))
    assert curve.table["knee"] in [row["pixels"] for row in rows]
    assert curve.figure.pixels.shape == (750, 1200, 3)
    assert 0 <= curve.figure.pixels.min() < 0.1
    assert curve.figure.pixels.max() == 1


def test_same_seed_same_curve() -> None:
    one, other = run(sizes=3, most=20), run(sizes=3, most=20)
    assert one.table == other.table
    np.testing.assert_array_equal(one.figure.pixels, other.figure.pixels)
    assert run(seed=4, sizes=3, most=20).table["rows"] != one.table["rows"]


@pytest.mark.parametrize(
    ("energies", "size"),
    [([10.0, 2.0, 1.0, 0.5], 20), ([10.0, 9.0, 1.0, 0.5], 30), ([10.0, 7.0, 4.0, 1.0], 10), ([1.0] * 4, 10)],
)
def test_the_knee_of_a_curve(energies: list[float], size: int) -> None:
    sizes = [10.0, 20.0, 30.0, 40.0]
    assert sizes[knee(sizes, energies)] == size


def test_no_two_neighbourhoods_are_farther_apart() -> None:
    planes = np.zeros((20, 30, 1), np.float32)
    planes[:, 15:] = 10
    assert 100 <= ExactEnergy(planes, 5, 100).largest() < 200


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"least": 70, "most": 80}, "least=70 px is not below the shorter side of texture, 72 x 64 px"),
        ({"least": 20, "most": 20}, "least=20 px is not below most=20 px"),
    ],
)
def test_sizes_are_checked_before_anything_runs(params: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(**params)
    with pytest.raises(InputError, match=message):
        check_sizes(EnergyCurveParams(**params), {"texture": picture(np.zeros((64, 72)))})  # type: ignore[arg-type]


def test_a_family_of_textures(rng: np.random.Generator) -> None:
    """Half of an atlas is a gap, whose neighbourhoods do not count."""
    textures = [picture(0.5 * smooth_noise((40, 44), 2, rng) + 0.5 * light) for light in (0, 1)]
    together = atlas(
        textures, [{"name": "dark", "seed": 1}, {"name": "light", "seed": 1}], AtlasParams(gap=40)
    )  # fmt: skip
    features = control_features(together.image, ControlFeaturesParams()).planes
    tree = tsvq(features, TsvqParams(neighbourhood=5), together.rectangles)
    candidates = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams(k=3)).candidates
    options = EnergyCurveParams(least=12, most=36, sizes=3, samples=1000)
    curve = energy_curve(
        together.image, features, tree.nodes, tree.leaf, candidates, options, rng, together.rectangles
    )  # fmt: skip
    energies = [row["energy"] for row in curve.table["rows"]]
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < 0.6 * energies[0]


def test_too_many_channels_are_refused_before_anything_runs() -> None:
    frames = Outline(64, 64, ("R", "G", "B", *(f"frame{number}" for number in range(90))))
    planes = outlines(ControlFeaturesParams(), {"texture": frames})["planes"]
    assert len(planes.channels) == 94  # and one of detail
    with pytest.raises(InputError, match=r"^tsvq: 94 channels in neighbourhoods of 7 px are too many; at most "):
        check_channels(TsvqParams(), {"features": planes})
