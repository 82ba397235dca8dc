from __future__ import annotations

import functools
import hashlib
import re
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

from benchmarks.training.boundaries import distance_to
from benchmarks.training.judge import reduced
from benchmarks.training.model_file import opencv_text
from benchmarks.training.pictures import picture_of
from tests.synthetic import picture
from texloom.stages.analysis.structure.edges import (
    MODEL,
    MODEL_DIGEST,
    EdgesParams,
    check_model,
    edges,
    magnifications,
)
from texloom.stages.analysis.structure.forest_files import load_forest, read_opencv_forest
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear
from texloom.stages.vocabulary.declare import InputError

GRADIENT = EdgesParams(detector="gradient")


def step_at(column: int, low: tuple[float, ...], high: tuple[float, ...], size: int = 64) -> Image:
    """``low`` left of the border between ``column - 1`` and ``column``, ``high`` right of it."""
    right = np.arange(size)[:, None] >= column
    return picture(np.tile(np.where(right, high, low), (size, 1, 1)))


@pytest.mark.parametrize("detector", ["gradient", "structured"])
@pytest.mark.parametrize("level", [0.0, 0.18, 1.0, 50.0])
def test_constant_picture_has_no_contours(level: float, detector: Literal["gradient", "structured"]) -> None:
    strength = edges(picture(np.full((33, 47, 3), level)), EdgesParams(detector=detector)).strength
    assert strength.shape == (33, 47)
    assert not strength.any()


@pytest.mark.parametrize("finest", [0.7, 1.5, 4.0])
@pytest.mark.parametrize(
    ("low", "high"),
    [((0.05,) * 3, (0.6,) * 3), ((0.6,) * 3, (0.05,) * 3), ((0.4, 0.1, 0.1), (0.1, 0.22, 0.1))],
    ids=["up", "down", "hue"],
)
def test_step_is_strongest_on_its_two_columns(
    low: tuple[float, ...], high: tuple[float, ...], finest: float
) -> None:
    image = step_at(20, low, high)
    params = EdgesParams(detector="gradient", finest=finest)
    transposed = picture(image.pixels.transpose(1, 0, 2))
    for lines in (edges(image, params).strength, edges(transposed, params).strength.T):
        assert np.ptp(lines, axis=0).max() < 1e-4  # the same in every row
        np.testing.assert_allclose(lines[:, 19:21], 1, atol=1e-3)
        profile = lines[30]
        assert (np.diff(profile[:20]) >= -1e-6).all()
        assert (np.diff(profile[20:]) <= 1e-6).all()
        assert profile[:2].max() < 0.2
        assert profile[-2:].max() < 1e-3


def test_strength_follows_contrast() -> None:
    """Two steps of lightness, one half as high as the other."""
    from texloom.stages.vocabulary.color import lab_from_linear

    grey = np.array([0.02, 0.1, 0.55], np.float32)
    image = np.repeat(grey, 24)[None, :, None] * np.ones((72, 1, 3), np.float32)
    strength = edges(picture(image), EdgesParams(detector="gradient", finest=1.0)).strength[36]
    lightness = lab_from_linear(image)[36, [0, 30, 60], 0].astype(np.float64)
    expected = np.diff(lightness)
    measured = strength[23:25].max(), strength[47:49].max()
    assert measured[0] / measured[1] == pytest.approx(expected[0] / expected[1], rel=0.05)


def grey(lightness: np.ndarray) -> Image:
    """A grey picture of the given CIELAB lightness, above 8."""
    light = ((lightness + 16) / 116) ** 3
    return picture(np.repeat(light[..., None], 3, axis=2))


def test_all_directions_count_alike() -> None:
    """A bright disc is as strong along its whole rim."""
    rows, columns = np.indices((101, 101)) - 50.0
    radius = np.hypot(rows, columns)
    strength = edges(grey(30 + 40 / (1 + np.exp((radius - 30) / 0.7))), GRADIENT).strength
    rim = strength[np.abs(radius - 30) < 0.3]
    assert rim.size > 50
    assert rim.min() > 0.95


def test_soft_steps_are_measured_at_the_coarser_scale() -> None:
    """A step that was blurred by 3 px before is 3 / sqrt(3**2 + 3**2) as strong at a blur of 3 as a sharp one."""
    from scipy.ndimage import gaussian_filter1d

    columns = np.arange(160)
    sharp = 40.0 * (columns >= 40)
    soft = gaussian_filter1d(40.0 * (columns >= 100), 3, truncate=6)
    strength = edges(grey(np.tile(20 + sharp + soft, (80, 1))), GRADIENT).strength[40]
    assert strength[39:41].max() == pytest.approx(1)
    assert strength[98:102].max() == pytest.approx(0.5**0.5, rel=0.05)


def test_strength_lies_between_none_and_one(rng: np.random.Generator) -> None:
    strength = edges(picture(4 * rng.random((40, 30, 3))), EdgesParams()).strength
    assert strength.dtype == np.float32
    assert strength.min() == 0
    assert strength.max() == 1


def test_grey_pictures_count_as_colour() -> None:
    image = step_at(20, (0.1,) * 3, (0.5,) * 3)
    single = picture(image.pixels[..., 0])
    np.testing.assert_array_equal(edges(single, EdgesParams()).strength, edges(image, EdgesParams()).strength)


@functools.cache
def forest_text() -> str:
    """The shipped forest as OpenCV reads it."""
    return opencv_text(np.load(MODEL))


def forest(path: Path, leave_out: str = "nothing", value: str = r"\1") -> Path:
    """It in a file, with an entry renamed, or another value of the first option."""
    text = forest_text().replace(f"{leave_out}:", "other:")
    path.write_text(re.sub(r"(?<=stride: )(\d+)", value, text, count=1))
    return path


def refusal(model: Path | None) -> str:
    """The message, which the check and the stage agree on."""
    params = EdgesParams(detector="structured", model=model)
    with pytest.raises(InputError) as early:
        check_model(params, {})
    with pytest.raises(InputError) as late:
        edges(step_at(20, (0.1,) * 3, (0.5,) * 3), params)
    assert str(early.value) == str(late.value)
    assert "\n" not in str(early.value)
    assert str(early.value).startswith("model: ")
    return str(early.value)


def test_model_must_be_a_file(tmp_path: Path) -> None:
    assert "is not a file" in refusal(tmp_path / "missing.yml")
    assert "is not a file" in refusal(tmp_path)


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", b"\x00\x01\x02\xff" * 100, b"%YAML:1.0\n---\n", b"%YAML:1.0\n---\noptions: 3\n", b"\x1f\x8b",
     b"%YAML:1.0\n---\noptions: [ 1,\n", b"<?xml version='1.0'?><a/>", b"{}"],
)  # fmt: skip
@pytest.mark.parametrize("suffix", [".yml", ".yml.gz"])
def test_other_files_are_refused(content: bytes, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"model{suffix}"
    path.write_bytes(content)
    assert "not a structured forest" in refusal(path)


@pytest.mark.parametrize("entry", ["stride", "numberOfTrees", "childs", "edgeBins"])
def test_incomplete_forests_are_refused_by_the_entry(entry: str, tmp_path: Path) -> None:
    assert entry in refusal(forest(tmp_path / "model.yml", leave_out=entry))


def test_forests_of_other_settings_are_refused(tmp_path: Path) -> None:
    assert "options.stride is 4; texloom evaluates forests of 2" in refusal(
        forest(tmp_path / "model.yml", value="4")
    )


@pytest.mark.parametrize(
    ("table", "position", "value", "message"),
    [
        ("childs", 0, "1", "childs: not the nodes of a tree"),  # a loop
        ("childs", 0, "70000", "childs: not the nodes of a tree"),
        ("featureIds", 0, "7228", "featureIds: not all from 0 to 7227"),
        ("thresholds", 0, "high", "thresholds: could not convert"),
        ("edgeBins", 3, "256", "do not fit"),
        ("edgeBoundaries", 1, "-5", "do not fit"),
    ],
)
def test_damaged_tables_are_refused(table: str, position: int, value: str, message: str, tmp_path: Path) -> None:
    path = forest(tmp_path / "model.yml")
    before, name, after = path.read_text().partition(f"{table}:\n  - [ ")
    numbers = after.split(", ", position + 1)
    path.write_text(before + name + ", ".join([*numbers[:position], value, *numbers[position + 1 :]]))
    with pytest.raises(InputError, match=message):
        check_model(EdgesParams(model=path), {})


def test_valid_params_pass_the_check(tmp_path: Path) -> None:
    for params in (EdgesParams(), GRADIENT, EdgesParams(model=forest(tmp_path / "model.yml"))):
        check_model(params, {})


def test_model_is_the_one_whose_digest_is_in_the_code() -> None:
    assert hashlib.sha256(MODEL.read_bytes()).hexdigest() == MODEL_DIGEST
    card = Path(__file__).parents[3] / "docs" / "contours.md"
    assert MODEL_DIGEST in card.read_text()


@pytest.mark.parametrize("shape", [(1, 1), (1, 90), (33, 47), (64, 9), (300, 128)])
def test_pictures_of_any_size_are_looked_at(shape: tuple[int, int], rng: np.random.Generator) -> None:
    strength = edges(picture(3 * rng.random((*shape, 3))), EdgesParams()).strength
    assert strength.shape == shape
    assert np.isfinite(strength).all()


def drawn(number: int, times: int) -> tuple[Image, np.ndarray]:
    """A procedural texture that the model has not learnt from, and the distance to its contours."""
    texture = reduced(picture_of("judge", number, 192, 7), times)
    return picture(linear_from_srgb(texture.color / np.float32(255))), distance_to(texture.contours)


def test_structured_finds_contours_of_textures_better_than_gradient() -> None:
    """How far strength near contours exceeds that elsewhere, in deviations; wide margins."""

    def excess(image: Image, distance: np.ndarray, params: EdgesParams) -> float:
        strength = edges(image, params).strength
        return float((strength[distance <= 1].mean() - strength[distance >= 3].mean()) / strength.std())

    for times in (1, 2):
        pairs = []
        for number in range(6):
            image, distance = drawn(number, times)
            if (distance <= 1).any() and (distance >= 3).any():
                pairs.append([excess(image, distance, params) for params in (EdgesParams(), GRADIENT)])
        structured, gradient = np.mean(pairs, axis=0)
        assert structured > 1.2
        assert structured > gradient + 0.3


def test_structured_sees_a_step_up_to_the_border() -> None:
    strength = edges(step_at(60, (0.05,) * 3, (0.4,) * 3, size=120), EdgesParams()).strength
    assert strength[[0, 1, 60, 118, 119], 58:62].max(axis=1).min() > 0.6
    assert strength[:, :40].max() < 0.4
    assert strength[:, 80:].max() < 0.4


def test_structured_is_repeatable_with_any_number_of_threads(rng: np.random.Generator) -> None:
    import cv2

    image, _ = drawn(2, 1)
    before, result = cv2.getNumThreads(), []
    try:
        for threads in (1, 2, 2):
            cv2.setNumThreads(threads)
            result.append(edges(image, EdgesParams()).strength)
    finally:
        cv2.setNumThreads(before)
    for other in result[1:]:
        np.testing.assert_array_equal(result[0], other)


@pytest.mark.parametrize("shape", [(192, 192), (130, 144)])
def test_the_shipped_model_is_evaluated_as_opencv_does(shape: tuple[int, int], tmp_path: Path) -> None:
    if not hasattr(cv2, "ximgproc"):
        pytest.skip("this OpenCV has no ximgproc")
    color = srgb_from_linear(drawn(0, 1)[0].pixels[: shape[0], : shape[1]]).astype(np.float32)
    model = forest(tmp_path / "model.yml")
    expected = cv2.ximgproc.createStructuredEdgeDetection(str(model)).detectEdges(color)
    strength = load_forest(MODEL).detect(color)
    np.testing.assert_array_equal(read_opencv_forest(model).detect(color), strength)
    # Directions halfway between two are rounded otherwise.
    assert np.abs(strength - expected).mean() < 0.002
    np.testing.assert_allclose(strength, expected, atol=0.1)


def test_structured_takes_other_scales() -> None:
    image, _ = drawn(0, 1)
    known = edges(image, EdgesParams()).strength
    assert (edges(image, EdgesParams(scales=(1.0,))).strength != known).any()


@pytest.mark.parametrize(
    ("shorter", "expected"),
    [(100, [1, 2]), (200, [1, 2]), (256, [0.5, 1, 2]), (384, [0.5, 1, 2]), (512, [0.5, 1, 1.5]),
     (600, [256, 512, 768]), (4096, [256, 512, 768])],
)  # fmt: skip
def test_exemplars_are_looked_at_in_sizes_that_help(shorter: int, expected: list[float]) -> None:
    """As magnifications, or as sizes in px."""
    sizes = [value if value > 4 else value * shorter for value in expected]
    np.testing.assert_allclose([m * shorter for m in magnifications(shorter, (0.5, 1.0, 2.0))], sizes)


def test_no_exemplar_is_enlarged_beyond_what_helps() -> None:
    for shorter in range(16, 3000, 97):
        looked_at = [m * shorter for m in magnifications(shorter, (0.125, 1.0, 4.0))]
        assert max(looked_at) < 768.1
        assert looked_at == sorted(looked_at)


@pytest.mark.parametrize("turned", [False, True])
def test_shading_is_no_contour(turned: bool) -> None:
    """A soft shadow that is four times as deep as a step between two materials, of low contrast."""
    columns = np.arange(192.0)
    material = np.where(columns < 60, 0.30, 0.33)
    shadow = 1 - 0.4 / (1 + np.exp(-(columns - 130) / 8))
    rng = np.random.default_rng(2)
    light = np.tile(material * shadow, (192, 1)) * (1 + 0.01 * rng.standard_normal((192, 192)))
    strength = edges(picture(light.T if turned else light), EdgesParams()).strength
    lines = strength.T if turned else strength
    assert lines[:, 57:63].max(axis=1).mean() > 5 * lines[:, 80:180].max(axis=1).mean()


def test_background_threshold_removes_weak_responses() -> None:
    """Of noise beside a step little is left; the step keeps its strength."""
    rng = np.random.default_rng(5)
    step = step_at(60, (0.05,) * 3, (0.4,) * 3, size=240).pixels
    image = picture((step * (1 + 0.05 * rng.standard_normal(step.shape))).clip(0, 1))
    without, with_threshold = (
        edges(image, EdgesParams(background_threshold=level)).strength for level in (0.0, 0.1)
    )
    assert with_threshold[:, 120:].mean() < 0.5 * without[:, 120:].mean()
    assert with_threshold[:, 59:61].mean() > 0.8 * without[:, 59:61].mean()


def test_large_exemplars_are_looked_at_reduced() -> None:
    """The same texture at twice the pixels has the same contours."""
    import cv2

    image, _ = drawn(3, 1)
    small = picture(np.tile(image.pixels, (3, 3, 1))[:512, :512])
    large = picture(small.pixels.repeat(2, axis=0).repeat(2, axis=1))
    params = EdgesParams(scales=(1.0,))
    halved = cv2.resize(edges(large, params).strength, (512, 512), interpolation=cv2.INTER_AREA)
    assert np.corrcoef(halved.ravel(), edges(small, params).strength.ravel())[0, 1] > 0.95


def test_very_many_scales_are_refused() -> None:
    with pytest.raises(ValueError, match="at most 8 items"):
        EdgesParams(scales=(1.0,) * 9)
