from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import LATTICES, picture, stamped
from tests.tilings import hexagons, running_bond
from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.analysis.regularity.lattice_tracking import track_lattice
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image

TILINGS = {"hexagons": hexagons((200, 210), 19.0), "running bond": running_bond((200, 220), 18, 54)}


def of_many_tones(label: np.ndarray, rng: np.random.Generator) -> Image:
    """Tiles whose tones differ more than their joints stand out, and grain."""
    tones = rng.normal(0.5, 0.12, int(label.max()) + 1)
    tones[0] = 0.6
    grain = gaussian_blur(rng.standard_normal(label.shape).astype(np.float32), 1.0)
    return picture(np.clip(gaussian_blur(tones[label].astype(np.float32), 0.7) + 0.12 * grain, 0.02, 0.98) ** 2.2)


@pytest.mark.parametrize("name", TILINGS)
def test_tiles_of_many_tones_are_tracked_by_their_joints(name: str) -> None:
    """Their lightness, which is compared first, places few vertices, and these unevenly."""
    label, generators = TILINGS[name]
    images = [of_many_tones(label, np.random.default_rng(seed)) for seed in range(4)]
    found = [deformed_lattice(image, DeformedLatticeParams(), generators.astype(np.float32)) for image in images]
    assert np.mean([lattice.detected for lattice in found]) > 0.55  # of those whose cells are whole, 0.7 of all
    assert np.mean([lattice.deviation for lattice in found]) < 1.2


def test_lightness_is_kept_where_nothing_is_clearer(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["sheared"], rng)
    generators = LATTICES["sheared"]
    vertices, correlations = track_lattice(image, generators, 0.2)
    assert np.median(correlations) > 0.7
    away = vertices.places - vertices.steps @ generators
    assert np.abs(away - np.median(away, axis=0)).max() < 1


def test_reversed_contours_do_not_pull_vertices_to_one_edge() -> None:
    """A score counts vertices that lie midway between others, not just their correlations."""
    label, generators = running_bond((260, 300), 24, 72)
    image = of_many_tones(label, np.random.default_rng(1))
    vertices, _ = track_lattice(image, generators, 0.2)
    away = vertices.places - vertices.steps @ generators
    away = np.hypot(*(away - np.median(away, axis=0)).T)
    assert np.mean(away < 2.4) > 0.8
