"""Maps integrated from gradients."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from texloom.stages.synthesis.edits.gradient_domain import GradientDomainParams, gradient_domain
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Facts, MapFacts
from texloom.stages.vocabulary.masks import USABLE
from texloom.stages.vocabulary.normals import NORMAL, rounding
from texloom.stages.vocabulary.scratch import Scratch, using


def material(height: np.ndarray, **more: np.ndarray) -> Image:
    """Grey colour, the height, and further channels."""
    planes = {"Y": np.full_like(height, 0.5), "height": height, **more}
    return Image(np.stack(list(planes.values()), axis=2).astype(np.float32), tuple(planes))


def copied(exemplar: Image, match: np.ndarray) -> Image:
    return Image(exemplar.pixels[match[..., 0], match[..., 1]], exemplar.channels)


def integrated_height(
    exemplar: Image, match: np.ndarray, tileable: bool = False, keep: np.ndarray | None = None, **params: object
) -> np.ndarray:
    """The height."""
    checked = GradientDomainParams.model_validate(params)
    image = gradient_domain(exemplar, copied(exemplar, match).wrapping(tileable), match, checked, keep).image
    return image.pixels[..., image.channels.index("height")]


def integrated(exemplar: Image, image: Image, match: np.ndarray, **params: object) -> np.ndarray:
    """All channels."""
    return gradient_domain(exemplar, image, match, GradientDomainParams.model_validate(params)).image.pixels


def indices(height: int, width: int) -> np.ndarray:
    return np.moveaxis(np.indices((height, width), np.uint32), 0, 2)


def test_without_seams_nothing_changes(rng: np.random.Generator) -> None:
    exemplar = material(rng.random((30, 40)))
    match = indices(30, 40)[5:25, 7:30]
    np.testing.assert_array_equal(integrated_height(exemplar, match), exemplar.pixels[5:25, 7:30, 1])
    # No gradient is known across the borders of an exemplar.
    rolled = np.roll(indices(30, 40), (9, -4), (0, 1))
    for tileable in (False, True):
        np.testing.assert_array_equal(
            integrated_height(exemplar, rolled, tileable), copied(exemplar, rolled).pixels[..., 1]
        )


@pytest.mark.parametrize("axis", [0, 1])
def test_a_step_between_two_slopes_becomes_a_slope(axis: int) -> None:
    ramp = np.broadcast_to(np.linspace(0, 1, 101), (50, 101))
    match = np.concatenate([indices(50, 101)[:, 10:50], indices(50, 101)[:, 30:70]], axis=1)
    if axis == 0:
        ramp, match = ramp.T, match.swapaxes(0, 1)[..., ::-1]
    exemplar = material(np.ascontiguousarray(ramp))
    before = np.diff(copied(exemplar, match).pixels[..., 1], axis=axis)
    assert before.min() == pytest.approx(-0.19, abs=1e-5)
    after = np.diff(integrated_height(exemplar, np.ascontiguousarray(match), reach=1000.0), axis=axis)
    np.testing.assert_allclose(after, 0.01, atol=2e-4)
    near = np.diff(integrated_height(exemplar, np.ascontiguousarray(match), reach=4.0), axis=axis)
    assert near.min() > -0.06
    np.testing.assert_allclose(np.take(near, [0, 1, -2, -1], axis), 0.01, atol=1e-3)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("shape", [(6, 7), (7, 6)])
def test_it_is_the_least_squares_solution(
    rng: np.random.Generator, tileable: bool, kept: bool, shape: tuple[int, int]
) -> None:
    own, reach = rng.random((9, 8)).astype(np.float32), 3.0
    match = np.stack([rng.integers(0, side, shape) for side in own.shape], axis=2).astype(np.uint32)
    match[2:5, 1:4] = indices(3, 3) + np.uint32(4)
    values = own[match[..., 0], match[..., 1]].astype(np.float64)
    rows, differences = [], []
    for place in np.ndindex(shape):
        for axis in (0, 1):
            beside = list(place)
            beside[axis] += 1
            if beside[axis] == shape[axis]:
                if not tileable:
                    continue
                beside[axis] = 0
            slopes = []
            for source, sign in ((match[place], 1), (match[tuple(beside)], -1)):
                neighbour = source.astype(int)
                neighbour[axis] += sign
                if 0 <= neighbour[axis] < own.shape[axis]:
                    slopes.append(sign * (float(own[tuple(neighbour)]) - float(own[tuple(source)])))
            row = np.zeros(shape)
            row[tuple(beside)] += 1
            row[place] -= 1
            rows.append(row.ravel())
            differences.append(np.mean(slopes) if slopes else values[tuple(beside)] - values[place])
    keep = rng.random(shape) < 0.4 if kept else np.zeros(shape, bool)
    matrix = np.concatenate([rows, np.eye(values.size) / reach])
    sides = np.concatenate([differences, values.ravel() / reach]) - matrix[:, keep.ravel()] @ values[keep]
    best = values.copy()
    best[~keep] = np.linalg.lstsq(matrix[:, ~keep.ravel()], sides, rcond=None)[0]
    height = integrated_height(material(own), match, tileable, keep if kept else None, reach=reach)
    room = 0.1 * np.ptp(own)
    bounds = max(0, own.min() - room), min(1, own.max() + room)
    np.testing.assert_allclose(height, np.clip(best, *bounds), atol=1e-4)
    np.testing.assert_array_equal(height[keep], own[match[..., 0], match[..., 1]][keep])


def test_only_named_maps_are_integrated(rng: np.random.Generator) -> None:
    exemplar = material(rng.random((20, 20)), roughness=rng.random((20, 20)))
    match = rng.integers(0, 20, (12, 15, 2)).astype(np.uint32)
    plain = copied(exemplar, match)
    height = integrated(exemplar, plain, match)
    np.testing.assert_array_equal(height[..., [0, 2]], plain.pixels[..., [0, 2]])
    assert (height[..., 1] != plain.pixels[..., 1]).any()
    colored = integrated(exemplar, plain, match, maps=("albedo",))
    np.testing.assert_array_equal(colored[..., 1:], plain.pixels[..., 1:])
    other = integrated(exemplar, plain, match, maps=("roughness", "metallic"))
    np.testing.assert_array_equal(other[..., :2], plain.pixels[..., :2])
    assert (other[..., 2] != plain.pixels[..., 2]).any()


def test_normals_turn_gently_and_stay_unit(rng: np.random.Generator) -> None:
    angle = np.broadcast_to(np.linspace(-0.6, 0.6, 60), (40, 60)) + rng.normal(0, 0.02, (40, 60))
    parts = dict(zip(NORMAL, (np.sin(angle), np.zeros_like(angle), np.cos(angle)), strict=True))
    exemplar = material(np.zeros((40, 60)), **parts)
    match = np.concatenate([indices(40, 60)[:, :20], indices(40, 60)[:, 40:]], axis=1)
    plain = copied(exemplar, match)
    smooth = integrated(exemplar, plain, match, reach=8.0)
    np.testing.assert_array_equal(smooth[..., :2], plain.pixels[..., :2])
    np.testing.assert_allclose(np.linalg.norm(smooth[..., 2:], axis=2), 1, atol=rounding(8) + 1e-6)
    steps = [np.abs(np.diff(pixels[..., 2].mean(axis=0))) for pixels in (plain.pixels, smooth)]
    assert steps[0][19] > 0.35
    assert steps[1].max() < 0.12
    np.testing.assert_array_equal(integrated(exemplar, plain, match, maps=("height",)), plain.pixels)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("kept", [False, True])
def test_large_results_are_integrated_in_parts(
    tileable: bool, kept: bool, rng: np.random.Generator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exemplar = material(rng.random((30, 40)))
    match = np.kron(rng.integers(0, 30, (9, 11, 2)), np.ones((13, 13, 1))).astype(np.uint32)
    match += np.tile(indices(13, 13), (9, 11, 1)) // 3
    match = np.minimum(match, np.uint32(29))
    keep = rng.random(match.shape[:2]) < 0.2 if kept else None
    whole = integrated_height(exemplar, match, tileable, keep, reach=2.0)
    monkeypatch.setattr("texloom.stages.synthesis.edits.gradient_domain.LARGEST_WHOLE", 100)
    monkeypatch.setattr("texloom.stages.common.grids.parts._SIDE", 50)
    parts = integrated_height(exemplar, match, tileable, keep, reach=2.0)
    np.testing.assert_allclose(parts, whole, atol=2e-4 if kept else 1e-5)
    with using(Scratch(tmp_path, 0)):
        in_files = integrated_height(exemplar, match, tileable, keep, reach=2.0)
    np.testing.assert_array_equal(in_files, parts)


def test_masked_pixels_have_no_gradient(rng: np.random.Generator) -> None:
    height, usable = rng.random((24, 24)), np.ones((24, 24))
    usable[:, 10:12] = 0
    match = np.concatenate([indices(24, 24)[:, :10], indices(24, 24)[:, 12:]], axis=1)
    heights = []
    for poison in (0.5, -80.0):
        height[:, 10:12] = poison
        heights.append(integrated_height(material(height, **{USABLE: usable}), match))
    np.testing.assert_array_equal(*heights)


def test_masked_pixels_do_not_tell_what_is_a_rounding_error() -> None:
    height = np.linspace(0, 1, 101) * np.ones((50, 1))
    usable = np.ones((50, 101))
    usable[:, :10] = 0
    match = np.concatenate([indices(50, 101)[:, 20:50], indices(50, 101)[:, 51:80]], axis=1)
    heights = []
    for poison in (0.5, 1e5):
        height[:, :10] = poison
        heights.append(integrated_height(material(height, **{USABLE: usable}), match))
    np.testing.assert_array_equal(*heights)


def test_maps_that_cannot_be_integrated_are_refused(rng: np.random.Generator) -> None:
    exemplar, match = material(rng.random((8, 8))), indices(8, 8)
    for name in (NORMAL[0], "A"):
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            integrated_height(exemplar, match, maps=(name,))
    with pytest.raises(InputError, match="channel height"):
        gradient_domain(Image(exemplar.pixels[..., :1], ("Y",)), exemplar, match, GradientDomainParams())
    with pytest.raises(ValueError, match="of shape"):
        gradient_domain(exemplar, exemplar, match[1:], GradientDomainParams())
    with pytest.raises(ValueError, match="keep of shape"):
        integrated_height(exemplar, match, keep=np.ones((8, 9), bool))
    with pytest.raises(ValueError, match="beyond"):
        gradient_domain(exemplar, exemplar, match + np.uint32(1), GradientDomainParams())


def two_steps() -> tuple[Image, np.ndarray, np.ndarray]:
    """A ramp, three pieces of it with a step between each, and the first of them, which is kept."""
    exemplar = material(np.broadcast_to(np.linspace(0, 1, 201), (20, 201)))
    pieces = [indices(20, 201)[:, first : first + 30] for first in (20, 70, 110)]
    keep = np.zeros((20, 90), bool)
    keep[:, :30] = True
    return exemplar, np.concatenate(pieces, axis=1), keep


def test_steps_at_the_border_of_what_is_kept_can_be_corrected_alone() -> None:
    exemplar, match, keep = two_steps()
    before = copied(exemplar, match).pixels[..., 1]
    for border_only in (False, True):
        after = integrated_height(exemplar, match, keep=keep, reach=8, border_only=border_only)
        assert np.abs(np.diff(after)[:, 29]).max() < 0.3 * np.abs(np.diff(before)[:, 29]).min()
        inner = np.abs(np.diff(after)[:, 59]).min() / np.abs(np.diff(before)[:, 59]).max()
        assert inner > 0.9 if border_only else inner < 0.3


def test_large_steps_can_be_left_as_contours() -> None:
    """Of 0.1 and 0.05; the ramp's standard deviation is 0.29."""
    exemplar, match, keep = two_steps()
    before = copied(exemplar, match).pixels[..., 1]
    np.testing.assert_array_equal(integrated_height(exemplar, match, keep=keep, limit=0.1), before)
    after = integrated_height(exemplar, match, keep=keep, reach=8, limit=0.3)
    assert np.abs(np.diff(after)[:, 29]).min() > 0.9 * np.abs(np.diff(before)[:, 29]).min()
    assert np.abs(np.diff(after)[:, 59]).max() < 0.3 * np.abs(np.diff(before)[:, 59]).min()


def test_heights_of_floats_go_on_beyond_the_exemplar_and_what_is_cut_is_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ramp = np.broadcast_to(np.linspace(0.9, 1, 101), (50, 101))
    match = np.concatenate([indices(50, 101)[:, 61:], indices(50, 101)[:, 61:]], axis=1)
    exemplar = material(np.ascontiguousarray(ramp))
    assert integrated_height(exemplar, match, reach=1000.0).max() == 1
    assert "height: " in caplog.text
    assert "outside 0.89 .. 1, and are cut to it" in caplog.text
    caplog.clear()
    facts = Facts(maps={"height": MapFacts(range=(0.9, 1.0))})
    height = integrated_height(Image(exemplar.pixels, exemplar.channels, facts), match, reach=1000.0)
    assert height.max() == pytest.approx(1.01, abs=1e-3)
    assert caplog.text.count("outside 0.89 .. 1.01") == 1
