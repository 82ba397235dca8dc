from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.synthetic import blobs, picture
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.edits.collage import Collage, CollageParams, collage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Document, InputError
from texloom.stages.vocabulary.normals import NORMAL

SHAPE = (60, 80)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return picture(blobs((*SHAPE, 3), rng))


def params(pieces: Any, **more: Any) -> CollageParams:
    document = Document.of(Path("pieces.yaml"), {"pieces": pieces} if isinstance(pieces, list) else pieces)
    return CollageParams(**{"pieces": document, "size": (64, 64), **more})


def run(exemplar: Image, *pieces: dict[str, Any], **more: Any) -> Collage:
    return collage(exemplar, params(list(pieces), **more))


def test_a_piece_that_is_only_placed_is_copied(exemplar: Image) -> None:
    made = run(exemplar, {"box": [10, 20, 21, 31], "at": [30, 35]})
    np.testing.assert_allclose(made.image.pixels[20:41, 20:51, :3], exemplar.pixels[10:31, 20:51], atol=1e-6)
    laid = np.zeros((64, 64), bool)
    laid[20:41, 20:51] = True
    np.testing.assert_array_equal(made.image.pixels[..., 3] == 1, laid)
    np.testing.assert_array_equal(made.pieces == 0, laid)


def test_a_quarter_turn_is_counter_clockwise(exemplar: Image) -> None:
    made = run(exemplar, {"box": [10, 20, 21, 21], "at": [30, 30], "angle": 90})
    expected = np.rot90(exemplar.pixels[10:31, 20:41])
    np.testing.assert_allclose(made.image.pixels[21:40, 21:40, :3], expected[1:-1, 1:-1], atol=1e-5)


def test_scale_is_that_of_the_result(exemplar: Image) -> None:
    made = run(exemplar, {"box": [10, 20, 11, 11], "at": [30, 30], "scale": 2})
    assert int((made.pieces == 0).sum()) == pytest.approx(22 * 22, abs=50)
    np.testing.assert_allclose(made.image.pixels[30, 30, :3], exemplar.pixels[15, 25], atol=1e-5)


def test_later_pieces_lie_over_earlier_ones_and_polygons_have_their_shape(exemplar: Image) -> None:
    triangle = {"polygon": [[0, 0], [0, 40], [40, 0]], "at": [30, 30]}
    made = run(exemplar, {"box": [0, 0, 50, 50], "at": [30, 30]}, triangle)
    assert (made.pieces == 1).sum() == pytest.approx(800, rel=0.05)
    assert made.pieces[15, 15] == 1
    assert made.pieces[48, 48] == 0


def test_pieces_continue_at_the_opposite_border(exemplar: Image) -> None:
    piece = {"box": [10, 20, 20, 20], "at": [0, 0]}
    assert (run(exemplar, piece, tileable=True).pieces == 0).sum() == 400
    assert (run(exemplar, piece).pieces == 0).sum() == 100
    for along in ("x", "y"):
        assert (run(exemplar, piece, tileable=along).pieces == 0).sum() == 200


def test_normals_turn_with_their_piece() -> None:
    """Which rise to the right, and after a quarter turn upwards."""
    pixels = np.zeros((*SHAPE, 6), np.float32)
    pixels[..., 3:] = [-0.6, 0, 0.8]
    made = run(Image(pixels, ("R", "G", "B", *NORMAL)), {"box": [10, 20, 21, 21], "at": [30, 30], "angle": 90})
    np.testing.assert_allclose(made.image.pixels[30, 30, 3:6], [0, -0.6, 0.8], atol=1e-6)


@pytest.mark.parametrize(
    ("pieces", "problem"),
    [
        ([], "pieces"),
        ([{"at": [3, 4]}], "want either box or polygon"),
        ([{"box": [0, 0, 9, 9]}], "pieces.0.at: Field required"),
        ([{"box": [0, 0, 9, 9], "at": [3, 4], "turn": 3}], "pieces.0.turn"),
        ([{"box": [0, 90, 9, 9], "at": [3, 4]}], "pieces.0: lies outside the exemplar of 80 x 60 px"),
        ("text", "pieces.yaml"),
    ],
)
def test_files_that_are_wrong_are_refused(exemplar: Image, pieces: Any, problem: str) -> None:
    check = find_stage("synthesis.collage").check
    assert check is not None
    with pytest.raises(InputError, match=problem):
        check(params(pieces), {"image": exemplar})


def test_a_piece_much_larger_than_a_tileable_result_is_refused(exemplar: Image) -> None:
    """It took 14 TiB."""
    check = find_stage("synthesis.collage").check
    assert check is not None
    piece = {"box": [0, 0, 1e5, 1e5], "at": [0, 0], "scale": 10}
    check(params([piece]), {"image": exemplar})
    with pytest.raises(InputError, match=r"pieces.0: covers \d+ px of a tileable result, at most 67108864"):
        check(params([piece], tileable=True), {"image": exemplar})


def test_a_missing_file_is_named(exemplar: Image) -> None:
    with pytest.raises(InputError, match="give the file that lists them"):
        collage(exemplar, CollageParams())
