"""Distances to features through the distortion of a photograph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.photographs import surfaces, unit_square
from tests.synthetic import picture
from texloom.stages.analysis.photographs.feature_distance import (
    FeatureDistance,
    FeatureDistanceParams,
    feature_distance,
)
from texloom.stages.analysis.photographs.jacobian_field import JacobianField
from texloom.stages.analysis.structure.signed_distance import signed_distance
from texloom.stages.synthesis.per_pixel.per_pixel import flat
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import size_value

SHAPE = (160, 200)
CORNERS = [[15.0, 60.0], [20.0, 140.0], [150.0, 190.0], [145.0, 5.0]]
SIZE = np.array([130.0, 150.0])
GREY = picture(np.full(SHAPE, 0.5))


def dots(rng: np.random.Generator, shape: tuple[int, int] = SHAPE, share: float = 0.002) -> np.ndarray:
    return np.asarray(rng.random(shape) < share)


def measured(structure: np.ndarray, jacobian: np.ndarray, **params: object) -> FeatureDistance:
    chosen = FeatureDistanceParams.model_validate({"max_distance": 1.0, **params})
    return feature_distance(picture(0.5 * structure), jacobian, np.ones(structure.shape, bool), chosen, structure)


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> JacobianField:
    """A plane that is seen at a slant; its nearest edge shows 1 element a px or more."""
    patches = [{"corners": CORNERS, "size": size_value(SIZE)}]
    return surfaces(picture(np.full(SHAPE, 0.5)), tmp_path_factory.mktemp("plane"), detail=0.1, patches=patches)


def on_plane(plane: JacobianField) -> np.ndarray:
    """Where in the texture each pixel is, in elements."""
    return unit_square(CORNERS, *np.indices(SHAPE)) * SIZE * plane.scale


def test_in_a_flat_texture_it_is_the_plain_distance(rng: np.random.Generator) -> None:
    structure = np.repeat(np.repeat(dots(rng, (40, 50), 0.05), 4, axis=0), 4, axis=1)
    result = measured(structure, flat(SHAPE))
    wanted = signed_distance(structure)
    # what eight neighbours pass on is off by less than a tenth of a pixel [Danielsson1980]
    np.testing.assert_allclose(result.elements[..., 0], wanted.pixels, atol=0.1)
    np.testing.assert_allclose(result.planes[..., 0], wanted.field, atol=0.5)


def test_a_slanted_plane_is_measured_as_if_it_were_flat(plane: JacobianField, rng: np.random.Generator) -> None:
    from scipy.spatial import cKDTree

    structure = dots(rng) & plane.region
    places = on_plane(plane)
    result = measured(structure, plane.jacobian).elements[..., 0]
    wanted, _ = cKDTree(places[structure]).query(places)
    compared = plane.region & ~structure
    error = np.abs(result - wanted)[compared] / wanted[compared]
    assert np.quantile(error, 0.99) < 0.05
    assert error.mean() < 0.01


def test_along_the_directions_of_a_slanted_plane(plane: JacobianField) -> None:
    """Bars of a grid that is regular on the plane."""
    u, v = np.moveaxis(on_plane(plane), 2, 0)
    period = 40 * plane.scale
    across = (v % period) < 0.1 * period
    result = measured(across, plane.jacobian, directional=True).elements
    phase = v % period
    wanted = np.minimum(phase - 0.1 * period, period - phase)
    inside = plane.region & ~across & (v > period) & (v < 3 * period) & (u > 30) & (wanted > 4)
    assert np.count_nonzero(inside) > 1000
    error = np.abs(result[..., 1] - wanted)[inside]
    assert error.mean() < 0.05 * wanted[inside].mean()
    # no bar is met the other way
    assert np.median(result[..., 0][inside]) == pytest.approx(result[..., 0].max())


def test_classes_and_levels(rng: np.random.Generator) -> None:
    one, other = dots(rng), dots(rng)
    features = Image(np.dstack([one, other, np.zeros(SHAPE)]).astype(np.float32), ("R", "G", "B"))
    stack = rng.random((3, *SHAPE, 3)).astype(np.float32)
    region, params = np.ones(SHAPE, bool), FeatureDistanceParams(guidance=0.5, max_distance=1.0)
    result = feature_distance(GREY, flat(SHAPE), region, params, features=features, stack=stack)
    for number, structure in enumerate((one, other)):
        np.testing.assert_array_equal(
            result.elements[..., number], measured(structure, flat(SHAPE)).elements[..., 0]
        )
    assert not result.planes[..., 2].any()
    assert result.stack.shape == (3, *SHAPE, 6)
    np.testing.assert_array_equal(result.stack[..., :3], stack)
    np.testing.assert_array_equal(result.stack[2, ..., 3:], result.planes * np.float32(0.5))
    both = feature_distance(
        GREY, flat(SHAPE), region, FeatureDistanceParams(directional=True), features=features, stack=stack
    )
    assert both.stack.shape == (3, *SHAPE, 9)


@pytest.mark.parametrize("directional", [False, True])
def test_distances_end(rng: np.random.Generator, directional: bool) -> None:
    result = measured(dots(rng, share=0.0002), flat(SHAPE), max_distance=0.1, directional=directional)
    assert np.abs(result.elements).max() == pytest.approx(0.1 * np.sqrt(SHAPE[0] * SHAPE[1]))


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize("value", [False, True])
def test_without_features_nothing_guides(value: bool, directional: bool) -> None:
    result = measured(np.full(SHAPE, value), flat(SHAPE), directional=directional)
    assert not result.planes.any()
    assert result.stack.shape == (1, *SHAPE, 1 + directional)


@pytest.mark.parametrize("directional", [False, True])
def test_threads_do_not_matter(
    plane: JacobianField, rng: np.random.Generator, on_threads: Any, directional: bool
) -> None:
    structure = dots(rng)
    result = on_threads(lambda: measured(structure, plane.jacobian, directional=directional).elements)
    np.testing.assert_array_equal(*result)


def test_what_is_wrong_is_said_in_a_line() -> None:
    region, params = np.ones(SHAPE, bool), FeatureDistanceParams()
    with pytest.raises(InputError, match=r"^structure, features and classes: give exactly one"):
        feature_distance(GREY, flat(SHAPE), region, params)
    with pytest.raises(
        InputError, match=r"^features: 10 x 10 px; must have the size of the photograph, 200 x 160 px$"
    ):
        feature_distance(GREY, flat(SHAPE), region, params, features=picture(np.zeros((10, 10))))
    bad = picture(np.full(SHAPE, np.nan))
    with pytest.raises(InputError, match=r"^features: a value is not finite"):
        feature_distance(GREY, flat(SHAPE), region, params, features=bad)
