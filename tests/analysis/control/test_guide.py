from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from tests.guided import COLORS, bands, disc, labelled, painted
from tests.synthetic import masked, picture
from texloom.stages.analysis.control.guide import Guide, GuideParams, guide
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE, SIZE = (72, 80), (60, 90)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> Image:
    return labelled(bands(SHAPE), rng)


def read(exemplar: Image, own: Image, target: Image, **params: Any) -> Guide:
    return guide(exemplar, own, target, GuideParams(**params))


def compressed(labels: np.ndarray, quality: int) -> Image:
    """A label picture, antialiased and as JPEG."""
    large = Pillow.fromarray(COLORS[labels]).resize((labels.shape[1] * 3, labels.shape[0] * 3), 0)
    file = io.BytesIO()
    large.resize((labels.shape[1], labels.shape[0]), Pillow.Resampling.BICUBIC).save(file, "JPEG", quality=quality)
    return Image.of(np.asarray(Pillow.open(file)))


def nearest(planes: np.ndarray, made: Guide, labels: np.ndarray) -> np.ndarray:
    """The label of each pixel, by the mean point of each label in the exemplar."""
    points = np.stack([made.exemplar[labels == label].mean(axis=0) for label in range(3)])
    return ((planes[:, :, None] - points) ** 2).sum(axis=3).argmin(axis=2)


@pytest.mark.parametrize("quality", [95, 75, 50])
def test_labels_survive_compression(exemplar: Image, quality: int) -> None:
    made = read(exemplar, compressed(bands(SHAPE), quality), compressed(disc(SIZE), quality))
    assert (made.kind, made.labels) == ("labels", 3)
    assert (nearest(made.target, made, bands(SHAPE)) == disc(SIZE)).mean() > 0.97


def test_labels_are_equally_different(exemplar: Image) -> None:
    made = read(exemplar, painted(bands(SHAPE)), painted(disc(SIZE)))
    points = np.stack([made.exemplar[row, 0] for row in (0, 40, 71)])
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    np.testing.assert_allclose(distances, made.strength * (1 - np.eye(3)), atol=1e-3)
    assert made.exemplar.shape == (*SHAPE, 2)
    assert made.target.shape == (*SIZE, 2)


def test_a_line_between_two_labels_is_no_third_one(exemplar: Image) -> None:
    """Grey between black and white, where grey is a label too."""
    codes = np.repeat(np.array([0, 128, 255], np.uint8), 24)[:, None].repeat(80, axis=1)
    target = np.zeros(SIZE, np.uint8)
    target[:, 45:] = 255
    target[:, 44:46] = 128
    made = read(exemplar, Image.of(codes), Image.of(target))
    labels = np.arange(72)[:, None].repeat(80, axis=1) // 24
    assert set(np.unique(nearest(made.target, made, labels))) == {0, 2}


def test_values_keep_their_order(exemplar: Image) -> None:
    ramp = Image.of(np.linspace(20, 200, SHAPE[0]).astype(np.uint8)[:, None].repeat(SHAPE[1], axis=1))
    target = Image.of(np.linspace(0, 255, SIZE[1]).astype(np.uint8)[None].repeat(SIZE[0], axis=0))
    made = read(exemplar, ramp, target)
    assert (made.kind, made.labels) == ("values", 0)
    assert (np.diff(made.exemplar[:, 0, 0]) >= 0).all()
    assert np.ptp(made.exemplar) == pytest.approx(made.strength)
    # what lies beyond the exemplar's range is clipped to it
    assert made.target.min() == pytest.approx(made.exemplar.min(), abs=0.02 * made.strength)
    assert made.target.max() == pytest.approx(made.exemplar.max(), abs=0.02 * made.strength)
    assert np.interp(110 / 255 * 90, np.arange(90), made.target[0, :, 0]) == pytest.approx(
        made.strength / 2, rel=0.05
    )


def test_angles_meet_at_a_half_turn(exemplar: Image) -> None:
    angles = Image.of(np.linspace(0, 255, SHAPE[0]).astype(np.uint8)[:, None].repeat(SHAPE[1], axis=1))
    made = read(exemplar, angles, angles, kind="angles")
    np.testing.assert_allclose(made.exemplar[0], made.exemplar[-1], atol=0.05 * made.strength)
    across = np.linalg.norm(made.exemplar[0, 0] - made.exemplar[36, 0])
    assert across == pytest.approx(made.strength, rel=0.01)


def test_weight_is_a_factor(exemplar: Image) -> None:
    one, two = (read(exemplar, painted(bands(SHAPE)), painted(disc(SIZE)), weight=weight) for weight in (1, 2))
    np.testing.assert_allclose(2 * one.target, two.target, rtol=1e-6)


def test_excluded_pixels_do_not_count(exemplar: Image, rng: np.random.Generator) -> None:
    usable = np.ones(SHAPE, bool)
    usable[:30, :30] = False
    heights = rng.random(SHAPE).astype(np.float32)
    guides = [picture(np.where(usable, heights, value)) for value in (5.0, 0.5)]
    made = [read(masked(exemplar, usable, 0.7), own, guides[1]) for own in guides]
    np.testing.assert_array_equal(made[0].target, made[1].target)
    np.testing.assert_array_equal(made[0].exemplar[usable], made[1].exemplar[usable])


def test_a_guide_may_have_another_resolution(exemplar: Image) -> None:
    made = read(exemplar, painted(bands((144, 160))), painted(disc(SIZE)))
    assert made.exemplar.shape == (*SHAPE, 2)


@pytest.mark.parametrize(
    ("own", "target", "problem"),
    [
        (painted(bands((40, 80))), painted(disc(SIZE)), "exemplar_guide: 80 x 40 px has another aspect ratio"),
        (painted(np.zeros(SHAPE, int)), painted(disc(SIZE)), "exemplar_guide: every channel is constant"),
        (
            Image.of(bands(SHAPE).astype(np.uint8) * 100),
            painted(disc(SIZE)),
            "do not match those of exemplar_guide",
        ),
        (
            painted(bands(SHAPE)),
            Image.of(np.full((*SIZE, 3), 255, np.uint8)),
            "#ffffff is no label of exemplar_guide",
        ),
    ],
)
def test_guides_that_do_not_fit_are_refused(exemplar: Image, own: Image, target: Image, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        read(exemplar, own, target)
    check = find_stage("analysis.guide").check
    assert check is not None
    with pytest.raises(InputError, match=problem):
        check(GuideParams(), {"image": exemplar, "exemplar_guide": own, "target_guide": target})


def test_labels_are_refused_where_there_are_none(exemplar: Image, rng: np.random.Generator) -> None:
    noise = picture(rng.random(SHAPE))
    with pytest.raises(InputError, match="not a picture of a few flat colours"):
        read(exemplar, noise, noise, kind="labels")


def test_a_transparent_target_asks_for_nothing(exemplar: Image) -> None:
    target = painted(disc(SIZE))
    alpha = np.ones((*SIZE, 1), np.float32)
    alpha[:, 50:] = 0
    made = read(exemplar, painted(bands(SHAPE)), Image(np.dstack([target.pixels, alpha]), ("R", "G", "B", "A")))
    assert np.isnan(made.target[:, 50:]).all()
    assert np.isfinite(made.target[:, :50]).all()
