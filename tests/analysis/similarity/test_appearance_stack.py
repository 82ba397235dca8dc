from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise, tiled
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack, level_count
from texloom.stages.common.similarity import appearance
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    return picture(smooth_noise((48, 56, 3), 1.5, rng))


def params(**values: object) -> AppearanceStackParams:
    return AppearanceStackParams.model_validate(values)


@pytest.mark.parametrize(("side", "count"), [(16, 1), (31, 1), (32, 2), (128, 4), (512, 6)])
def test_levels_leave_enough_pixels(side: int, count: int) -> None:
    assert level_count((side, 700), 16) == count


def test_whole_neighbourhoods_are_most_similar_to_themselves(image: Image) -> None:
    stack = appearance_stack(image, params(coarsest=12, k=3))
    rows, columns = np.indices((48, 56))
    own = rows * 56 + columns
    for level in range(3):
        reach = 3 * 2**level
        inner = np.zeros((48, 56), bool)
        inner[reach:-reach, reach:-reach] = True
        np.testing.assert_array_equal(stack.candidates[level, ..., 0] == own, inner)
        assert inner.ravel()[stack.candidates[level]].all()


def test_similar_places_are_alike_and_apart(rng: np.random.Generator) -> None:
    """In a tiling, places that look alike are whole cells away."""
    cell = (16, 20)
    image, _ = tiled(rng.random((*cell, 3)), 0, (64, 80))
    stack = appearance_stack(image, params(toroidal=True, coarsest=32, min_separation=0.1))
    tileable = appearance_stack(image.wrapping(True), params(coarsest=32, min_separation=0.1))
    for one, same in zip(dataclasses.astuple(stack), dataclasses.astuple(tileable), strict=True):
        np.testing.assert_array_equal(one, same)
    rows, columns = np.indices((64, 80))
    for level in range(2):
        other = stack.candidates[level, ..., 1]
        down, across = other // 80 - rows, other % 80 - columns
        exact = (down % cell[0] == 0) & (across % cell[1] == 0)
        assert exact.mean() > 0.95
        assert (np.maximum(abs(down), abs(across)) >= 6).mean() > 0.99


def test_coarse_levels_may_continue_only_the_pixel_itself(rng: np.random.Generator) -> None:
    torus = picture(smooth_noise((64, 64, 3), 1.5, rng))
    every, fine = (appearance_stack(torus, params(toroidal=True, similar_levels=most)) for most in (16, 1))
    assert len(every.candidates) == 3
    np.testing.assert_array_equal(fine.candidates[0], every.candidates[0])
    np.testing.assert_array_equal(fine.candidates[1:, ..., 1], fine.candidates[1:, ..., 0])
    assert (every.candidates[1:, ..., 1] != every.candidates[1:, ..., 0]).mean() > 0.9


def test_a_shifted_torus_is_analysed_alike(rng: np.random.Generator) -> None:
    """Up to the order in which sums are made."""
    pixels = rng.random((32, 32, 3))
    one, other = (
        appearance_stack(picture(np.roll(pixels, shift, (0, 1))), params(toroidal=True, k=1)).appearance
        for shift in ((0, 0), (5, 9))
    )
    assert abs(np.roll(one, (5, 9), (1, 2)).astype(int) - other).max() <= 2


def test_appearances_tell_what_windows_differ_by(rng: np.random.Generator) -> None:
    """Distances of neighbourhoods go with distances of their pixels."""
    image = picture(smooth_noise((48, 56), 3.0, rng))
    lightness = lab_from_linear(image.color)[..., :1]
    stack = appearance_stack(image, params(coarsest=24))
    vectors = appearance.neighbourhoods(stack.appearance[0], stack.basis[0], 0, False)
    vectors = vectors.reshape(48 * 56, 8).astype(float)
    windows = np.stack(
        [np.roll(lightness, (r, c), (0, 1)) for r in range(-3, 4) for c in range(-3, 4)], axis=2
    ).reshape(48 * 56, -1)
    inner = np.zeros((48, 56), bool)
    inner[4:-4, 4:-4] = True
    inside = np.flatnonzero(inner)
    one, other = np.random.default_rng(1).choice(inside, (2, 3000))
    far = np.linalg.norm(vectors[one] - vectors[other], axis=1)
    true = np.linalg.norm(windows[one] - windows[other], axis=1)
    assert np.corrcoef(far, true)[0, 1] > 0.85


def test_lengths_stay_in_range(rng: np.random.Generator) -> None:
    """Where sums of 16 bits would otherwise overflow."""
    image = picture((rng.random((40, 40, 3)) > 0.5) * 100.0)
    stack = appearance_stack(image, params())
    assert np.linalg.norm(stack.appearance.astype(float), axis=3).max() <= appearance.MAX_LENGTH
    np.testing.assert_allclose(np.linalg.norm(stack.basis.astype(float), axis=1), 2048, rtol=0.01)


def test_distance_is_compared(image: Image) -> None:
    plain = appearance_stack(image, params())
    field = np.linspace(0, 100, 48 * 56, dtype=np.float32).reshape(48, 56)
    guided = appearance_stack(image, params(), distance=field)
    assert (plain.appearance != guided.appearance).any()
    off = appearance_stack(image, params(guidance=0), distance=field)
    np.testing.assert_array_equal(plain.appearance, off.appearance)


def test_pixels_that_are_not_valid_are_not_used(image: Image) -> None:
    valid = np.ones((2, 48, 56), bool)
    valid[:, :20, :30] = False
    stack = appearance_stack(image, params(), valid=valid)
    used = np.zeros(48 * 56, bool)
    used[stack.candidates[0]] = True
    assert not used.reshape(48, 56)[:23, :33].any()
    assert used.reshape(48, 56)[23:45, 33:53].mean() > 0.5


def test_a_flat_jacobian_changes_little(image: Image) -> None:
    flat = np.tile(np.array([1, 0, 0, 1], np.float32), (48, 56, 1))
    plain, bent = appearance_stack(image, params()), appearance_stack(image, params(), jacobian=flat)
    inner = (0, slice(3, -3), slice(3, -3))
    for component in range(4):
        one, other = plain.appearance[inner][..., component], bent.appearance[inner][..., component]
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) > 0.98


def test_a_stretched_picture_is_seen_as_the_flat_one(rng: np.random.Generator) -> None:
    import cv2

    flat = smooth_noise((64, 64, 3), 3.0, rng).astype(np.float32)
    wide = cv2.resize(flat, (128, 64), interpolation=cv2.INTER_CUBIC)
    jacobian = np.tile(np.array([1, 0, 0, 2], np.float32), (64, 128, 1))
    stack = np.stack([wide]), np.stack([flat])
    seen = [
        appearance_stack(picture(pixels), params(k=1), jacobian=field, stack=planes).appearance[0]
        for pixels, field, planes in ((wide, jacobian, stack[0]), (flat, None, stack[1]))
    ]
    inner = seen[0][4:-4, 8:-8:2].reshape(-1, 8)[:, :3], seen[1][4:-4, 4:-4].reshape(-1, 8)[:, :3]
    for component in range(3):
        assert abs(np.corrcoef(inner[0][:, component], inner[1][:, component])[0, 1]) > 0.9


def test_threads_do_not_matter(image: Image, on_threads: Any) -> None:
    one, three = on_threads(lambda: appearance_stack(image, params(k=3)))
    np.testing.assert_array_equal(one.appearance, three.appearance)
    np.testing.assert_array_equal(one.candidates, three.candidates)


def test_a_constant_exemplar_is_no_trouble() -> None:
    stack = appearance_stack(picture(np.full((32, 32), 0.5)), params())
    assert not stack.appearance.any()


@pytest.mark.parametrize("shape", [(15, 100), (100, 8), (8192, 4096)])
def test_sizes_that_cannot_be_are_refused_before_anything_runs(shape: tuple[int, int]) -> None:
    check = find_stage("analysis.appearance_stack").check
    assert check is not None
    image = SimpleNamespace(height=shape[0], width=shape[1], channels=("Y",))
    with pytest.raises(InputError, match=f"image: {format_size(shape)} is"):
        check(params(), {"image": image})


def test_bad_inputs_are_refused(image: Image) -> None:
    with pytest.raises(InputError, match="image: a value is not finite"):
        appearance_stack(picture(np.full((32, 32), np.nan)), params())
    with pytest.raises(InputError, match="level 1: no neighbourhood of the exemplar is whole"):
        appearance_stack(image, params(), valid=np.zeros((2, 48, 56), bool))
    with pytest.raises(InputError, match="toroidal: a distorted exemplar"):
        appearance_stack(image, params(toroidal=True), jacobian=np.ones((48, 56, 4), np.float32))
    with pytest.raises(ValueError, match="distance of shape"):
        appearance_stack(image, params(), distance=np.zeros((48, 55), np.float32))
