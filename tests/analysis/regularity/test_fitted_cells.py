"""A surface is scaled so that whole cells of its lattice fit a tileable result."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from texloom.stages.analysis.regularity.fitted_cells import FittedCells, FittedCellsParams, fitted_cells
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels, with_usable

SHAPE = (90, 120)


def fitted(generators: list[list[float]], tileable: str = "both", **params: object) -> FittedCells:
    y, x = np.indices(SHAPE)
    image = Image(np.stack([y / 90, x / 120, 0 * x], axis=2).astype(np.float32), ("R", "G", "B"))
    chosen = FittedCellsParams.model_validate({"result": 64, "tileable": tileable, **params})
    return fitted_cells(image, np.array(generators, np.float32), chosen)


@pytest.mark.parametrize(
    "generators",
    [
        [[10.0, 0.0], [0.0, 13.0]],
        [[11.0, 0.0], [0.0, 11.7]],
        [[9.3, 7.1], [9.3, -7.1]],  # a bond: rows half a brick apart
        [[8.6, 0.0]],  # courses
    ],
)
def test_whole_cells_fit_and_keep_their_shape(
    generators: list[list[float]], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        made = fitted(generators)
    assert "so that whole cells fit 64 x 64 px (--set STEP.fit=false" in caplog.text
    own = made.generators.astype(np.float64)
    steps = np.linalg.inv(own) if len(own) == 2 else own.T / (own**2).sum()
    cells = steps * 64
    assert np.abs(cells - np.rint(cells)).max() < 0.08
    down, across = made.table["scale"]
    assert 1 / 1.2 <= min(down, across) <= max(down, across) <= 1.2
    assert abs(np.log(down / across)) < 0.1 or len(own) == 1
    assert (made.image.height, made.image.width) == (round(down * SHAPE[0]), round(across * SHAPE[1]))
    # a ramp stays a ramp
    np.testing.assert_allclose(made.image.color[-3, :, 0], made.image.color[-3, 0, 0], atol=1e-6)
    assert made.image.color[-1, 0, 0] == pytest.approx(89 / 90, abs=0.01)


@pytest.mark.parametrize(
    ("generators", "options"),
    [
        ([[10.0, 0.0], [0.0, 13.0]], {"fit": False}),
        ([[10.0, 0.0], [0.0, 13.0]], {"tileable": "off"}),
        ([[16.0, 0.0], [0.0, 12.8]], {}),  # four and five
        ([[16.0, 0.0], [0.0, 12.64]], {}),  # 1.3 % off, which hides
        ([[100.0, 0.0], [0.0, 100.0]], {}),  # larger than the result
    ],
)
def test_a_surface_is_left_where_nothing_is_to_fit(
    generators: list[list[float]], options: dict[str, object]
) -> None:
    made = fitted(generators, **options)
    assert made.table == {"why": "", "scale": [1.0, 1.0]}
    assert made.image.pixels.shape[:2] == SHAPE
    np.testing.assert_array_equal(made.generators, np.float32(generators))


def test_one_side_alone_is_fitted_where_one_is_tileable() -> None:
    down, across = fitted([[10.0, 0.0], [0.0, 12.0]], "x").table["scale"]
    assert down == 1
    assert across == pytest.approx(64 / 5 / 12, abs=0.01)


def test_excluded_pixels_stay_excluded() -> None:
    y, x = np.indices(SHAPE)
    usable = np.hypot(y - 40, x - 50) > 15
    image = with_usable(Image(np.repeat(usable[..., None], 3, axis=2).astype(np.float32), ("R", "G", "B")), usable)
    params = FittedCellsParams.model_validate({"result": 64, "tileable": "both"})
    made = fitted_cells(image, np.array([[10, 0], [0, 13]], np.float32), params)
    valid = valid_pixels(made.image)
    assert valid is not None
    assert 0.85 < valid.mean() < usable.mean()
    assert (made.image.color[valid] == 1).all()
