import json
from typing import Any

import numpy as np
import pytest
import skimage.data
from scipy import ndimage

from tests.evaluation.helpers import encoded, tinted
from texloom.stages.common.similarity import patch_distance as _patch_distance
from texloom.stages.evaluation._measures import patches as _patches
from texloom.stages.evaluation._measures import pixels as _pixels
from texloom.stages.evaluation._measures import reuse, spectrum, windows
from texloom.stages.evaluation._measures.pictures import prepare
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import TORUS, Wraps
from texloom.stages.vocabulary.masks import USABLE


def measure(exemplar: Image, result: Image, **options: Any) -> dict[str, dict[str, Any]]:
    inputs = {name: options.pop(name) for name in ("match", "keep") if name in options}
    result = result.wrapping(options.pop("tileable", False))
    return metrics(exemplar, result, MetricsParams(**options), **inputs).table["measures"]


def test_a_texture_without_structure_has_no_autocorrelation_score() -> None:
    stripes = 0.5 + 0.4 * np.sin(np.arange(96) / 3)[:, None] * np.ones((1, 96))
    speckle = np.random.default_rng(8).uniform(0, 1, (96, 96))
    assert measure(encoded(speckle), encoded(speckle))["autocorrelation"]["score"] is None
    structured = measure(encoded(stripes), encoded(stripes.T.copy()))["autocorrelation"]
    assert structured["score"] == 0
    assert measure(encoded(stripes), encoded(stripes))["autocorrelation"]["score"] == 1


def grid(height: int, width: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(height), np.arange(width), indexing="ij"), axis=2).astype(np.uint32)


def copied(exemplar: Image, match: np.ndarray) -> Image:
    return Image(exemplar.pixels[match[..., 0], match[..., 1]], exemplar.channels)


def test_grey_textures_are_compared_by_lightness_and_score_as_in_colour() -> None:
    grey = encoded(skimage.data.brick()[:128, :128] / 255)
    corners = np.random.default_rng(2).integers(0, 128, (2, 2, 2)).repeat(64, axis=0).repeat(64, axis=1)
    match = ((corners + grid(128, 128)) % 128).astype(np.uint32)
    exemplars = grey, Image(grey.pixels.repeat(3, axis=2), ("R", "G", "B"))
    pairs = [(exemplar, copied(exemplar, match)) for exemplar in exemplars]
    assert [prepare(*pair)[1].compared.shape[2] for pair in pairs] == [1, 3]
    assert prepare(grey, pairs[1][1])[0].compared.shape[2] == 3
    lines, in_color = (measure(*pair, match=match) for pair in pairs)
    for name in lines.keys() - {"seams"}:
        assert lines[name]["value"] == pytest.approx(in_color[name]["value"], rel=1e-3, abs=1e-4), name
        assert lines[name]["score"] == pytest.approx(in_color[name]["score"], rel=1e-3, abs=1e-3), name


def test_the_source_map_tells_copies_from_mixtures() -> None:
    exemplar = encoded(tinted("gravel")[:64, :64])
    rng = np.random.default_rng(9)
    tiling = np.tile(grid(32, 32), (4, 4, 1))
    whole = np.tile(grid(64, 64), (2, 2, 1))
    scattered = rng.integers(0, 64, (128, 128, 2)).astype(np.uint32)
    lines = {
        name: measure(exemplar, copied(exemplar, match), match=match, copied=0.05)
        for name, match in {"tiling": tiling, "whole": whole, "scattered": scattered}.items()
    }
    assert lines["tiling"]["copying"]["value"] == lines["whole"]["copying"]["value"] == 1
    assert lines["scattered"]["copying"]["value"] == 0
    assert lines["whole"]["copying"]["more"] == {
        "typical": 64 * 64,
        "largest": 1,
        "verbatim": "whole copies of the exemplar, side by side",
    }
    assert lines["whole"]["contents"]["value"] == lines["scattered"]["contents"]["value"] == 0
    assert lines["whole"]["contents"]["more"]["entropy"] == 1
    assert lines["tiling"]["contents"]["value"] == pytest.approx(0.75, abs=0.15)
    assert lines["tiling"]["contents"]["score"] == 0
    assert lines["scattered"]["copies"]["score"] == 1
    assert lines["whole"]["continuity"]["value"] == pytest.approx(1 - 1 / 127)
    assert lines["scattered"]["continuity"]["value"] < 0.01


def test_results_that_are_too_smooth_are_reported() -> None:
    values = np.random.default_rng(10).uniform(0.2, 0.8, (96, 96))
    for corner in (0, 24, 48, 72):
        values[corner : corner + 20, corner : corner + 20] = 0.5
    exemplar = encoded(values)
    match = np.tile(grid(24, 24), (4, 4, 1))
    lines = measure(exemplar, copied(exemplar, match), match=match)
    assert lines["smoothness"]["value"] > 2 * lines["smoothness"]["floor"]
    assert measure(exemplar, exemplar)["smoothness"]["score"] == 1


def test_a_feature_that_returns_is_counted() -> None:
    rng = np.random.default_rng(12)
    values = rng.uniform(0.4, 0.6, (144, 144))
    rows, columns = np.mgrid[:144, :144]
    values[np.hypot(rows - 60, columns - 80) < 14] = 0.95
    match = grid(144, 144)
    again = match.copy()
    for row, column in ((2, 4), (4, 100), (100, 6), (104, 98)):
        again[row : row + 36, column : column + 36] = grid(36, 36) + np.array([42, 62], np.uint32)
    exemplar = encoded(values)
    once, often = (measure(exemplar, copied(exemplar, one), match=one)["copies"] for one in (match, again))
    assert once["score"] == 1
    assert often["score"] < 0.5
    assert often["more"]["place"] == pytest.approx([60, 80], abs=14)


def test_a_collapsed_result_scores_low_and_a_crop_is_named() -> None:
    exemplar = encoded(tinted("gravel")[:128, :128])
    collapsed = np.tile(grid(24, 24) + np.uint32(50), (5, 5, 1))
    table = metrics(exemplar, copied(exemplar, collapsed), MetricsParams(), collapsed).table
    assert table["summary"]["variety"] == 0
    assert table["notes"] == []
    crop = grid(128, 128)[5:110, 20:125]
    table = metrics(exemplar, copied(exemplar, crop), MetricsParams(), crop).table
    assert table["notes"] == ["The result is a crop of the exemplar: nothing was synthesised."]
    assert table["summary"]["variety"] == 0


@pytest.mark.parametrize(
    ("match", "message"), [(grid(32, 31), "match is"), (grid(32, 32) + np.uint32(1), "outside the exemplar")]
)
def test_a_wrong_source_map_is_refused(match: np.ndarray, message: str) -> None:
    picture = encoded(np.zeros((32, 32)))
    with pytest.raises(InputError, match=message):
        metrics(picture, picture, MetricsParams(), match)


def test_seams_are_measured_where_they_matter() -> None:
    ramp = np.linspace(0.2, 0.8, 64)[:, None] * np.ones((1, 64))
    wave = 0.5 + 0.3 * np.cos(2 * np.pi * np.arange(64) / 64)[:, None] * np.ones((1, 64))
    assert measure(encoded(ramp), encoded(wave))["seams"]["value"] is None
    assert measure(encoded(ramp), encoded(wave), tileable=True)["seams"]["score"] == 1
    assert measure(encoded(ramp), encoded(ramp), tileable=True)["seams"]["score"] == 0


BRICK = skimage.data.brick() / 255
PLAIN = np.full((64, 64), 0.3)
PIXEL = np.zeros((1, 1))


@pytest.mark.parametrize(
    ("exemplar", "result"),
    [
        pytest.param(PLAIN, np.full((80, 70), 0.3), id="constant"),
        pytest.param(PLAIN, BRICK[:64, :64], id="constant exemplar"),
        pytest.param(BRICK[:64, :64], PLAIN, id="constant result"),
        pytest.param(np.zeros((64, 64)), np.zeros((64, 64)), id="black"),
        pytest.param(PIXEL, PIXEL, id="one pixel"),
        pytest.param(PIXEL, BRICK[:64, :64], id="one pixel's exemplar"),
        pytest.param(BRICK[:64, :64], PIXEL, id="one pixel's result"),
        pytest.param(np.pad(BRICK[:64, :64], ((0, 0), (0, 64))), tinted("gravel")[:70, :90], id="half plain"),
        pytest.param(BRICK[:9, :300], BRICK[:300, :9], id="strips"),
        pytest.param(BRICK[:40, :70], BRICK[:23, :31], id="small"),
        pytest.param(BRICK[:200, :200], BRICK[:90, :100], id="smaller result"),
        pytest.param(BRICK[:70, :70], BRICK[:200, :300], id="larger result"),
    ],
)
def test_any_picture_has_a_table(exemplar: np.ndarray, result: np.ndarray) -> None:
    lines = measure(encoded(exemplar), encoded(result), tileable=True)
    json.dumps(lines, allow_nan=False)
    for name, line in lines.items():
        assert (line["score"] is None) == ("reason" in line), name
        assert line["score"] is None or 0 <= line["score"] <= 1
        assert line["value"] is None or isinstance(line["value"], float)


def test_light_of_any_strength_has_a_table() -> None:
    rng = np.random.default_rng(18)
    pixels = rng.uniform(0, 1, (64, 70, 3)).astype(np.float32)
    pictures = [Image(pixels * np.float32(strength), ("R", "G", "B")) for strength in (1e-30, 1, 65504, 1e38)]
    for result in pictures:
        json.dumps(measure(pictures[1], result), allow_nan=False)
        json.dumps(measure(result, result), allow_nan=False)
    assert measure(pictures[1], pictures[2])["colors"]["score"] == 0


def masked(values: np.ndarray, usable: np.ndarray, mark: str) -> Image:
    """A picture with a channel that marks pixels."""
    plain = encoded(values)
    pixels = np.concatenate([plain.pixels, usable[..., None].astype(np.float32)], axis=2)
    return Image(pixels, (*plain.channels, mark))


@pytest.fixture(scope="module")
def usable() -> np.ndarray:
    """All but a stripe at a border, a block and single pixels."""
    pixels = np.ones((160, 180), bool)
    pixels[:, :9] = False
    pixels[60:82, 75:95] = False
    pixels[150, 20:170:50] = False
    return pixels


@pytest.mark.parametrize("mark", ["A", USABLE])
def test_masked_pixels_change_no_figure(usable: np.ndarray, mark: str) -> None:
    values = tinted("gravel")[:160, :180]
    poisoned = np.where(usable[..., None], values, np.random.default_rng(20).uniform(0, 1, values.shape))
    result = encoded(tinted("gravel")[200:360, 200:380])
    places = np.argwhere(usable).astype(np.uint32)
    match = places[np.random.default_rng(21).integers(0, len(places), (160, 180))]
    lines = [measure(masked(one, usable, mark), result, match=match) for one in (values, poisoned)]
    assert lines[0] == lines[1]
    assert {name for name, line in lines[0].items() if line["value"] is None} == {"seams"}
    # A marked picture that is used evenly is used evenly, and hardly differs from one without marks.
    assert lines[0]["contents"]["more"]["entropy"] > 0.9
    whole = measure(encoded(values), result)
    for name in ("colors", "patches", "statistics", "sharpness", "coherence"):
        assert lines[0][name]["value"] == pytest.approx(whole[name]["value"], rel=0.35), name


def test_excluded_pixels_are_no_part_of_the_texture() -> None:
    """A plain block, the tenth of a picture, would count as another colour and as another texture."""
    values = tinted("gravel")[:200, :200]
    usable = np.ones((200, 200), bool)
    usable[70:130, 70:130] = False
    stained = np.where(usable[..., None], values, np.array([1.0, 0, 0]))
    clean, marked, unmarked = (
        measure(one, encoded(values))
        for one in (encoded(values), masked(stained, usable, USABLE), encoded(stained))
    )
    for name in ("colors", "completeness", "statistics", "sharpness"):
        assert abs(marked[name]["value"] - clean[name]["value"]) < 0.3 * abs(
            unmarked[name]["value"] - clean[name]["value"]
        ), name


def test_an_exemplar_that_is_all_there_is_complete() -> None:
    """Of a large result only some rows are searched; the source map tells where each patch was copied to."""
    exemplar = encoded(tinted("gravel")[:96, :96])
    match = np.tile(grid(96, 96), (4, 4, 1))
    result = copied(exemplar, match)
    assert measure(exemplar, result)["completeness"]["value"] > 0
    assert measure(exemplar, result, match=match)["completeness"]["value"] == 0


def test_completeness_of_a_result_that_shows_none_of_the_sampled_patches() -> None:
    """As of a large exemplar and a small result."""
    exemplar = encoded(tinted("gravel"))
    match = grid(33, 33) + np.array([400, 20], np.uint32)
    assert measure(exemplar, copied(exemplar, match), match=match)["completeness"]["value"] > 0.3


@pytest.mark.parametrize("step", [1, 4])
def test_copies_of_patches_are_found_by_a_sample_in_its_place(step: int) -> None:
    rng = np.random.default_rng(11)
    match = rng.integers(0, 40, (64, 70, 2)).astype(np.uint32)
    match[10:42, 20:60] = grid(40, 40)[5:37]
    reach = (_patch_distance.SIDE - 1) * step
    whole = rng.uniform(size=(64 - reach, 70 - reach)) < 0.8
    patches = np.column_stack([rng.permutation(40 - reach)[:9], rng.permutation(40 - reach)[:9]])
    found = {
        (int(number), *map(int, corner))
        for part in _patches.copied_patches(match, 40, step, whole, patches)
        for number, corner in zip(*part, strict=True)
    }
    expected = set()
    for number, corner in enumerate(patches):
        for offset in ((0, 0), (0, reach), (reach, 0), (reach, reach), (reach // 2, reach // 2)):
            for place in np.argwhere((match == corner + offset).all(axis=2)) - offset:
                if (place >= 0).all() and (place < whole.shape).all() and whole[*place]:
                    expected.add((number, *map(int, place)))
    assert found == expected


def test_too_much_mask_is_reported() -> None:
    values = tinted("gravel")[:128, :128]
    few = np.zeros((128, 128), bool)
    few[::3, ::3] = True
    lines = measure(masked(values, few, USABLE), encoded(values), tileable=True)
    json.dumps(lines, allow_nan=False)
    for name in ("patches", "statistics", "coherence", "sharpness", "smoothness"):
        assert "mask" in lines[name]["reason"], name
    with pytest.raises(InputError, match="excludes every pixel"):
        measure(masked(values, few & False, USABLE), encoded(values))


def test_only_what_was_made_is_judged() -> None:
    """A hole filled well, badly, or not at all, in a picture that is kept."""
    values = tinted("gravel")[:160, :200]
    keep = np.ones((160, 200), bool)
    keep[50:110, 60:130] = False
    exemplar = masked(values, keep, USABLE)
    match = grid(160, 200)
    match[50:110, 60:130] = grid(60, 70) + np.array([5, 100], np.uint32)
    match[50:110, 60:130, 1] -= 40
    good = values[match[..., 0], match[..., 1]]
    plain = np.where(keep[..., None], values, values.mean(axis=(0, 1)))
    torn = np.where(keep[..., None], values, np.random.default_rng(23).permuted(values, axis=0))
    lines = {
        name: measure(exemplar, encoded(one), match=match, keep=keep, copied=0.1)
        for name, one in {"good": good, "plain": plain, "torn": torn}.items()
    }
    assert lines["good"]["coherence"]["score"] > 0.6 > 0.3 > lines["torn"]["coherence"]["score"]
    assert lines["good"]["sharpness"]["score"] > 0.7 > 0.1 > lines["plain"]["sharpness"]["value"]
    assert lines["plain"]["smoothness"]["value"] > 0.5
    assert lines["good"]["copying"]["value"] == 1  # all that was made, not a seventh of the picture
    assert lines["good"]["copying"]["more"]["largest"] == pytest.approx(60 * 70 / keep.sum(), rel=1e-4)
    assert "given" in lines["good"]["completeness"]["reason"]
    nothing = measure(exemplar, encoded(values), match=match, keep=np.ones_like(keep), tileable=True)
    assert {name for name, line in nothing.items() if line["value"] is not None} == {"seams"}
    with pytest.raises(InputError, match="keep is"):
        measure(exemplar, encoded(values), keep=keep[1:])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_colours_that_are_not_finite_are_refused(value: float) -> None:
    plain, broken = (Image(np.full((8, 8, 1), fill, np.float32), ("Y",)) for fill in (0.5, value))
    with pytest.raises(InputError, match="exemplar has colours"):
        measure(broken, plain)
    with pytest.raises(InputError, match="image has colours"):
        measure(plain, broken)


def test_a_plain_result_of_the_same_color_is_right() -> None:
    lines = measure(encoded(np.full((64, 64), 0.3)), encoded(np.full((64, 64), 0.3)))
    assert lines["colors"]["score"] == 1
    assert lines["patches"]["reason"] == "the exemplar has one colour"


def test_a_very_dark_picture_is_judged_like_a_bright_one() -> None:
    # within CIELAB's linear part
    values = skimage.data.brick()[:128, :256].astype(np.float32)[..., None] / 255 * 0.004
    halves = values[:, :128], values[:, 128:]
    dark = [measure(*(Image(part * factor, ("Y",)) for part in halves)) for factor in (1, 0.5)]
    for name in ("patches", "statistics", "coherence", "sharpness", "repetition", "smoothness"):
        assert dark[0][name]["value"] == pytest.approx(dark[1][name]["value"], rel=1e-2, abs=1e-4), name


def test_only_color_counts() -> None:
    values = encoded(tinted("gravel")[:64, :96]).pixels
    extra = np.random.default_rng(11).uniform(0.5, 9, (64, 96, 2)).astype(np.float32)
    more = Image(np.concatenate([values, extra], axis=2), ("R", "G", "B", "A", "height"))
    plain = Image(values, ("R", "G", "B"))
    assert measure(more, more) == measure(plain, plain)


def test_scores_are_bit_identical_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.stages.evaluation._measures.table.DIGITS", 17)  # all that a double holds
    whole = tinted("brick")
    exemplar, result = encoded(whole[:131, :140]), encoded(whole[200:340, 200:350])
    match = np.random.default_rng(19).integers(0, 131, (140, 150, 2)).astype(np.uint32)
    tables = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        tables.append(json.dumps(measure(exemplar, result, match=match, tileable=True)))
    assert len(set(tables)) == 1


def test_the_summary_is_the_worst_of_each_axis() -> None:
    whole = tinted("brick")
    table = metrics(encoded(whole[:128, :128]), encoded(whole[200:360, 200:360]), MetricsParams()).table
    for axis, worst in table["summary"].items():
        scores = [line["score"] for line in table["measures"].values() if line["axis"] == axis]
        known = [score for score in scores if score is not None]
        assert worst == min(known, default=None)


# -- parts against slow and plain forms


def test_product_in_pieces_is_the_product() -> None:
    rng = np.random.default_rng(12)
    for count, width, columns in ((5003, 147, 16), (7, 3, 2), (70001, 2, 5)):
        many, matrix = rng.normal(size=(count, width)), rng.normal(size=(width, columns))
        product = row_product(many.astype(np.float32), matrix.astype(np.float32))
        np.testing.assert_allclose(product, many @ matrix, atol=1e-4)


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_autocorrelation_is_its_definition(share: float) -> None:
    rng = np.random.default_rng(22)
    tone, usable = rng.normal(size=(20, 17)).astype(np.float32), rng.random((20, 17)) < share
    valid = None if share == 1 else usable
    correlation = spectrum.autocorrelation(np.where(usable, tone, 9).astype(np.float32), (4, 3), valid)
    centred = tone - tone[usable].mean()
    for row in range(-4, 5):
        for column in range(-3, 4):
            pairs = [
                ((i, j), (i + row, j + column))
                for i in range(20)
                for j in range(17)
                if 0 <= i + row < 20 and 0 <= j + column < 17 and usable[i, j] and usable[i + row, j + column]
            ]
            expected = np.mean([centred[one] * centred[other] for one, other in pairs])
            expected /= np.mean(centred[usable] ** 2)
            assert correlation[row + 4, column + 3] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("step", [1, 2, 4])
def test_patches_are_those_of_the_picture(step: int) -> None:
    lab = np.random.default_rng(22).normal(size=(31, 34, 3)).astype(np.float32)
    patches = _patch_distance.Patches(lab, step)
    reach = 6 * step
    assert patches.shape == (31 - reach, 34 - reach)
    rows, columns = (axis.ravel() for axis in np.indices(patches.shape))
    for row, column, patch in zip(rows, columns, patches.at(rows, columns), strict=True):
        expected = lab[row : row + reach + 1 : step, column : column + reach + 1 : step].transpose(2, 0, 1)
        np.testing.assert_array_equal(patch, expected.ravel())


def test_nearest_patches_are_the_nearest() -> None:
    rng = np.random.default_rng(14)
    basis = ndimage.gaussian_filter(rng.normal(size=(60, 60, 3)), (3, 3, 0)).astype(np.float32) * 50
    one, other = basis[:28, :30].copy(), basis[30:, 20:].copy()
    for step in (1, 2):
        known = [_patch_distance.Patches(lab, step) for lab in (one, other)]
        directions = _patch_distance.principal_directions(known[1])
        indices = [_patches.index_patches(one, directions) for one in known]
        patches = []
        for lab in (one, other):
            reach = 6 * step
            rows, columns = lab.shape[0] - reach, lab.shape[1] - reach
            corners = [(i, j) for i in range(rows) for j in range(columns)]
            patches.append(
                np.array([lab[i : i + reach + 1 : step, j : j + reach + 1 : step].ravel() for i, j in corners])
            )
        squared = ((patches[0][:, None] - patches[1][None]) ** 2).sum(axis=2) / 49
        distance = _patches.nearest_distance(*indices, len(patches[0]))
        assert distance == pytest.approx(float(squared.min(axis=1).mean()), rel=0.02)
        assert _patches.nearest_distance(indices[1], indices[1]) == 0


def test_wasserstein_of_shifted_colors_is_the_shift() -> None:
    values = np.random.default_rng(15).normal(size=(3000, 2)).astype(np.float32)
    shift = np.array([0.25, -1.5], np.float32)
    distance = np.abs(_pixels.quantiles(values) - _pixels.quantiles(values[:2000] + shift)).mean(axis=0)
    np.testing.assert_allclose(distance, np.abs(shift), atol=0.08)
    np.testing.assert_allclose(
        _pixels.quantiles(values, 2)[:, 0], np.quantile(values[:, 0], [0.25, 0.75]), atol=1e-4
    )


def test_local_contrast_is_the_deviation_inside_windows() -> None:
    tone = np.random.default_rng(16).normal(size=(15, 12)).astype(np.float32)
    for side in (3, 4):
        windows = np.lib.stride_tricks.sliding_window_view(tone, (side, side))
        np.testing.assert_allclose(_pixels.local_contrast(tone, side), windows.std(axis=(2, 3)), atol=1e-5)


def test_segments_by_flood_fill() -> None:
    rng = np.random.default_rng(17)
    match = grid(12, 14)
    match[3:9, 2:7] += np.uint32(5)
    match[5, 5] = 0
    match[10:, :] = rng.integers(0, 20, (2, 14, 2))
    displacement = match.astype(int) - grid(12, 14)
    seen = np.zeros((12, 14), bool)
    areas = []
    for start in np.ndindex(12, 14):
        if seen[start]:
            continue
        seen[start] = True
        stack, area = [start], 0
        while stack:
            i, j = stack.pop()
            area += 1
            for near in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                inside = 0 <= near[0] < 12 and 0 <= near[1] < 14
                if inside and not seen[near] and (displacement[near] == displacement[i, j]).all():
                    seen[near] = True
                    stack.append(near)
        areas.append(area)
    assert sorted(reuse.copied_segments(match).areas) == sorted(areas)


def test_large_results_are_measured_in_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    exemplar = encoded(tinted("gravel")[:64, :64])
    match = np.tile(grid(64, 64), (6, 5, 1))
    result = copied(exemplar, match)
    whole = metrics(exemplar, result.wrapping(True), MetricsParams(), match=match)
    monkeypatch.setattr(windows, "LARGEST", 64**2)
    monkeypatch.setattr(windows, "SIDE", 128)
    made = metrics(exemplar, result.wrapping(True), MetricsParams(), match=match)
    assert made.table["windows"] == [[32, 16], [32, 176], [224, 16], [224, 176]]
    assert "4 windows of 128 px" in made.table["limits"][-1]
    for name in ("copies", "contents"):
        assert made.table["measures"][name] == whole.table["measures"][name]
    for name, line in whole.table["measures"].items():
        if line["score"] is not None and name != "copying":  # windows cut the copies
            assert made.table["measures"][name]["score"] == pytest.approx(line["score"], abs=0.35), name
    assert made.joints is not None
    assert made.joints.shape == (384, 320)
    assert not made.joints[:32].any()
    assert json.dumps(made.table)


def test_one_window_is_scored_as_the_picture_that_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    exemplar = encoded(tinted("gravel")[:96, :96])
    match = np.tile(grid(96, 96), (1, 2, 1))[:, :100]
    monkeypatch.setattr(windows, "SIDE", 96)
    monkeypatch.setattr(windows, "LARGEST", 96 * 99)
    made = metrics(exemplar, copied(exemplar, match), MetricsParams(), match=match).table
    monkeypatch.setattr(windows, "corners", lambda *_: [[0, 0]])
    one = metrics(exemplar, copied(exemplar, match), MetricsParams(), match=match).table
    assert made["windows"] == [[0, 0], [0, 4]]
    own = metrics(exemplar, exemplar, MetricsParams(), match=match[:, :96]).table
    for name in ("coherence", "colors", "sharpness", "copying", "straightness"):
        assert one["measures"][name]["value"] == own["measures"][name]["value"], name


def test_windows_without_a_measure_do_not_count() -> None:
    lines = [{"a": {"value": None, "reason": "none"}}, {"a": {"value": 1.0, "more": {"b": 2, "c": [1]}}}]
    lines.append({"a": {"value": 2.0, "more": {"b": 3, "c": [5]}}})
    assert windows.mean_lines(lines) == {"a": {"value": 1.5, "more": {"b": 2.5, "c": [1]}}}
    assert windows.mean_lines(lines[:1]) == lines[0]


def test_a_text_holds_for_a_whole_only_if_it_does_in_all_windows() -> None:
    parts = [{"value": 1.0, "more": {"verbatim": text}} for text in ("a crop of the exemplar", None)]
    tables = [{"copying": part} for part in parts]
    assert windows.mean_lines(tables)["copying"]["more"]["verbatim"] is None
    assert windows.mean_lines(tables[:1])["copying"]["more"]["verbatim"] == "a crop of the exemplar"


def test_a_local_mask_takes_no_measure_of_fidelity(rng: np.random.Generator) -> None:
    tone = rng.random((96, 96, 3), np.float32)
    usable = np.zeros((96, 96, 1), np.float32)
    usable[:44, :44] = 1
    exemplar = Image(np.dstack([tone, usable]), ("R", "G", "B", "usable"))
    lines = metrics(exemplar, Image(tone[:44, :44].copy(), ("R", "G", "B")), MetricsParams()).table["measures"]
    assert all(lines[name]["value"] is not None for name in ("colors", "patches"))


@pytest.mark.parametrize(
    ("generators", "wraps", "value", "score"),
    [
        ([[16, 23], [0, 46]], TORUS, 0.0, 1.0),  # courses of 16 px in a running bond: 96 x 92 px hold whole ones
        ([[16, 20], [0, 40]], TORUS, 0.3, 0.2),
        ([[16, 20], [0, 40]], Wraps(down=True), 0.0, 1.0),  # the bond drifts, but only along x
        ([[17.5, 0]], Wraps(down=True), 0.486, 0.0),
        ([], TORUS, None, None),
    ],
)
def test_cells_of_wrong_length_at_the_border(
    generators: list[list[float]], wraps: Wraps, value: float | None, score: float | None
) -> None:
    noise = np.random.default_rng(3).random((96, 92, 3), np.float32)
    image = Image(noise, ("R", "G", "B")).wrapping(wraps)
    rows = np.array(generators, np.float32).reshape(-1, 2)
    made = metrics(image, image, MetricsParams(), generators=rows)
    line = made.table["measures"]["periods"]
    assert (line["value"], line["score"]) == (
        (None, None) if value is None else (pytest.approx(value, abs=0.01), pytest.approx(score, abs=0.03))
    )
    assert "periods" not in metrics(image, image, MetricsParams()).table["measures"]
