"""Joints of the source map: what is measured across them, against a slow and plain form, and where."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from tests.evaluation.helpers import encoded, tinted
from tests.wraps import WRAPS
from texloom.stages.common.similarity.patch_distance import NearestPatches
from texloom.stages.common.source_maps.source_joints import joint_contrast, worst_of_cells
from texloom.stages.evaluation._measures import joints as _joints
from texloom.stages.evaluation._measures.pictures import prepare, shuffled_blocks
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.evaluation.metrics import Metrics, MetricsParams, metrics
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import USABLE


def grid(height: int, width: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(height), np.arange(width), indexing="ij"), axis=2).astype(np.uint32)


def copied(exemplar: Image, match: np.ndarray) -> Image:
    return Image(exemplar.pixels[match[..., 0], match[..., 1]], exemplar.channels)


def scored(exemplar: Image, match: np.ndarray, tileable: bool = False, keep: np.ndarray | None = None) -> Metrics:
    return metrics(exemplar, copied(exemplar, match).wrapping(tileable), MetricsParams(), match, keep)


def task(exemplar: Image, match: np.ndarray, tileable: bool = False) -> Task:
    source, result = prepare(exemplar, copied(exemplar, match))
    return Task(source, result, shuffled_blocks(source, 2), match, None, Wraps(tileable, tileable), 0.25, 9)


def with_block(match: np.ndarray, row: int, column: int, source: tuple[int, int], side: int = 24) -> np.ndarray:
    """The source map with a square copied from elsewhere."""
    changed = match.copy()
    changed[row : row + side, column : column + side] = grid(side, side) + np.array(source, np.uint32)
    return changed


@pytest.mark.parametrize("wraps", WRAPS)
def test_contrast_is_that_of_the_sources_neighbours(wraps: Wraps) -> None:
    rng = np.random.default_rng(3)
    exemplar, result = (rng.normal(size=(*shape, 3)).astype(np.float32) for shape in ((6, 7), (16, 18)))
    match = with_block(grid(6, 7)[rng.integers(0, 6, (16, 18)), rng.integers(0, 7, (16, 18))], 2, 3, (1, 0), 4)
    expected = np.full((16, 18), -1.0)
    for place in np.ndindex(16, 18):
        for step in ((1, 0), (0, 1)):
            other = tuple(np.add(place, step) % (16, 18))
            source, beside = match[place].astype(int), match[other].astype(int)
            ends = place[step[1]] == (16, 18)[step[1]] - 1
            if (ends and not wraps[step[1]]) or (source + step == beside).all():
                continue
            jumps = [0.0]
            for continued, pixel in ((source + step, other), (beside - step, place)):
                if (continued >= 0).all() and (continued < (6, 7)).all():
                    jumps.append(float(((exemplar[tuple(continued)] - result[pixel]) ** 2).sum()))
            expected[place] = max(expected[place], *jumps)
    np.testing.assert_allclose(joint_contrast(exemplar, result, match, wraps), expected, rtol=1e-5)


def test_the_exemplars_own_distance_is_to_patches_that_do_not_overlap() -> None:
    noise = np.random.default_rng(4).normal(size=(20, 24, 3))
    lab = ndimage.gaussian_filter(noise, (2, 2, 0)).astype(np.float32) * 50
    corners = np.indices((14, 18)).reshape(2, -1).T
    patches = np.array([lab[row : row + 7, column : column + 7].ravel() for row, column in corners])
    distances = ((patches[:, None] - patches[None]) ** 2).sum(axis=2) / 49
    distances[np.abs(corners[:, None] - corners[None]).max(axis=2) < 7] = np.inf
    expected = float(distances.min(axis=1).mean())
    contrast, own = NearestPatches(lab, 1, None).own_distances()
    assert own.mean() == pytest.approx(expected, rel=0.02)
    by_channel = patches.reshape(-1, 49, 3)
    assert np.isin(contrast.round(1), by_channel.var(axis=1).sum(axis=1).round(1)).all()


def test_a_copy_has_no_joints() -> None:
    exemplar = encoded(tinted("brick")[:128, :128])
    made = scored(exemplar, grid(128, 128)[10:100, 20:120])
    assert made.table["measures"]["joints"]["value"] == 0
    assert made.table["measures"]["joints"]["score"] == 1
    assert made.joints is not None
    assert not made.joints.any()


def test_without_a_source_map_there_is_no_map_of_joints() -> None:
    exemplar = encoded(tinted("brick")[:64, :64])
    made = metrics(exemplar, exemplar, MetricsParams())
    assert made.joints is None
    assert made.table["measures"]["joints"]["reason"] == "no source map was given"


@pytest.mark.parametrize("name", ["brick", "gravel"])
def test_random_blocks_are_worse_than_a_seamless_joint(name: str) -> None:
    """A texture that repeats exactly, continued one period away, against blocks from anywhere."""
    tile = tinted(name)[:80, :80]
    exemplar = encoded(np.tile(tile, (2, 2, 1)))
    seamless = grid(80, 160)
    seamless[:, 40:] = seamless[:, 40:] - np.array([0, 40], np.uint32) + np.array([40, 40], np.uint32)
    seamless[:, 40:, 0] = (seamless[:, 40:, 0] + 40) % 80
    rng = np.random.default_rng(3)
    blocks = np.zeros((160, 160, 2), np.uint32)
    for row in range(0, 160, 32):
        for column in range(0, 160, 32):
            blocks[row : row + 32, column : column + 32] = grid(32, 32) + rng.integers(0, 120, 2).astype(np.uint32)
    good, bad = (scored(exemplar, match).table["measures"]["joints"] for match in (seamless, blocks))
    assert good["value"] < 0.2
    assert good["score"] == 1
    assert bad["value"] > 5 * max(good["value"], 0.01)


def test_the_map_shows_where_the_worst_joints_are() -> None:
    exemplar = encoded(tinted("brick")[:200, :200])
    match = with_block(grid(200, 200), 120, 60, (37, 150))
    joints = scored(exemplar, match).joints
    assert joints is not None
    assert joints.shape == (200, 200)
    assert joints.dtype == np.float32
    assert joints.max() > 1
    rows, columns = np.nonzero(joints)
    assert rows.min() >= 112
    assert rows.max() < 152
    assert columns.min() >= 52
    assert columns.max() < 92


def test_the_border_of_a_tileable_result_is_a_joint() -> None:
    exemplar = encoded(tinted("brick")[:128, :128])
    match = grid(128, 128)[8:104, 8:104]
    open_ended, wrapped = (scored(exemplar, match, tileable=tileable).joints for tileable in (False, True))
    assert open_ended is not None
    assert not open_ended.any()
    assert wrapped is not None
    assert wrapped[:, -1].all()
    assert wrapped[-1].all()
    assert not wrapped[30:60, 30:60].any()


def test_masked_and_given_pixels_are_ignored() -> None:
    values = tinted("gravel")[:160, :160]
    exemplar = encoded(values)
    match = with_block(with_block(grid(160, 160), 20, 20, (100, 90)), 100, 100, (30, 40))
    keep = np.ones((160, 160), bool)
    keep[90:, 90:] = False
    joints = scored(exemplar, match, keep=keep).joints
    assert joints is not None
    assert not joints[:80].any()
    assert joints[95:, 95:].any()
    usable = np.ones((160, 160, 1), np.float32)
    usable[60:80, 60:80] = 0
    lines = [
        metrics(
            Image(np.concatenate([pixels, usable], axis=2), (*exemplar.channels, USABLE)),
            copied(exemplar, match),
            MetricsParams(),
            match,
        ).table["measures"]["joints"]
        for pixels in (exemplar.pixels, np.where(usable > 0, exemplar.pixels, np.float32(0.9)))
    ]
    assert lines[0] == lines[1]


def test_distances_at_joints_are_those_to_the_nearest_patches() -> None:
    exemplar = encoded(tinted("gravel")[100:160, 100:160])
    measured = task(exemplar, with_block(grid(60, 60), 20, 20, (5, 30)))
    ratios = _joints.measure_joints(measured)
    lab = measured.exemplar.lab
    corners = np.array([(row, column) for row in range(54) for column in range(54)])
    patches = np.array([lab[row : row + 7, column : column + 7].ravel() for row, column in corners])

    def distance(one: np.ndarray, others: np.ndarray) -> float:
        return float(((others - one) ** 2).sum(axis=1).min())

    apart = np.abs(corners[:, None] - corners[None]).max(axis=2) >= 7
    chosen = np.random.default_rng(5).permutation(len(corners))[:256]
    own = np.array([distance(patches[index], patches[apart[index]]) for index in chosen])
    contrasts = patches.reshape(-1, 49, 3).var(axis=1).sum(axis=1)
    groups = np.array_split(np.argsort(contrasts[chosen], kind="stable"), 8)
    usual = np.maximum.accumulate([np.quantile(own[group], 0.8) / 1.5 for group in groups])
    for place, ratio in zip(ratios.places, ratios.ratios[:, 0], strict=True):
        row, column = np.clip(place - 3, 0, 53)
        one = measured.result.lab[row : row + 7, column : column + 7]
        contrast = one.reshape(49, 3).var(axis=0).sum()
        of_group = np.interp(contrast, [contrasts[chosen][group].mean() for group in groups], usual)
        expected = distance(one.ravel(), patches) / max(own.mean(), of_group)
        assert ratio == pytest.approx(expected, rel=0.15, abs=1e-3)


def test_tiles_in_another_order_have_no_bad_joints() -> None:
    """Edges of tiles that lie apart in the exemplar are no more unlike its edges than these are among them."""
    rng = np.random.default_rng(8)
    tones = 0.15 + 0.5 * (np.indices((8, 8)).sum(axis=0) % 2) + rng.normal(0, 0.04, (8, 8))
    values = tones.repeat(16, 0).repeat(16, 1) + rng.normal(0, 0.004, (128, 128))
    exemplar = encoded(values[..., None].repeat(3, 2).astype(np.float32))
    order = np.arange(64).reshape(8, 8)
    for parity in (0, 1):
        alike = np.indices((8, 8)).sum(axis=0) % 2 == parity
        order[alike] = rng.permutation(order[alike])
    first = np.stack(np.divmod(order, 8), axis=2).repeat(16, 0).repeat(16, 1) * 16
    measured = scored(exemplar, (first + grid(128, 128) % 16).astype(np.uint32)).table["measures"]["joints"]
    assert measured["score"] > 0.5


def test_the_worst_pixel_of_each_cell_is_measured() -> None:
    contrast = np.full((10, 11), -1, np.float32)
    contrast[0, 0], contrast[3, 3], contrast[9, 10], contrast[5, 8], contrast[5, 9] = 1, 2, 0, 7, 7
    np.testing.assert_array_equal(worst_of_cells(contrast, 4), [[3, 3], [5, 8], [9, 10]])


def test_joints_and_objects_are_bit_identical_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    exemplar = encoded(tinted("brick")[:131, :140])
    match = with_block(grid(131, 140), 30, 40, (80, 90))
    results = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        made = scored(exemplar, match)
        assert made.joints is not None
        results.append((made.joints.tobytes(), str(made.table["measures"]["steps"])))
    assert len(set(results)) == 1
