from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import texloom
from tests.evaluation.helpers import encoded, tinted
from texloom.stages.evaluation.estimated_match import EstimatedMatch, EstimatedMatchParams, estimated_match
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import USABLE


@pytest.fixture(scope="module")
def exemplar() -> Image:
    return encoded(tinted("gravel")[:96, :112])


def estimate(exemplar: Image, image: Image) -> EstimatedMatch:
    return estimated_match(exemplar, image, EstimatedMatchParams())


def measures(exemplar: Image, image: Image) -> dict[str, dict[str, Any]]:
    known = estimate(exemplar, image)
    return metrics(exemplar, image, MetricsParams(), known.match, copies=known.copies).table["measures"]


def moved(image: Image, rows: slice, columns: slice) -> Image:
    return Image(np.ascontiguousarray(image.pixels[rows, columns]), image.channels)


def test_a_crop_is_a_copy(exemplar: Image) -> None:
    crop = moved(exemplar, slice(10, 90), slice(20, 110))
    known = estimate(exemplar, crop)
    np.testing.assert_array_equal(known.match, np.mgrid[10:90, 20:110].transpose(1, 2, 0))
    assert known.copies.all()
    assert measures(exemplar, crop)["copying"]["score"] == 0


def test_a_tiling_is_a_copy_up_to_its_joints(exemplar: Image) -> None:
    tiling = Image(np.tile(exemplar.pixels, (2, 2, 1)), exemplar.channels)
    truth = np.tile(np.mgrid[:96, :112].transpose(1, 2, 0), (2, 2, 1))
    known = estimate(exemplar, tiling)
    assert (known.match == truth).all(axis=2).mean() > 0.99
    lines = measures(exemplar, tiling)
    assert lines["copying"]["value"] > 0.99
    assert lines["continuity"]["value"] == pytest.approx(1 - 1 / 207, abs=0.005)
    assert {name for name, line in lines.items() if line.get("estimated")} == {
        "copying",
        "continuity",
        "copies",
        "contents",
        "joints",
        "steps",
    }


def test_slight_noise_leaves_copies(exemplar: Image) -> None:
    rng = np.random.default_rng(1)
    noisy = np.clip(exemplar.pixels * rng.normal(1, 0.02, exemplar.pixels.shape), 0, 1).astype(np.float32)
    known = estimate(exemplar, Image(noisy, exemplar.channels))
    assert (known.match == np.mgrid[:96, :112].transpose(1, 2, 0)).all(axis=2).mean() > 0.99
    assert known.copies.mean() > 0.99


def test_measures_are_those_of_the_known_source_map() -> None:
    values = tinted("gravel")[:128, :128]
    texture = texloom.synthesize(encoded(values).pixels, size=192, method="quilting", seed=3)
    assert texture.source_map is not None
    result = Image(np.ascontiguousarray(texture.image), ("R", "G", "B"))
    exemplar = encoded(values)
    known = metrics(exemplar, result, MetricsParams(), texture.source_map).table["measures"]
    lines = measures(exemplar, result)
    for name, tolerance in {"copying": 0.1, "continuity": 0.02, "contents": 0.1, "joints": 0.3}.items():
        assert lines[name]["value"] == pytest.approx(known[name]["value"], abs=tolerance), name


def test_another_texture_is_no_copy(exemplar: Image) -> None:
    lines = measures(exemplar, encoded(tinted("grass")[:100, :100]))
    assert lines["copying"]["value"] == 0
    for name in ("copies", "contents", "continuity", "joints", "steps"):
        assert "of the pixels are copies" in lines[name]["reason"], name


def test_masked_pixels_are_no_source(exemplar: Image) -> None:
    usable = np.ones((96, 112), np.float32)
    usable[:, :60] = 0
    pixels = np.concatenate([exemplar.pixels, usable[..., None]], axis=2)
    marked = Image(np.ascontiguousarray(pixels), (*exemplar.channels, USABLE))
    known = estimate(marked, exemplar)
    assert (known.match[..., 1] >= 60).all()
    assert known.copies[:, 66:].all()
    assert known.copies[:, :50].mean() < 0.2


@pytest.mark.parametrize("shape", [(1, 1), (3, 40)])
def test_small_pictures_have_a_source(exemplar: Image, shape: tuple[int, int]) -> None:
    small = moved(exemplar, slice(0, shape[0]), slice(0, shape[1]))
    assert estimate(exemplar, small).match.shape == (*shape, 2)
    assert (estimate(small, exemplar).match < shape).all()
    assert not estimate(encoded(np.full((9, 9), 0.5)), encoded(np.full((20, 20), 0.5))).copies.any()


def test_the_same_bits_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch, exemplar: Image) -> None:
    result = encoded(tinted("gravel")[40:240, 30:230])
    maps = []
    for threads in ("1", "3"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        maps.append(estimate(exemplar, result).match.tobytes())
    assert maps[0] == maps[1]
