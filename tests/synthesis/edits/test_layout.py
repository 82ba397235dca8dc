from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import blobs, masked, picture, tiled
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.edits.layout import CollageLayout, LayoutParams, layout
from texloom.stages.synthesis.optimisation.optimise import Optimised, optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE, SIZE = (88, 96), (96, 112)
SEAM = 60  # column


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def pasted(exemplar: Image) -> Image:
    """Two columns of pieces, of two pieces each that do not fit together."""
    pixels = np.empty((*SIZE, len(exemplar.channels)), np.float32)
    own = exemplar.pixels
    pixels[:50, :SEAM], pixels[50:, :SEAM] = own[5:55, 3 : 3 + SEAM], own[2:48, 20 : 20 + SEAM]
    pixels[:50, SEAM:], pixels[50:, SEAM:] = own[30:80, 40:92], own[0:46, 10:62]
    return Image(pixels, exemplar.channels)


def run(exemplar: Image, collage: Image, seed: int = 1, pieces: Any = None, **params: Any) -> CollageLayout:
    return layout(exemplar, collage, LayoutParams(**params), np.random.default_rng(seed), pieces)


def rectified(exemplar: Image, collage: Image, **params: Any) -> Optimised:
    made = run(exemplar, collage, **params)
    quick = OptimiseParams(preset="fast", tileable=params.get("tileable", False))
    return optimise(
        made.image, made.start, quick, np.random.default_rng(2), keep=made.keep,
        exemplar_guide=made.exemplar_guide, target_guide=made.target_guide,
    )  # fmt: skip


def test_joints_are_found(exemplar: Image) -> None:
    joints = run(exemplar, pasted(exemplar)).joints
    assert joints[48:52].mean() > 0.9
    assert joints[:, SEAM - 2 : SEAM + 2].mean() > 0.9
    inside = np.ones(SIZE, bool)
    inside[42:58] = inside[:, SEAM - 8 : SEAM + 8] = False
    assert joints[inside].mean() < 0.02


def test_joints_between_known_pieces_need_not_be_found(exemplar: Image) -> None:
    pieces = np.zeros(SIZE, np.int32)
    pieces[:, 30:] = 1
    joints = run(exemplar, pasted(exemplar), pieces=pieces).joints
    assert joints[:, 28:32].all()
    assert not joints[:, 50:].any()


def test_strengths_keep_nested_parts(exemplar: Image) -> None:
    kept = [run(exemplar, pasted(exemplar), strength=strength).keep for strength in (0, 0.3, 0.7, 1)]
    assert not kept[0].any()
    for less, more in pairwise(kept):
        assert not (less & ~more).any()
        assert more.sum() > less.sum()


@pytest.mark.parametrize("tileable", [False, True])
def test_results_are_the_nearer_to_the_layout_the_stronger(exemplar: Image, tileable: bool) -> None:
    collage = pasted(exemplar)
    differences = [
        np.abs(
            rectified(exemplar, collage, strength=strength, tileable=tileable).image.pixels - collage.pixels
        ).mean()
        for strength in (0, 0.5, 1)
    ]
    assert differences[0] > 1.2 * differences[1] > 1.4 * differences[2]


def test_what_is_kept_is_bit_identical_and_joints_are_mended(exemplar: Image) -> None:
    collage = pasted(exemplar)
    keep = run(exemplar, collage, strength=1).keep
    result = rectified(exemplar, collage, strength=1).image.pixels
    np.testing.assert_array_equal(result[keep], collage.pixels[keep])

    def jump(pixels: np.ndarray) -> float:
        return float(np.abs(pixels[:, SEAM] - pixels[:, SEAM - 1]).mean())

    assert jump(result) < 0.7 * jump(collage.pixels)


def test_tileable_results_continue_across_their_borders(exemplar: Image) -> None:
    collage = pasted(exemplar)
    pixels = rectified(exemplar, collage, strength=1, tileable=True).image.pixels
    for axis in (0, 1):
        jumps = np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=(1 - axis, 2))
        assert jumps[0] < 1.5 * jumps[1:].mean()
        before = np.abs(collage.pixels - np.roll(collage.pixels, 1, axis)).mean(axis=(1 - axis, 2))
        assert jumps[0] < 0.7 * before[0]


def test_nothing_is_asked_for_where_nothing_is_laid(exemplar: Image) -> None:
    """And neither the values there nor those of masked pixels of the exemplar matter."""
    usable = np.ones(SHAPE, bool)
    usable[:30, 60:] = False
    collage = pasted(exemplar)
    alpha = np.ones((*SIZE, 1), np.float32)
    alpha[60:, 70:] = 0
    results = []
    for value in (0.2, 0.9):
        pixels = np.where(alpha > 0, collage.pixels, np.float32(value))
        laid = Image(np.concatenate([pixels, alpha], axis=2), (*collage.channels, "A"))
        made = run(masked(exemplar, usable, value), laid, strength=1)
        assert np.isnan(made.target_guide[60:, 70:]).all()
        assert made.joints[60:, 70:].all()
        assert not made.keep[60:, 70:].any()
        results.append(rectified(masked(exemplar, usable, value), laid, strength=1).image)
    np.testing.assert_array_equal(results[0].pixels, results[1].pixels)
    assert results[0].channels == exemplar.channels


def test_maps_that_the_collage_lacks_are_those_of_the_exemplar(exemplar: Image) -> None:
    height = exemplar.pixels.mean(axis=2, keepdims=True)
    material = Image(np.concatenate([exemplar.pixels, height], axis=2), (*exemplar.channels, "height"))
    result = rectified(material, pasted(exemplar), strength=1).image
    assert result.channels == material.channels
    errors = np.abs(result.pixels[..., 3] - result.pixels[..., :3].mean(axis=2))
    assert np.quantile(errors, 0.9) < 0.02


@pytest.mark.parametrize(
    ("is_grey", "told"), [(True, "the layout's colours are dropped"), (False, "three equal channels")]
)
def test_grey_and_colour_are_told(
    exemplar: Image, caplog: pytest.LogCaptureFixture, is_grey: bool, told: str
) -> None:
    grey = Image(exemplar.pixels[..., :1].copy(), ("Y",))
    made = run(grey, pasted(exemplar)) if is_grey else run(exemplar, pasted(grey))
    assert made.image.channels[0] == ("Y" if is_grey else "R")
    (message,) = caplog.messages
    assert told in message


def test_one_result_for_any_number_of_threads(exemplar: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = run_with_threads(lambda: run(exemplar, pasted(exemplar)), monkeypatch, (1, 2))
    np.testing.assert_array_equal(one.start, two.start)
    np.testing.assert_array_equal(one.keep, two.keep)
    np.testing.assert_array_equal(one.target_guide, two.target_guide)


@pytest.mark.parametrize("courses", [False, True])
def test_what_is_made_is_in_phase_with_most_of_the_collage(courses: bool, rng: np.random.Generator) -> None:
    """A piece half a cell out of phase is replaced, and one in phase kept where it is."""
    regular, generators = tiled(blobs((20, 28, 3), rng, 2.0), 0, (120, 140))
    exemplar = Image(regular.pixels + rng.normal(0, 0.01, regular.shape).astype(np.float32), regular.channels)
    own = exemplar.pixels
    collage = own[7:97, 5:117].copy()
    collage[:, 70:] = own[17:107, 33:75]  # ten rows lower
    lattice = np.float32([[20, 0]]) if courses else generators
    made = layout(
        exemplar, Image(collage, exemplar.channels), LayoutParams(), np.random.default_rng(1), generators=lattice
    )
    assert made.generators is lattice
    assert made.keep[:, :60].any()
    assert not made.keep[:, 80:].any()
    options = OptimiseParams(preset="fast")
    texture = optimise(
        made.image, made.start, options, np.random.default_rng(2), generators=made.generators, keep=made.keep
    )
    np.testing.assert_array_equal(texture.image.pixels[made.keep], collage[made.keep])
    if not courses:
        replaced = texture.image.pixels[:, 80:]
        off = [np.abs(replaced - regular.pixels[top : top + 90, 85:117]).mean() for top in (7, 17)]
        assert off[0] < 0.5 * off[1]


def test_a_collage_of_turned_pieces_follows_no_lattice(rng: np.random.Generator) -> None:
    regular, generators = tiled(blobs((20, 28, 3), rng, 2.0), 0, (120, 140))
    turned = Image(np.ascontiguousarray(np.rot90(regular.pixels)[:100]), regular.channels)
    random = np.random.default_rng(1)
    assert not len(layout(regular, turned, LayoutParams(), random, generators=generators).generators)


def test_an_empty_collage_is_refused(exemplar: Image) -> None:
    empty = Image(np.zeros((*SIZE, 4), np.float32), ("R", "G", "B", "A"))
    check = find_stage("synthesis.layout").check
    assert check is not None
    with pytest.raises(InputError, match="layout: all of it is transparent"):
        check(LayoutParams(), {"image": exemplar, "layout": empty})
    with pytest.raises(InputError, match="too small"):
        check(LayoutParams(), {"image": exemplar, "layout": picture(np.zeros((15, 40, 3)))})
