"""Cells of a lattice: what they are cut to, and the plane that they make."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthesis.endless.exemplars import places
from tests.synthesis.semi_procedural.exemplars import (
    GENERATORS,
    HEIGHT,
    WIDTH,
    lattice,
    made,
    made_of_courses,
    uneven_wall,
    wall,
    wall_made,
)
from tests.synthetic import smooth_noise
from texloom.stages.evaluation.cell_plane import CellPlaneParams, cell_plane
from texloom.stages.synthesis.semi_procedural.cell_texture import (
    CellTexture,
    CellTextureParams,
    cell_texture,
)
from texloom.stages.synthesis.semi_procedural.cell_tiling import CellTiling
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import with_usable

SIDE = 240


@pytest.fixture(scope="module", params=["lattice", "courses"])
def laid(request: pytest.FixtureRequest) -> tuple[CellTexture, CellTiling]:
    return wall_made() if request.param == "lattice" else made_of_courses()


def owners(tiling: CellTiling, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest weight at each place, and the number of the box of the sheet that is seen with it."""
    most, box = np.zeros(rows.shape, np.float32), np.zeros(rows.shape, np.int64)
    height, width = tiling.layout["box"]
    for weight, y, x in tiling.covering(rows, columns):
        number = np.floor((y + 0.5) / height) * tiling.layout["columns"] + np.floor((x + 0.5) / width)
        box = np.where(weight > most, number.astype(np.int64), box)
        most = np.maximum(most, weight)
    return most, box


def test_weights_add_up_to_one(laid: tuple[CellTexture, CellTiling]) -> None:
    total = sum(weight for weight, _, _ in laid[1].covering(*places(SIDE)))
    np.testing.assert_allclose(total, 1, atol=2e-6)
    assert laid[0].layout["candidates"] == [2, 2]


def test_bricks_stay_whole_and_have_one_tone(laid: tuple[CellTexture, CellTiling]) -> None:
    """Inside, each pixel is of one cell; joints have the tone of mortar all along."""
    texture, tiling = laid
    rows, columns = places(SIDE)
    plane = tiling.pixels(rows, columns)
    mortar = plane[..., 6] > 0.65
    most, box = owners(tiling, rows, columns)
    assert (most[~mortar] == 1).mean() > 0.8
    assert abs(float(mortar.mean()) - float((wall().pixels[..., 6] > 0.65).mean())) < 0.03
    assert plane[mortar][:, 0].std() < 0.1
    inside = (most == 1) & ~mortar
    spreads = [plane[inside & (box == one), 0].std() for one in np.unique(box[inside])]
    assert np.median(spreads) < 0.6 * plane[inside, 0].std()
    assert 0.9 < texture.layout["joints"] < 1.1


def test_neighbours_are_different_cells_and_all_are_used(laid: tuple[CellTexture, CellTiling]) -> None:
    tiling = laid[1]
    rows, columns = np.mgrid[-40:40, -40:40]
    points = tiling.points_of(rows, columns)
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = tiling.points_of(rows + step[0], columns + step[1])
        assert (points != other).any(axis=-1).all()
    counts = np.unique(points.reshape(-1, 2), axis=0, return_counts=True)[1]
    assert len(counts) == tiling.layout["cells"] >= 16
    assert counts.max() < 1.5 * counts.mean()


def test_courses_have_the_shifts_of_the_exemplar() -> None:
    texture, tiling = made_of_courses()
    assert abs(texture.layout["generators"][1][1] - WIDTH) <= 1
    assert texture.layout["generators"][0][0] == HEIGHT
    shifts = np.diff(tiling.shifts_of(np.arange(-200, 200))) % WIDTH
    assert len(np.unique(shifts)) > 8
    mean, spread, _ = texture.layout["shift"]
    away = (shifts - mean + WIDTH / 2) % WIDTH - WIDTH / 2
    assert np.abs(away).max() <= spread


def test_unequal_blocks_of_courses_are_laid_as_runs(caplog: pytest.LogCaptureFixture) -> None:
    image, begins = uneven_wall()
    frame = np.array([[HEIGHT, 0], [0, 2 * HEIGHT]], np.float32)
    steps, vertices = lattice(frame, image.height)
    texture = cell_texture(image, frame, steps, vertices, CellTextureParams(), courses=True)
    length = texture.layout["generators"][1][1]
    assert f"cells are runs of them, {length} px long to 10 %" in caplog.text
    spans = np.concatenate([(one - one[:, None]).ravel() for one in begins])
    assert (np.abs(spans - length) <= 2).any()  # a run of the exemplar
    assert texture.layout["shift"] == [0, length, length]
    assert texture.layout["cells"] >= 8
    tiling = CellTiling.of(texture.image, texture.window, texture.layout)
    rows, columns = places(SIDE)
    plane = tiling.pixels(rows, columns)[..., 0]
    mortar = plane > 0.55
    assert abs(float(mortar.mean()) - float((image.pixels[..., 0] > 0.55).mean())) < 0.05
    most, box = owners(tiling, rows, columns)
    assert (most[~mortar] == 1).mean() > 0.8  # blended in joints, not across blocks
    assert len(np.unique(box)) >= 8


def test_courses_without_clear_joints_are_refused() -> None:
    """Stripes of noise, that no joints divide."""
    frame = np.array([[HEIGHT, 0], [0, 2 * HEIGHT]], np.float32)
    light = 0.3 + 0.05 * smooth_noise((216, 216), 2.0, np.random.default_rng(2))
    light[np.arange(216) % HEIGHT < 3] = 0.7
    image = Image(np.repeat(light[..., None], 3, axis=2).astype(np.float32), ("R", "G", "B"))
    with pytest.raises(InputError, match="too few clear joints between them; the flow wang_tiles"):
        cell_texture(image, frame, *lattice(frame), CellTextureParams(), courses=True)


def test_cells_are_as_wide_as_most_where_a_few_are_narrow() -> None:
    """A plane has the usual steps between vertices, not those of a fit, which narrow cells in the middle pull."""
    steps, vertices = lattice()
    narrow = vertices.copy()
    narrow[vertices[:, 1] > 110, 1] -= 5
    fit = np.linalg.lstsq(np.column_stack([steps, np.ones(len(steps))]), narrow.astype(np.float64), rcond=None)[0][
        :2
    ]
    assert fit[1, 1] < WIDTH - 1
    texture = cell_texture(wall(), fit.astype(np.float32), steps, narrow, CellTextureParams(accept=True))
    assert texture.layout["generators"] == [[HEIGHT, WIDTH // 2], [0, WIDTH]]


def test_normals_have_unit_length_and_levels_of_detail_the_mean(laid: tuple[CellTexture, CellTiling]) -> None:
    near, far = (laid[1].pixels(*places(60, 2.0**level), level) for level in (0.0, 3.0))
    np.testing.assert_allclose(np.square(near[..., 3:6]).sum(axis=2), 1, atol=1e-5)
    assert far[..., 0].std() < near[..., 0].std()
    assert abs(far[..., 0].mean() - near[..., 0].mean()) < 0.05


def test_tones_around_joints_are_evened() -> None:
    image = wall()
    ramp = np.linspace(0.6, 1.4, image.width, dtype=np.float32)[None, :, None]
    lit = image.with_pixels(np.concatenate([image.pixels[..., :3] * ramp, image.pixels[..., 3:]], axis=2))
    plane = made(lit)[1].pixels(*places(SIDE))
    mortar = plane[..., 6] > 0.8
    assert plane[mortar][:, 0].std() < 0.5 * lit.pixels[..., 0][lit.pixels[..., 6] > 0.8].std()


def test_noise_with_a_lattice_that_it_has_not_is_refused() -> None:
    noise = smooth_noise((216, 216, 3), 3, np.random.default_rng(1))
    image = Image(((noise - noise.min()) / np.ptp(noise)).astype(np.float32), ("R", "G", "B"))
    with pytest.raises(InputError, match=r"are not alike: they have 0\.0\d of .* accept=true goes on"):
        made(image)
    assert made(image, accept=True)[0].layout["alike"] < 0.1
    assert wall_made()[0].layout["alike"] > 0.3


def test_the_preview_is_the_reference() -> None:
    texture, tiling = wall_made()
    preview = cell_plane(wall(), texture.image, texture.window, texture.layout, CellPlaneParams(side=70))
    np.testing.assert_array_equal(preview.image.pixels, tiling.pixels(*places(70, 1.0, 0.0, 0.0))[..., :3])
    assert preview.table["cells"] == texture.layout["cells"]
    assert 0.7 < preview.table["contrast"] < 1.2


def test_the_lattice_that_was_found_is_taken_where_vertices_agree() -> None:
    steps, vertices = lattice()
    drifting = GENERATORS + np.float32([[0, 0.6], [0, 0]])
    moved = (vertices + steps[:, :1] * np.float32([0, 0.6])).astype(np.float32)
    for far, expected in ((0.0, 20), (5.0, 21)):
        texture = cell_texture(
            wall(),
            drifting,
            steps,
            moved,
            CellTextureParams(),
            found=GENERATORS - np.float32([[0, far], [0, 0]]),
        )
        assert texture.layout["generators"] == [[HEIGHT, expected], [0, WIDTH]]


def test_few_cells_are_told_and_what_has_none_is_refused(caplog: pytest.LogCaptureFixture) -> None:
    steps, vertices = lattice()
    image, params = wall(), CellTextureParams()
    part = image.cropped(slice(0, 100), slice(0, 130))
    texture = cell_texture(part, GENERATORS, steps, vertices, params)
    assert texture.layout["groups"] == 1
    assert f"shows {texture.layout['cells']} cells that fit" in caplog.text
    with pytest.raises(InputError, match="shows no lattice; the flow wang_tiles"):
        cell_texture(image, GENERATORS[:1], steps, vertices, params)
    with pytest.raises(InputError, match=r"whole cells, fewer than 4; the flow wang_tiles"):
        cell_texture(image.cropped(slice(0, 60), slice(0, 60)), GENERATORS, steps, vertices, params)
    small = np.float32([[5, 0], [0, 5]])
    with pytest.raises(InputError, match="less than 64 px are too small"):
        cell_texture(image, small, *lattice(small), params)


def test_cells_with_excluded_pixels_are_not_taken() -> None:
    image = wall()
    valid = np.ones((image.height, image.width), np.bool_)
    valid[-80:] = False
    texture, _ = made(with_usable(image, valid))
    assert texture.image.channels == image.channels
    assert 4 <= texture.layout["cells"] < wall_made()[0].layout["cells"]
