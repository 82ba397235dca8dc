"""The coarse level of a result."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.synthesis.control_maps.coarse_level import CoarseLevelParams, coarse_level
from texloom.stages.synthesis.reconstruction.coarse_target import (
    CoarseTarget,
    CoarseTargetParams,
    check_target,
    coarse_target,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError


def pair(rows: int = 96, columns: int = 144) -> tuple[Image, Image]:
    """Sea to the right of land, whose colour changes from north to south where its control does not."""
    land = np.arange(columns)[None, :] < columns / 2 + 8 * np.sin(np.arange(rows)[:, None] / 9)
    north = (np.arange(rows) < rows / 2)[:, None, None]
    colours = np.where(land[..., None], np.where(north, [0.5, 0.4, 0.2], [0.1, 0.4, 0.1]), [0.02, 0.05, 0.4])
    return picture(colours), Image(land.astype(np.float32)[..., None], ("height",))


def made(texture: Image, control: Image, target: Image, **params: object) -> CoarseTarget:
    level = coarse_level(texture, CoarseLevelParams(), control)
    options, rng = CoarseTargetParams.model_validate(params), np.random.default_rng(3)
    return coarse_target(texture, options, rng, level.image, level.guide, control, target)


def mirrored(image: Image) -> Image:
    return Image(np.ascontiguousarray(image.pixels[:, ::-1]), image.channels)


def test_under_the_own_control_map_it_is_that_of_the_texture() -> None:
    texture, control = pair()
    smaller = Image(np.ascontiguousarray(control.pixels[::2, ::2]), control.channels)
    own = coarse_level(texture, CoarseLevelParams(), control)
    for target in (control, smaller):
        found = made(texture, control, target)
        assert found.image is not None
        assert found.guide is not None
        assert (found.image.pixels == own.image.pixels).all()
        assert (found.guide == own.guide).all()


@pytest.mark.parametrize("size", [None, (92, 138)])
def test_land_keeps_its_parts_under_a_mirrored_map(size: tuple[int, int] | None) -> None:
    """The result is of two kinds of land, each in one piece, and of sea, with sharp borders."""
    texture, control = pair()
    found = made(texture, control, mirrored(control), size=size)
    assert found.guide is not None
    assert found.guide.shape[:2] == (size or (96, 144))
    kinds = lab_from_linear(np.array([[[0.5, 0.4, 0.2], [0.1, 0.4, 0.1], [0.02, 0.05, 0.4]]], np.float32))[0]
    near = np.linalg.norm(found.guide[:, :, None] - kinds, axis=3)
    assert (near.min(axis=2) < 15).mean() > 0.95
    kind = near.argmin(axis=2)
    land = np.arange(kind.shape[1])[None, :] > kind.shape[1] * 0.6
    assert (kind < 2)[:, land[0]].mean() > 0.95
    assert (kind == 2)[:, : int(kind.shape[1] * 0.4)].mean() > 0.95
    shares = [(kind[:, land[0]] == number).mean() for number in (0, 1)]
    assert min(shares) > 0.15
    changes = (np.diff((kind[:, land[0]] == 0).astype(int), axis=0) != 0).sum(axis=0)
    assert np.median(changes) <= 2


def test_a_result_of_few_pixels_has_none() -> None:
    texture, control = pair(12, 18)
    found = made(texture, control, mirrored(control))
    assert found.image is None
    assert found.guide is None


def test_a_target_of_other_channels_is_refused() -> None:
    other = pair()[1]
    control = Image(np.linspace(0, 1, 96 * 144 * 2, dtype=np.float32).reshape(96, 144, 2), ("age", "dirt"))
    with pytest.raises(InputError, match="target"):
        check_target(CoarseTargetParams(), {"control": control, "target": other})
