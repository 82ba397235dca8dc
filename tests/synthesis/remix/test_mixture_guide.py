"""A map between several exemplars as a guide, and a texture that follows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.common.features.control import painted_values
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.remix.exemplar_origin import ExemplarOriginParams, exemplar_origin
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet, ExemplarSheetParams, exemplar_sheet
from texloom.stages.synthesis.remix.mixture_guide import MixtureGuide, MixtureGuideParams, mixture_guide
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def sheet(rng: np.random.Generator, count: int) -> ExemplarSheet:
    """Noise of a colour each."""
    colours = np.eye(3)[:count, None, None] * 0.5 + 0.05
    images: list[Image | None] = [
        picture((colour * (0.5 + rng.random((48, 48, 1)))).astype(np.float32)) for colour in colours
    ]
    return exemplar_sheet(images, [{"name": name} for name in "abc"[:count]], ExemplarSheetParams())


def mixture(made: ExemplarSheet, levels: np.ndarray | None = None, **params: Any) -> MixtureGuide:
    given = None if levels is None else Image(levels.astype(np.float32), ("Y",))
    return mixture_guide(
        made.image, made.rectangles, made.names, MixtureGuideParams(**params), np.random.default_rng(1), map=given
    )


def numbers(made: ExemplarSheet, found: MixtureGuide) -> np.ndarray:
    """The exemplar that is asked for, fractions between two."""
    row, column = made.rectangles[1, :2]
    return np.asarray(found.target[..., 0] / found.exemplar[row, column, 0])


def test_without_patches_the_border_is_where_the_map_is_halfway(rng: np.random.Generator) -> None:
    made = sheet(rng, 2)
    asked = numbers(made, mixture(made, size=(64, 96), patchiness=0))
    assert (asked == asked[0]).all()
    assert (np.diff(asked[0]) >= 0).all()
    assert (np.rint(asked[0]) == (np.arange(96) >= 48)).all()
    turned = numbers(made, mixture(made, size=(96, 64), patchiness=0, angle=90))
    np.testing.assert_allclose(turned, asked.T, atol=1e-6)
    back = numbers(made, mixture(made, size=(96, 64), patchiness=0, angle=-90))
    np.testing.assert_allclose(back, asked.T[::-1], atol=1e-6)


def test_the_way_is_the_map_and_begins_and_ends_gently_without_one(rng: np.random.Generator) -> None:
    made = sheet(rng, 3)
    way = mixture(made, size=(16, 400)).way[0]
    assert (way[0], way[-1]) == (0, 2)
    assert way[200] == pytest.approx(1, abs=0.02)
    steps = np.diff(way)
    assert (steps >= 0).all()
    assert np.abs(np.diff(steps)).max() < 0.2 * steps.max()
    levels = (np.linspace(0, 1, 400)[None] * np.ones((16, 1)))[..., None]
    painted = painted_values(Image(levels.astype(np.float32), ("Y",)))[..., 0]
    np.testing.assert_allclose(mixture(made, levels, size=None).way, 2 * painted, atol=1e-5)


@pytest.mark.parametrize(("tileable", "tiles"), [("x", True), ("y", False)])
def test_a_gradient_goes_there_and_back_where_it_is_to_tile(
    rng: np.random.Generator, tileable: str, tiles: bool
) -> None:
    made = sheet(rng, 2)
    asked = numbers(made, mixture(made, size=(64, 96), tileable=tileable, patchiness=0))
    assert (asked[:, 0] == asked[:, -1]).all() == tiles


def test_patches_of_either_lie_in_between_as_often_as_the_map_says(rng: np.random.Generator) -> None:
    made = sheet(rng, 2)
    level = 0.3
    found = mixture(made, ((level / 1.055 + 0.052) ** 2.4) * np.ones((8, 8, 1)), size=(512, 512), patchiness=1,
                    patch=16)  # fmt: skip
    share = (np.rint(numbers(made, found)) == 1).mean()
    assert share == pytest.approx(level, abs=0.03)
    assert found.wanted == pytest.approx([1 - share, share])


def test_a_map_leads_through_all_exemplars_and_has_the_size_of_the_result(rng: np.random.Generator) -> None:
    made = sheet(rng, 3)
    levels = np.repeat(np.repeat([[0.0], [0.214], [1.0]], 20, axis=0), 30, axis=1)[..., None]  # painted 0, 1/2, 1
    found = mixture(made, levels, size=None, patchiness=0)
    asked = np.rint(numbers(made, found))
    assert asked.shape == (60, 30)
    np.testing.assert_array_equal(asked[[10, 30, 50]], np.repeat([[0], [1], [2]], 30, axis=1))
    assert found.wanted == pytest.approx([1 / 3] * 3, abs=0.02)


def test_a_texture_follows(rng: np.random.Generator) -> None:
    made = sheet(rng, 2)
    found = mixture(made, size=(64, 96), patchiness=0)
    guides = {"exemplar_guide": found.exemplar, "target_guide": found.target}
    start = initialise(
        made.image, InitialiseParams(size=None), np.random.default_rng(1), rectangles=made.rectangles, **guides
    )
    texture = optimise(
        made.image, start.match, OptimiseParams(preset="fast", patch_size=6), np.random.default_rng(2),
        rectangles=made.rectangles, **guides,
    )  # fmt: skip
    origin = exemplar_origin(texture.match, made.rectangles, made.names, found.wanted, ExemplarOriginParams())
    number = origin.origin[..., 0]
    assert (number[:, :40] == 0).mean() > 0.97
    assert (number[:, 56:] == 1).mean() > 0.97


def test_what_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="a mixture needs two or more, got 1"):
        mixture(sheet(rng, 1))
    with pytest.raises(InputError, match="size: give the size"):
        mixture(sheet(rng, 2), size=None)
