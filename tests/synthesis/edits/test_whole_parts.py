"""Parts are laid whole: once, or from border to border, and all else stays as it is."""

import numpy as np
import pytest

from texloom.stages.synthesis.edits.whole_parts import WholeParts, whole_parts
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SIDE, RESULT = 64, (96, 128)


def laid(kept: np.ndarray, color: tuple[float, float, float] = (0.7, 0.0, 0.0)) -> tuple[Image, Image, WholeParts]:
    """A texture of noise, and the same with a part of one colour in the exemplar."""
    random = np.random.default_rng(5)
    pixels = random.uniform(0.3, 0.4, (SIDE, SIDE, 3)).astype(np.float32)
    pixels[kept] = color
    exemplar = Image(pixels, ("R", "G", "B"))
    free = np.argwhere(~kept)
    match = free[random.integers(0, len(free), RESULT)].astype(np.uint32)
    image = Image(pixels[match[..., 0], match[..., 1]], ("R", "G", "B"))
    return exemplar, image, whole_parts(exemplar, image, match, kept)


def red(image: Image) -> np.ndarray:
    return np.asarray(image.pixels[..., 0] > 0.6)


def test_a_part_is_laid_once_where_it_was() -> None:
    kept = np.zeros((SIDE, SIDE), np.bool_)
    kept[20:32, 30:48] = True
    exemplar, image, made = laid(kept)
    assert red(made.image).sum() == kept.sum()
    rows, columns = np.nonzero(red(made.image))
    assert rows.mean() / RESULT[0] == pytest.approx(26 / SIDE, abs=0.25)
    assert columns.mean() / RESULT[1] == pytest.approx(39 / SIDE, abs=0.25)
    assert len(made.pieces) == 1
    np.testing.assert_array_equal(
        made.image.pixels, exemplar.pixels[made.match[..., 0].astype(int), made.match[..., 1].astype(int)]
    )
    outside = np.ones(RESULT, np.bool_)
    (piece,) = made.pieces
    outside[piece["row"] : piece["row"] + piece["height"], piece["column"] : piece["column"] + piece["width"]] = (
        False
    )
    np.testing.assert_array_equal(made.image.pixels[outside], image.pixels[outside])


@pytest.mark.parametrize("turned", [False, True])
def test_a_part_from_border_to_border_crosses_all_of_the_result(turned: bool) -> None:
    kept = np.zeros((SIDE, SIDE), np.bool_)
    rows, columns = np.indices(kept.shape)
    kept[np.abs(rows - 24 - columns // 8) < 3] = True  # it falls by 8 px
    kept = kept.T if turned else kept
    found = red(laid(kept)[2].image)
    found = found.T if turned else found
    crossed = found.sum(axis=0)
    assert (crossed >= 3).all()
    assert np.median(crossed) == 5
    middle = (found * np.arange(len(found))[:, None]).sum(axis=0) / crossed
    assert np.abs(np.diff(middle)).max() <= 3  # it is one line


def test_nothing_is_laid_without_parts() -> None:
    _, image, made = laid(np.zeros((SIDE, SIDE), np.bool_))
    assert made.image is image
    assert made.pieces == []


def test_a_mask_of_another_size_is_refused() -> None:
    exemplar, image, made = laid(np.zeros((SIDE, SIDE), np.bool_))
    with pytest.raises(InputError, match="kept is 8 x 9"):
        whole_parts(exemplar, image, made.match, np.ones((9, 8), np.bool_))
