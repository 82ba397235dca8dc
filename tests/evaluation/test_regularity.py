from __future__ import annotations

import json

import numpy as np
import pytest

from tests.synthetic import LATTICES, difference, picture, points, smooth_noise, stamped, tiled
from texloom.stages.common.regularity import lattice_cells
from texloom.stages.evaluation.regularity import Regularity, RegularityParams, regularity
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

NAMES = ("recall", "geometry", "appearance", "period")


def judged(exemplar: Image, result: Image, generators: np.ndarray) -> Regularity:
    return regularity(exemplar, result, RegularityParams(), generators.astype(np.float32))


def values(measured: Regularity, key: str = "score") -> dict[str, float]:
    return {name: measured.table["measures"][name][key] for name in NAMES}


@pytest.mark.parametrize("name", LATTICES)
def test_the_exemplar_itself_is_regular(name: str) -> None:
    generators = LATTICES[name]
    exemplar = stamped(generators, np.random.default_rng(1))
    measured = judged(exemplar, exemplar, generators)
    assert values(measured) == dict.fromkeys(NAMES, 1.0)
    assert measured.table["summary"] == {"regularity": 1.0}
    assert difference(measured.generators, generators) < 0.5
    # all whole cells, each at the same place of the lattice
    assert len(measured.points) == measured.table["measures"]["recall"]["more"]["expected"]
    phase = (measured.points - measured.points[0]) @ np.linalg.inv(generators)
    assert np.abs(phase - np.rint(phase)).max() < 0.05


def test_a_larger_result_of_the_same_lattice_is_regular() -> None:
    cell = smooth_noise((30, 42, 3), 2.0, np.random.default_rng(1))
    exemplar, generators = tiled(cell, 11, (150, 190))
    result, _ = tiled(np.roll(cell, (7, 9), (0, 1)), 11, (330, 260))
    measured = judged(exemplar, result, generators)
    assert measured.table["summary"]["regularity"] > 0.99
    assert difference(measured.generators, generators) < 0.1


def test_jitter_lowers_geometry() -> None:
    generators = LATTICES["half_drop"]
    exemplar, *others = (stamped(generators, np.random.default_rng(2), jitter=share) for share in (0, 0.05, 0.12))
    scores = [values(judged(exemplar, result, generators))["geometry"] for result in (exemplar, *others)]
    assert scores[0] == 1
    assert scores[0] > scores[1] + 0.02 > scores[2] + 0.1, scores


def changed(exemplar: Image, generators: np.ndarray, seed: int, contents: np.ndarray, opacity: float) -> Image:
    """``contents`` laid over every third cell."""
    origin = np.random.default_rng(seed)
    for _ in range(3):
        smooth = _motif_side(generators)
        origin.normal(size=(smooth, smooth))
    places = points(generators, (exemplar.height, exemplar.width), origin.uniform(0, 40, 2))
    pixels = exemplar.pixels.copy()
    reach = contents.shape[0] // 2
    for row, column in np.rint(places[::3]).astype(int):
        if reach <= row < exemplar.height - reach and reach <= column < exemplar.width - reach:
            part = pixels[row - reach : row + reach + 1, column - reach : column + reach + 1]
            part += np.float32(opacity) * (contents - part)
    return picture(pixels)


def _motif_side(generators: np.ndarray) -> int:
    return 2 * int(np.ceil(0.48 * np.hypot(*generators.T).min())) + 1


def test_missing_cells_lower_recall_and_not_geometry() -> None:
    generators = LATTICES["rectangular"]
    exemplar = stamped(generators, np.random.default_rng(3), shape=(330, 400))
    side = _motif_side(generators)
    result = changed(exemplar, generators, 3, np.full((side, side, 3), 0.4, np.float32), 1.0)
    measured = judged(exemplar, result, generators)
    assert 0.5 < measured.table["measures"]["recall"]["value"] < 0.85
    assert values(measured)["recall"] < 0.85
    assert values(measured)["geometry"] > 0.9
    assert len(measured.points) < len(judged(exemplar, exemplar, generators).points)


def test_changed_cells_lower_appearance() -> None:
    generators = LATTICES["rectangular"]
    exemplar = stamped(generators, np.random.default_rng(4), shape=(330, 400))
    side = _motif_side(generators)
    contents = np.stack([smooth_noise((side, side), 2.0, np.random.default_rng(k)) for k in range(3)], axis=2)
    result = changed(exemplar, generators, 4, contents.astype(np.float32), 0.4)
    scores = values(judged(exemplar, result, generators))
    assert scores["appearance"] < 0.9
    assert scores["recall"] > 0.9
    assert scores["geometry"] > 0.9


def test_one_repeated_cell_is_not_like_an_exemplar_of_many(rng: np.random.Generator) -> None:
    generators = np.array([[30.0, 0.0], [0.0, 42.0]])
    common = np.tile(smooth_noise((30, 42, 3), 3.0, rng), (6, 5, 1))
    exemplar = picture(common + 1.5 * smooth_noise(common.shape, 3.0, rng))
    monotonous = picture(np.tile(exemplar.pixels[30:60, 42:84], (6, 5, 1)))
    measured = judged(exemplar, monotonous, generators)
    assert measured.table["measures"]["appearance"]["more"]["ratio"] < 0.1
    assert values(measured)["appearance"] < 0.5


def test_a_picture_without_the_lattice_has_none(rng: np.random.Generator) -> None:
    generators = LATTICES["sheared"]
    exemplar = stamped(generators, np.random.default_rng(5))
    measured = judged(exemplar, picture(smooth_noise((260, 300, 3), 2.0, rng)), generators)
    assert measured.table["summary"]["regularity"] < 0.15
    assert measured.generators.shape == (0, 2)


@pytest.mark.parametrize(
    ("generators", "side", "reason"),
    [
        (None, 96, "no lattice"),
        (np.zeros((0, 2)), 96, "no lattice"),
        (np.array([[60.0, 0], [0, 60]]), 96, "whole cells"),
        (np.array([[20.0, 0], [0, 20]]), 30, "room for"),
        (np.array([[60.0, 0], [0, 60]]), 1, "shorter side"),
    ],
)
def test_what_cannot_be_measured_has_a_reason(
    generators: np.ndarray | None, side: int, reason: str, rng: np.random.Generator
) -> None:
    cell = rng.uniform(0.2, 0.8, (20, 20, 3))
    exemplar, _ = tiled(cell, 0, (96, 96))
    result, _ = tiled(cell, 0, (side, side))
    inputs = None if generators is None else generators.astype(np.float32)
    measured = regularity(exemplar, result, RegularityParams(), inputs)
    json.dumps(measured.table, allow_nan=False)
    assert measured.table["summary"] == {"regularity": None}
    for line in measured.table["measures"].values():
        assert line["value"] is line["score"] is None
        assert reason in line["reason"]
    assert measured.points.shape == measured.generators.shape == (0, 2)


@pytest.mark.parametrize("which", ["exemplar", "result"])
def test_a_plain_picture_is_no_lattice(which: str, rng: np.random.Generator) -> None:
    exemplar, generators = tiled(smooth_noise((20, 24, 3), 2.0, rng), 0, (120, 120))
    plain = picture(np.full((120, 120, 3), 0.3))
    measured = judged(plain if which == "exemplar" else exemplar, plain, generators)
    assert all("one colour" in line["reason"] for line in measured.table["measures"].values())


def test_generators_on_a_line_are_refused() -> None:
    plain = picture(np.full((64, 64), 0.3))
    with pytest.raises(InputError, match="independent"):
        judged(plain, plain, np.array([[10, 10], [20, 20]]))


def test_correlation_is_its_definition(rng: np.random.Generator) -> None:
    tone = rng.normal(size=(24, 26)).astype(np.float32)
    tone[:9, :9] = 0.5
    offsets = lattice_cells.cell_offsets(np.array([[6.0, 1.0], [-2.0, 7.0]]))
    cell = lattice_cells.normalised(rng.normal(size=(1, len(offsets))))[0]
    correlation = lattice_cells.correlation(tone, offsets, cell)
    for row, column in np.ndindex(tone.shape):
        index = offsets + np.array([row, column])
        if (index < 0).any() or (index >= tone.shape).any():
            assert correlation[row, column] == -2
            continue
        pixels = tone[tuple(index.T)].astype(np.float64)
        expected = np.corrcoef(pixels, cell)[0, 1] if pixels.std() > 1e-3 else 0
        assert correlation[row, column] == pytest.approx(expected, abs=1e-4)


def test_cells_cover_the_plane_once() -> None:
    generators = np.array([[9.0, 4.0], [-2.0, 11.0]])
    offsets = lattice_cells.cell_offsets(generators)
    count = np.zeros((40, 40), int)
    places = points(generators, (40, 40), np.zeros(2))
    for place in np.rint(places).astype(int):
        index = place + offsets
        inside = ((index >= 0) & (index < 40)).all(axis=1)
        np.add.at(count, tuple(index[inside].T), 1)
    assert (count[15:25, 15:25] >= 1).all()
    assert (count == 1).mean() > 0.7  # those on borders belong to both
