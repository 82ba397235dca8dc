"""Several exemplars in one picture, and a texture of all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import masked, picture
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.remix.exemplar_origin import ExemplarOrigin, ExemplarOriginParams, exemplar_origin
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet, ExemplarSheetParams, exemplar_sheet
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import valid_pixels

SIZES = [(48, 64), (64, 40)]


def noise(rng: np.random.Generator, size: tuple[int, int], colour: tuple[float, ...], spread: float = 0.1) -> Image:
    return picture((np.array(colour) + spread * rng.random((*size, 1)) - spread / 2).astype(np.float32))


@pytest.fixture
def two(rng: np.random.Generator) -> list[Image | None]:
    """A red and a blue exemplar."""
    return [
        noise(rng, size, colour) for size, colour in zip(SIZES, ((0.6, 0.1, 0.1), (0.1, 0.1, 0.6)), strict=True)
    ]


def sheet(exemplars: list[Image | None], **params: Any) -> ExemplarSheet:
    items = [{"name": name} for name in "abcdef"[: len(exemplars)]]
    return exemplar_sheet(exemplars, items, ExemplarSheetParams(**params))


def test_every_exemplar_lies_where_it_says_and_gaps_are_excluded(two: list[Image | None]) -> None:
    made = sheet([two[0], None, two[1]])
    assert made.names == ["a", "c"]
    assert made.share is None
    left = np.ones((made.image.height, made.image.width), bool)
    for exemplar, (row, column, height, width) in zip((two[0], two[1]), made.rectangles.tolist(), strict=True):
        place = np.s_[row : row + height, column : column + width]
        assert exemplar is not None
        np.testing.assert_array_equal(made.image.pixels[place][..., :3], exemplar.pixels)
        left[place] = False
    usable = valid_pixels(made.image)
    np.testing.assert_array_equal(usable, ~left)


def test_lattices_that_are_dropped_are_told(two: list[Image | None], caplog: pytest.LogCaptureFixture) -> None:
    items = [{"name": name} for name in "abc"]
    lattice, none = np.float32([[0, 20], [20, 0]]), np.zeros((0, 2), np.float32)
    exemplar_sheet([two[0], None, two[1]], items, ExemplarSheetParams(), [none, None, none])
    assert not caplog.records
    exemplar_sheet([two[0], None, two[1]], items, ExemplarSheetParams(), [none, None, lattice])
    assert "c: lattice or courses dropped" in caplog.text


def test_pixels_that_an_exemplar_excludes_stay_excluded(two: list[Image | None]) -> None:
    assert two[0] is not None
    usable = np.ones(SIZES[0], bool)
    usable[:9, :9] = False
    made = sheet([masked(two[0], usable, 0.0), two[1]])
    valid = valid_pixels(made.image)
    assert valid is not None
    row, column = made.rectangles[0, :2]
    np.testing.assert_array_equal(valid[row : row + 48, column : column + 64], usable)
    assert made.image.channels == ("R", "G", "B", "usable")


def test_excluded_pixels_count_neither_for_weights_nor_for_tone(two: list[Image | None]) -> None:
    """Half of the first exemplar is excluded, and white there."""
    assert two[0] is not None
    usable = np.ones(SIZES[0], bool)
    usable[:24] = False
    half = masked(two[0], usable, 1.0)
    made = sheet([half, two[1]], weights={"a": 1.0})
    assert made.share is not None
    row, column = made.rectangles[0, :2]
    assert made.share[row, column] == pytest.approx(0.5 * (24 * 64 + 64 * 40) / (24 * 64))
    matched = sheet([half, two[1]], match_tone=1.0).image.color
    bare = picture(np.tile(two[0].pixels[24:], (2, 1, 1)))
    expected = sheet([bare, two[1]], match_tone=1.0).image.color[:24, :64]
    np.testing.assert_allclose(matched[row + 24 : row + 48, column : column + 64], expected, atol=1e-4)


def test_grey_exemplars_become_coloured_and_it_is_said(
    two: list[Image | None], rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    made = sheet([two[0], picture(rng.random((40, 40)).astype(np.float32))])
    assert made.image.channels == ("R", "G", "B", "usable")
    assert caplog.messages == ["b: grey, taken as three equal channels, as others are in colour"]


def test_weights_are_shares_relative_to_even_use(two: list[Image | None]) -> None:
    made = sheet(two, weights={"a": 3})
    assert made.share is not None
    areas = [height * width for height, width in SIZES]
    shares = [float(made.share[row, column]) for row, column in made.rectangles[:, :2]]
    np.testing.assert_allclose([share * area for share, area in zip(shares, areas, strict=True)],
                               [0.75 * sum(areas), 0.25 * sum(areas)], rtol=1e-5)  # fmt: skip


def test_matched_tones_are_equal_and_half_as_far_at_half_strength(
    two: list[Image | None], rng: np.random.Generator
) -> None:
    others = [two[0], noise(rng, (40, 40), (0.3, 0.4, 0.3), 0.3)]

    def means(**params: Any) -> np.ndarray:
        made = sheet(others, **params)
        places = [np.s_[r : r + h, c : c + w] for r, c, h, w in made.rectangles.tolist()]
        return np.array([lab_from_linear(made.image.color[place]).mean(axis=(0, 1)) for place in places])

    before, half, after = (means(match_tone=strength) for strength in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(after[0], after[1], atol=1.5)  # colours that do not exist are clipped
    np.testing.assert_allclose(half[0] - half[1], (before[0] - before[1]) / 2, atol=1.5)


def test_wrong_weights(two: list[Image | None]) -> None:
    with pytest.raises(InputError, match="weights: c is no exemplar; they are a, b"):
        sheet(two, weights={"c": 1.0})
    with pytest.raises(ValueError, match="greater than 0"):
        sheet(two, weights={"a": 0.0})


def test_wrong_exemplars(two: list[Image | None], rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="there is none"):
        sheet([None])
    with pytest.raises(InputError, match="too small"):
        sheet([two[0], noise(rng, (20, 90), (0.5, 0.5, 0.5))])


def test_maps_that_not_all_have_are_left_out_and_told(
    two: list[Image | None], caplog: pytest.LogCaptureFixture
) -> None:
    assert two[0] is not None
    assert two[1] is not None
    names = ("R", "G", "B", "height", "ao")
    both = Image(np.concatenate([two[0].pixels, two[0].pixels[..., :2]], axis=2), names)
    one = Image(np.concatenate([two[1].pixels, two[1].pixels[..., :1]], axis=2), names[:4])
    assert sheet([both, one]).image.channels == ("R", "G", "B", "height", "usable")
    assert caplog.messages == ["a: ao left out, which not all exemplars have"]


def test_exemplars_of_other_sizes_are_told(
    two: list[Image | None], rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    sheet([two[0], noise(rng, (200, 200), (0.5, 0.5, 0.5))])
    assert "b has 4 times the side of a" in caplog.text


def remixed(made: ExemplarSheet, **params: Any) -> ExemplarOrigin:
    start = initialise(
        made.image, InitialiseParams(size=(96, 96)), np.random.default_rng(1),
        share=made.share, rectangles=made.rectangles,
    )  # fmt: skip
    texture = optimise(
        made.image, start.match, OptimiseParams(preset="fast", patch_size=6, **params), np.random.default_rng(2),
        share=made.share, rectangles=made.rectangles,
    )  # fmt: skip
    assert texture.image.channels == ("R", "G", "B")
    found = exemplar_origin(texture.match, made.rectangles, made.names, made.wanted, ExemplarOriginParams())
    number = found.origin[..., 0].astype(int)
    at = made.rectangles[number, :2] + found.origin[..., 1:]
    np.testing.assert_array_equal(at, texture.match)
    assert (found.origin[..., 1:] < made.rectangles[number, 2:]).all()
    return found


@pytest.mark.parametrize("weights", [{}, {"a": 4.0}])
def test_a_texture_is_of_all_as_weights_ask(two: list[Image | None], weights: dict[str, float]) -> None:
    found = remixed(sheet(two, weights=weights))
    number = found.origin[..., 0]
    share = number.mean()
    wanted = 64 * 40 / (64 * 40 + 48 * 64) if not weights else 0.2
    assert found.table["exemplars"][1] == {
        "name": "b", "share": pytest.approx(share, abs=1e-4), "wanted": pytest.approx(wanted, abs=1e-4)
    }  # fmt: skip
    assert share == pytest.approx(wanted, abs=0.05)
    for exemplar in (0, 1):
        colours = found.picture.pixels[number == exemplar]
        assert (colours == colours[0]).all()


@pytest.mark.parametrize("tileable", [False, True])
def test_the_smoother_exemplar_does_not_take_over(rng: np.random.Generator, tileable: bool) -> None:
    rough, smooth = noise(rng, (64, 64), (0.5, 0.5, 0.5), 0.9), noise(rng, (64, 64), (0.4, 0.4, 0.4), 0.01)
    found = remixed(sheet([rough, smooth], weights={"a": 3.0}), tileable=tileable)
    assert found.table["exemplars"][0]["share"] == pytest.approx(0.75, abs=0.06)


def test_hundreds_of_exemplars_are_told_apart(rng: np.random.Generator) -> None:
    exemplars: list[Image | None] = [noise(rng, (32, 32), (0.5, 0.5, 0.5)) for _ in range(260)]
    made = exemplar_sheet(exemplars, [{"name": str(n)} for n in range(260)], ExemplarSheetParams())
    params = InitialiseParams(size=(32, 32))
    start = initialise(made.image, params, np.random.default_rng(1), rectangles=made.rectangles)
    found = exemplar_origin(start.match, made.rectangles, made.names, made.wanted, ExemplarOriginParams())
    assert found.origin[..., 0].max() > 0


def test_shares_far_from_those_wanted_are_told(two: list[Image | None], caplog: pytest.LogCaptureFixture) -> None:
    made = sheet(two, weights={"b": 3.0})
    match = np.zeros((8, 8, 2), np.uint32)
    exemplar_origin(match, made.rectangles, made.names, made.wanted, ExemplarOriginParams())
    assert caplog.messages == [
        "a: 100 % of the texture, where 25 % were wanted", "b: 0 % of the texture, where 75 % were wanted",
    ]  # fmt: skip


def test_tones_that_get_clipped_are_told(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    dark, checks = noise(rng, (40, 40), (0.05,) * 3, 0.1), (rng.random((40, 40, 1)) > 0.5).repeat(3, axis=2)
    sheet([dark, picture(checks.astype(np.float32))], match_tone=1.0)
    assert "a: match_tone clips" in caplog.text
