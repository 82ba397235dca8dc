"""Known faults of results, and the measures that detect them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft, ndimage

from tests.evaluation.helpers import encoded, tinted
from tests.synthetic import LATTICES, picture, stamped
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity

SIDES = {"gravel": 128, "brick": 160, "grass": 160}  # the smallest at which each photograph is recognisable
OTHER = {"gravel": "brick", "brick": "gravel", "grass": "gravel"}
Scores = dict[str, dict[str, dict[str, object]]]


def shuffled(values: np.ndarray, block: int) -> np.ndarray:
    """Squares of ``block`` px in random order."""
    rows, columns = values.shape[0] // block, values.shape[1] // block
    inside = values[: rows * block, : columns * block]
    blocks = (
        inside.reshape(rows, block, columns, block, -1).swapaxes(1, 2).reshape(-1, block, block, values.shape[2])
    )
    mixed = blocks[np.random.default_rng(5).permutation(len(blocks))]
    return mixed.reshape(rows, columns, block, block, -1).swapaxes(1, 2).reshape(inside.shape)


def other_phases(values: np.ndarray) -> np.ndarray:
    """The same spectrum, of random phase."""
    turn = fft.rfft2(np.random.default_rng(6).standard_normal(values.shape[:2]))
    turn /= np.abs(turn)
    turn[0, 0] = 1
    planes = [fft.irfft2(fft.rfft2(values[..., c]) * turn, s=values.shape[:2]) for c in range(values.shape[2])]
    return np.stack(planes, axis=2)


def faulty(exemplar: np.ndarray) -> dict[str, np.ndarray]:
    """Results that are wrong in one way each."""
    side = len(exemplar)
    half = exemplar[: side // 2, : side // 2]
    return {
        "tile": np.tile(half, (2, 2, 1)),
        "blur": ndimage.gaussian_filter(exemplar, (1, 1, 0)),
        "fog": ndimage.gaussian_filter(exemplar, (2, 2, 0)),
        "noise": exemplar + np.random.default_rng(7).normal(0, 0.05, (side, side, 1)),
        "blocks32": shuffled(exemplar, 32),
        "blocks8": shuffled(exemplar, 8),
        "pixels": shuffled(exemplar, 1),
        "phases": other_phases(exemplar),
        "hue": exemplar[..., ::-1],
    }


@pytest.fixture(scope="module", params=list(SIDES))
def scores(request: pytest.FixtureRequest) -> Scores:
    """The lines of the table by result and measure."""
    whole = tinted(request.param)
    side = SIDES[request.param]
    exemplar = whole[:side, :side]
    results = {
        "identity": exemplar,
        "crop": whole[:side, side : 2 * side],  # farther away, light and scale of the photographs differ
        **faulty(exemplar),
        "other": tinted(OTHER[request.param])[:side, :side],
    }
    ours = encoded(exemplar)
    return {
        name: metrics(ours, encoded(values), MetricsParams()).table["measures"] for name, values in results.items()
    }


def order(scores: Scores, name: str, *results: str) -> None:
    """The measure's value grows from result to result, best first."""
    values = [scores[result][name]["value"] for result in results]
    assert values == sorted(values), dict(zip(results, values, strict=True))
    assert len(set(values)) == len(values)


def test_the_exemplar_itself_is_best(scores: Scores) -> None:
    for name in ("colors", "patches", "statistics", "coherence", "completeness", "autocorrelation"):
        line = scores["identity"][name]
        assert line["value"] == 0
        assert line["score"] in (1, None)
    assert scores["identity"]["sharpness"]["value"] == 1
    assert scores["identity"]["smoothness"]["score"] == 1
    assert scores["identity"]["repetition"]["score"] == 1


def test_another_sample_of_noise_is_not_punished() -> None:
    exemplar, other = (encoded(np.random.default_rng(seed).uniform(0.3, 0.7, (96, 96))) for seed in (1, 2))
    lines = metrics(exemplar, other, MetricsParams()).table["measures"]
    for name in ("colors", "patches", "autocorrelation", "coherence", "completeness"):
        assert lines[name]["score"] is None or lines[name]["score"] > 0.7, name


def test_blur_and_noise_lose_sharpness(scores: Scores) -> None:
    order(scores, "sharpness", "fog", "blur", "identity", "noise", "pixels")
    assert scores["blur"]["sharpness"]["score"] < 0.05
    assert scores["fog"]["sharpness"]["score"] == 0
    assert scores["noise"]["sharpness"]["score"] < 0.7
    assert scores["fog"]["smoothness"]["score"] < 0.3
    assert scores["crop"]["sharpness"]["score"] > 0.7
    order(scores, "smoothness", "identity", "blur")


def test_shuffled_pixels_lose_patches(scores: Scores) -> None:
    for name in ("patches", "statistics", "coherence"):
        order(scores, name, "identity", "crop", "blocks8", "pixels")
    order(scores, "completeness", "identity", "crop", "pixels")
    for name in ("patches", "statistics", "coherence", "completeness"):
        assert scores["pixels"][name]["score"] < 0.3 < scores["crop"][name]["score"]


def test_shuffled_blocks_and_random_phases_lose_joint_statistics(scores: Scores) -> None:
    order(scores, "statistics", "identity", "blocks32", "blocks8", "pixels")
    for result in ("blocks8", "phases"):
        order(scores, "statistics", "identity", "crop", result)
        assert scores[result]["statistics"]["score"] < scores["crop"]["statistics"]["score"] - 0.1


def test_another_texture_is_not_faithful(scores: Scores) -> None:
    for name in ("colors", "patches", "statistics"):
        order(scores, name, "identity", "crop", "other")
        assert scores["other"][name]["score"] < scores["crop"][name]["score"] - 0.1


def test_what_a_tile_leaves_out_is_missed(scores: Scores) -> None:
    assert scores["tile"]["completeness"]["value"] > scores["tile"]["coherence"]["value"]


def test_a_tiling_repeats_itself(scores: Scores) -> None:
    line = scores["tile"]["repetition"]
    assert line["value"] == pytest.approx(1, abs=0.05)
    assert sorted(abs(step) for step in line["more"]["offset"]) in [
        offset for side in SIDES.values() for offset in ([0, side // 2], [side // 2] * 2)
    ]
    assert scores["tile"]["repetition"]["score"] < 0.1
    for name in ("crop", "blocks32", "blocks8", "pixels", "phases"):
        assert scores[name]["repetition"]["value"] < 0.7


def test_another_hue_loses_color(scores: Scores) -> None:
    order(scores, "colors", "identity", "crop", "hue")
    assert scores["hue"]["colors"]["score"] < 0.3
    assert scores["pixels"]["colors"]["value"] == 0
    parts = scores["hue"]["colors"]["more"]["channels"]
    assert parts["b"] > parts["L"]


# -- a lattice, whose faults statistics do not detect


def test_a_lattice_out_of_step_is_caught_by_regularity() -> None:
    generators = LATTICES["half_drop"]
    exemplar = stamped(generators, np.random.default_rng(11))
    pixels = exemplar.pixels.astype(np.float64)
    sheared = pixels.copy()
    sheared[150:] = np.roll(sheared[150:], 30, axis=1)
    results = {
        "identity": pixels,
        "noise": pixels + np.random.default_rng(12).normal(0, 0.03, pixels.shape),
        "blur": ndimage.gaussian_filter(pixels, (2, 2, 0)),
        "out of step": sheared,
        "blocks96": shuffled(pixels, 96),
        "blocks32": shuffled(pixels, 32),
        "phases": other_phases(pixels - pixels.mean()) + pixels.mean(),
        "other": tinted("gravel")[:288, :320],
    }
    tables = {
        name: regularity(exemplar, picture(values), RegularityParams(), generators.astype(np.float32)).table
        for name, values in results.items()
    }
    recall = {name: table["measures"]["recall"]["score"] for name, table in tables.items()}
    mean = {name: table["summary"]["regularity"] for name, table in tables.items()}
    assert mean["identity"] == 1
    assert min(mean["noise"], mean["blur"]) > 0.9
    assert max(mean[name] for name in ("out of step", "blocks96")) < 0.8
    assert max(mean[name] for name in ("blocks32", "other")) < 0.2
    assert recall["phases"] < 0.5
