"""Pairs of pictures that wrap around and of such that do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft, ndimage

from tests.evaluation.helpers import encoded, tinted
from tests.wraps import X, Y
from texloom.stages.evaluation._measures import pixels
from texloom.stages.evaluation._measures.pictures import prepare
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.facts import TORUS, Wraps


def periodic(seed: int, deviation: float) -> np.ndarray:
    """Smooth noise that wraps around, of contrast 1/4."""
    noise = np.random.default_rng(seed).standard_normal((128, 160))
    smooth = ndimage.gaussian_filter(noise, deviation, mode="wrap")
    return np.asarray(np.clip(0.5 + 0.12 * smooth / smooth.std(), 0, 1))


def seams(values: np.ndarray, wraps: Wraps = TORUS) -> dict[str, float]:
    picture = prepare(encoded(values), encoded(values))[0]
    line = pixels.seams(Task(picture, picture, picture, None, None, wraps, 0.25, 9)).line()
    return {"value": line["value"], "score": line["score"], **line["more"]}


@pytest.mark.parametrize("deviation", [0.0, 0.7, 1.5, 4.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_periodic_picture_has_no_seam_and_its_crop_has(seed: int, deviation: float) -> None:
    whole = periodic(seed, deviation) if deviation else np.random.default_rng(seed).uniform(0, 1, (128, 160))
    good = seams(whole)
    assert good["value"] < 2.5
    assert good["score"] > 0.6
    if deviation > 1:  # noise without correlation wraps around wherever it is cut
        bad = seams(whole[:-13, :-9])
        assert bad["score"] < 0.3 < 0.9 < bad["rank"]


def test_bricks_are_judged_by_their_border_and_not_by_their_mortar() -> None:
    rows, columns = np.mgrid[:160, :160]
    mortar = (rows % 20 < 3) | ((columns + 20 * (rows // 20 % 2)) % 40 < 3)
    values = ndimage.gaussian_filter(np.where(mortar, 0.8, 0.35), 0.8, mode="wrap")
    values += np.random.default_rng(5).normal(0, 0.015, values.shape)
    assert seams(values)["score"] > 0.7
    assert seams(np.roll(values, 1, axis=0))["score"] > 0.7  # the border at a contour
    assert seams(values[:-10])["score"] < 0.3
    assert seams(values[:, :-7])["score"] < 0.3


def test_only_borders_across_which_a_picture_continues_are_measured() -> None:
    cut = periodic(4, 1.5)[:-13]  # continues from left to right alone
    assert seams(cut, X)["score"] > 0.6
    assert seams(cut, Y)["score"] < 0.3
    assert seams(np.ascontiguousarray(cut.T), Y)["value"] == pytest.approx(seams(cut, X)["value"])


def test_a_photograph_has_a_seam_and_its_mirrored_copy_has_not() -> None:
    values = tinted("gravel")[:128, :128]
    assert seams(values)["score"] < 0.3
    mirrored = np.concatenate([values, values[::-1]])
    assert seams(np.concatenate([mirrored, mirrored[:, ::-1]], axis=1))["score"] == 1


def test_excess_jumps_by_their_definition() -> None:
    lab = prepare(*(encoded(np.random.default_rng(6).uniform(0, 1, (9, 8, 3))),) * 2)[0].lab.astype(np.float64)
    for axis in (0, 1):
        planes = lab if axis == 0 else lab.swapaxes(0, 1)
        count = len(planes)
        jumps = [np.abs(planes[i] - planes[i - 1]) for i in range(count)]
        expected = [
            np.maximum(jumps[i] - np.maximum(jumps[i - 1], jumps[(i + 1) % count]), 0).mean() for i in range(count)
        ]
        np.testing.assert_allclose(pixels.excess_jumps(lab.astype(np.float32), axis), expected, rtol=1e-4)


def test_random_phases_keep_a_picture_periodic() -> None:
    values = tinted("grass")[:128, :128]
    turn = fft.rfft2(np.random.default_rng(7).standard_normal((128, 128)))
    turn /= np.abs(turn)
    turn[0, 0] = 1
    made = np.stack([fft.irfft2(fft.rfft2(values[..., c]) * turn) for c in range(3)], axis=2)
    assert seams(made)["score"] > 0.8
