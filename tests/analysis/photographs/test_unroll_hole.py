"""Surroundings of a hole laid flat, and the way back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.flows.test_from_photographs import PLANE, REGION, plane, stripes
from tests.photographs import surfaces, unit_square
from tests.synthetic import identity, picture
from texloom.stages.analysis.photographs.unroll_hole import UnrollHole, UnrollHoleParams, unroll_hole
from texloom.stages.synthesis.per_pixel.per_pixel import flat
from texloom.stages.synthesis.photographs.fold import fold
from texloom.stages.vocabulary.declare import InputError

HOLE = [[60, 50], [60, 80], [80, 84], [80, 44]]


def laid(folder: Path, **params: Any) -> tuple[UnrollHole, np.ndarray, np.ndarray]:
    """That of a hole in stripes in perspective, the region, and the hole."""
    photo = plane(stripes)
    surface = surfaces(photo, folder, patches=[{"corners": PLANE, "size": "1x2"}], region=[REGION], hole=[HOLE])
    made = unroll_hole(photo, surface.jacobian, surface.region, surface.hole, UnrollHoleParams(**params))
    return made, surface.region, surface.hole


def test_positions_are_those_of_the_plane(tmp_path: Path) -> None:
    made, region, hole = laid(tmp_path)
    np.testing.assert_array_equal(made.hole, hole[60:81, 44:85])
    assert made.corner.tolist() == [60, 44]
    usable = made.image.pixels[..., 3] > 0.5
    row, column = np.moveaxis(np.rint(made.positions[usable]).astype(int), 1, 0)
    assert region[row, column].all()
    assert not (usable & ~made.keep).any()
    # about one flat pixel per px of the hole
    assert np.count_nonzero(~made.keep) == pytest.approx(np.count_nonzero(hole), rel=0.3)
    # the flat image is affine in the plane
    back = unit_square(PLANE, *np.moveaxis(made.positions[usable], 1, 0))
    flat_places = np.column_stack([np.argwhere(usable), np.ones(usable.sum())])
    fitted = np.linalg.lstsq(flat_places, back, rcond=None)[0]
    assert np.abs(flat_places @ fitted - back).max() < 0.01


def test_a_texture_that_stays_is_folded_back(tmp_path: Path) -> None:
    """The identity in the flat image is the identity in the photograph."""
    made, _, _ = laid(tmp_path)
    back = fold(identity(made.keep.shape), made.chart, made.positions).positions
    own = np.stack(np.indices(made.hole.shape), axis=2) + made.corner
    assert np.abs(back - own)[made.hole].max() < 0.05


def test_small_parts_are_no_sources(tmp_path: Path) -> None:
    shares = [(laid(tmp_path, sharpness=share)[0].image.pixels[..., 3] > 0.5).mean() for share in (0.0, 0.8, 1.0)]
    assert shares[0] > shares[1] > shares[2] > 0


def test_a_large_hole_is_reduced(tmp_path: Path) -> None:
    assert max(laid(tmp_path, max_side=64)[0].keep.shape) <= 66


def test_what_is_missing_is_told() -> None:
    photo, nothing = picture(np.zeros((40, 50, 3))), np.zeros((40, 50), bool)
    with pytest.raises(InputError, match=r"^hole: empty"):
        unroll_hole(photo, flat((40, 50)), ~nothing, nothing, UnrollHoleParams())
    hole = nothing.copy()
    hole[10:20, 10:20] = True
    with pytest.raises(InputError, match=r"^region: no part of it is near the hole"):
        unroll_hole(photo, flat((40, 50)), nothing, hole, UnrollHoleParams())
