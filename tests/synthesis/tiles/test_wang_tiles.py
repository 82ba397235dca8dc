"""Wang tiles from an exemplar, their preview and their shaders."""

from __future__ import annotations

import itertools
import logging
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import MaterialX
import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import blobs, masked, picture, smooth_noise, stamped
from texloom.stages.common.grids.wang import CORNERS, SIDES, WangSet, laid
from texloom.stages.evaluation.wang_tiling import WangTilingParams, wang_tiling
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.synthesis.tiles.tile_corners import plain_places
from texloom.stages.synthesis.tiles.wang_borders import (
    WangBorders,
    WangBordersParams,
    check_size,
    core,
    fitting,
    tell_large_elements,
    tile_side,
    to_borders,
    wang_borders,
)
from texloom.stages.synthesis.tiles.wang_shaders import WangShaders, WangShadersParams, wang_shaders
from texloom.stages.synthesis.tiles.wang_tiles import WangTiles, WangTilesParams, wang_tiles
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import with_usable

TILE, BORDER = 40, 6
QUICK = {"preset": "fast", "patch_size": 6}


@pytest.fixture(scope="module")
def exemplar() -> Image:
    return picture(blobs((72, 80, 3), np.random.default_rng(3)))


def made(
    image: Image, generators: np.ndarray | None = None, strength: float = 1.0, **params: Any
) -> tuple[WangBorders, WangTiles]:
    borders = wang_borders(
        image,
        WangBordersParams(**{**QUICK, "tile": TILE, "border": BORDER, **params}),
        np.random.default_rng(1),
        generators=generators,
    )
    parts = (borders.image, borders.match, borders.keep, borders.filled, borders.table)
    varied = WangTilesParams(**QUICK, strength=strength, layout_scale=3)
    return borders, wang_tiles(image, *parts, varied, np.random.default_rng(2), generators=generators)


@pytest.fixture(scope="module", params=[("edges", 2), ("corners", 2), ("edges", 3), ("edges", 1)], ids=str)
def result(exemplar: Image, request: pytest.FixtureRequest) -> tuple[WangBorders, WangTiles]:
    kind, colors = request.param
    return made(exemplar, kind=kind, colors=colors, variants=(2, 3) if colors == 1 else (1, 1))


def tiles_of(image: Image, size: int) -> np.ndarray:
    """(rows, columns, size, size, channels)"""
    return image.pixels.reshape(image.height // size, size, image.width // size, size, -1).swapaxes(1, 2)


def shifts(borders: WangBorders, tiles: WangTiles) -> list[tuple[int, int]]:
    """By how many px tiles may begin later than their borders, so that all have the borders' innermost pixels."""
    down, across = to_borders((borders.image.height, borders.image.width), TILE)
    shared = np.minimum(down[:, None], across) < core(BORDER)
    found = []
    for shift in itertools.product(range(-BORDER // 2, BORDER // 2 + 1), repeat=2):
        equal = np.roll(tiles.image.pixels, shift, (0, 1)) == borders.image.pixels
        if equal[shared].all():
            found.append(shift)
    return found


def test_borders_of_one_colour_are_the_same_in_all_tiles(result: tuple[WangBorders, WangTiles]) -> None:
    """Also beyond the line at which the tiles are cut, so that whatever fits continues."""
    borders, _ = result
    pieces = tiles_of(borders.image, TILE)
    colors = WangSet.of(borders.table).tiles
    sides = (np.s_[:BORDER,], np.s_[:, -BORDER:], np.s_[-BORDER:,], np.s_[:, :BORDER])
    for side, part in enumerate(sides):
        for color in np.unique(colors[..., side]):
            same = pieces[colors[..., side] == color][(slice(None), *part)]
            assert (same == same[0]).all()


def test_tiles_keep_the_borders_and_are_listed_by_colour(result: tuple[WangBorders, WangTiles]) -> None:
    borders, tiles = result
    rows, columns = WangSet.of(borders.table).shape
    assert tiles.image.shape == borders.image.shape == (TILE * rows, TILE * columns, 3)
    assert tiles.image.wraps.both
    assert len(shifts(borders, tiles)) == 1
    listed = tiles.table["tiles"]
    assert tiles.table["size"] == TILE
    assert len({(tile["x"], tile["y"]) for tile in listed}) == rows * columns
    names = SIDES if tiles.table["kind"] == "edges" else CORNERS
    keys = [tuple(tile[name] for name in names) for tile in listed]
    assert keys == sorted(keys)


def test_borders_do_not_show_in_a_random_tiling(result: tuple[WangBorders, WangTiles]) -> None:
    _, tiles = result
    pieces = tiles_of(tiles.image, TILE).reshape(-1, TILE, TILE, 3)
    assert len(np.unique(pieces, axis=0)) == len(pieces)
    tiling = wang_tiling(tiles.image, tiles.table, WangTilingParams(side=320))
    assert tiling.table["albedo"]["ratio"] < 1.1
    assert tiling.image.shape == (320, 320, 3)


def test_variants_differ_as_much_as_is_asked_for() -> None:
    """From the first one's slow colours with other details, to new ones; the first and the borders stay."""
    alike, details = np.zeros((3, 2)), np.zeros((3, 2))
    for number, seed in enumerate((3, 7)):  # new pieces are alike by chance, so there are two exemplars
        exemplar, firsts = picture(blobs((128, 128), np.random.default_rng(seed))), []
        for row, strength in enumerate((0.0, 0.5, 1.0)):
            borders, tiles = made(exemplar, colors=1, variants=(2, 2), strength=strength)
            assert len(shifts(borders, tiles)) == 1
            assert wang_tiling(tiles.image, tiles.table, WangTilingParams()).table["albedo"]["ratio"] < 1.1
            pieces = tiles_of(tiles.image, TILE).reshape(4, TILE, TILE)
            slow = np.stack([gaussian_blur(np.ascontiguousarray(piece), 3.0) for piece in pieces])
            inside = np.s_[2 * BORDER : -2 * BORDER]
            own = [correlation(slow[0][inside, inside], one[inside, inside]) for one in slow[1:]]
            alike[row, number] = np.mean(own)
            details[row, number] = np.mean(np.abs(pieces[1:] - pieces[0])[:, inside, inside] > 0.02)
            firsts.append(pieces[0])
        np.testing.assert_array_equal(firsts[0], firsts[1])
    same, some, none = alike.mean(axis=1)
    assert same > some > none
    assert same > 0.9
    assert none < 0.5
    assert details[0].min() > 0.2


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def test_the_ends_of_the_borders_do_not_show() -> None:
    """Stones of many tones, which interiors can't continue as they are: no straight lines where borders end."""
    changes = []
    for kind, seed in itertools.product(("edges", "corners"), range(2)):
        borders, tiles = made(stones(np.random.default_rng(seed)), kind=kind)
        image = np.roll(tiles.image.pixels, shifts(borders, tiles)[0], (0, 1))
        for axis in (0, 1):
            change = np.abs(image - np.roll(image, 1, axis)).mean(axis=(1 - axis, 2)).reshape(-1, TILE).mean(axis=0)
            changes.append(change[[BORDER, TILE - BORDER]].mean() / change.mean())
    assert np.mean(changes) < 1.3


def test_smooth_tones_have_no_straight_steps_where_borders_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the minimum cut is straight, as that is shortest; the step across it passes over into the interior."""
    clouds = smooth_noise((96, 96), 8, np.random.default_rng(4))[..., None]
    exemplar = picture((0.4 + 0.1 * clouds / clouds.std()).clip(0.02, 1).astype(np.float32).repeat(3, axis=2))
    steps = []
    for largest in (0.5, 1e-6):
        monkeypatch.setattr("texloom.stages.synthesis.tiles.tile_synthesis._LARGEST_STEP", largest)
        borders, tiles = made(exemplar, colors=1, variants=(2, 2))
        image = np.roll(tiles.image.pixels, shifts(borders, tiles)[0], (0, 1))
        lines = np.s_[core(BORDER), TILE - core(BORDER)]
        changes = [
            np.abs(image - np.roll(image, 1, axis)).mean(axis=(1 - axis, 2)).reshape(-1, TILE).mean(axis=0)
            for axis in (0, 1)
        ]
        steps.append(np.mean([change[list(lines)].mean() for change in changes]))
    assert steps[0] < 0.8 * steps[1]


def test_corners_lie_where_the_texture_is_least_special() -> None:
    pixels = 0.3 + 0.02 * np.random.default_rng(0).random((40, 80, 3))
    pixels[:12, :12] = pixels[-6:, 70:] = 0.9
    pixels[20:, 45:60] = 0.05
    image, halves = picture(pixels.astype(np.float32)), np.array([[0, 0, 40, 40], [0, 40, 40, 40]], np.int32)
    of_each, of_one = plain_places(image, halves, 2, 8), plain_places(image, None, 3, 8)
    assert of_each is not None
    assert of_one is not None
    assert (of_each[:, 1] // 40).tolist() == [0, 1]
    for row, column in [*of_each.tolist(), *of_one.tolist()]:
        shown = pixels[row - 8 : row + 8, column - 8 : column + 8]
        assert shown.shape == (16, 16, 3)
        assert np.abs(shown - 0.31).max() < 0.05, (row, column)
    apart = np.abs(of_one[:, None] - of_one).max(axis=2)[~np.eye(3, dtype=bool)]
    assert apart.min() >= 16, "corners of one exemplar overlap"
    usable = np.ones((40, 80), bool)
    usable[::12] = False
    assert plain_places(with_usable(image, usable), None, 1, 8) is None
    assert plain_places(image, None, 1, 21) is None


def test_corners_between_materials_show_the_exemplars_as_they_are() -> None:
    """A first torus, small beside a large exemplar, had the other material at the corners of one."""
    pixels = np.random.default_rng(0).random((160, 96, 3)).astype(np.float32) * 0.1
    pixels[:96] += 0.7
    pixels[96:104] = 0.5
    rectangles = np.array([[0, 0, 96, 96], [104, 0, 56, 96]], np.int32)
    params = WangBordersParams(**QUICK, kind="corners", tile=TILE, border=BORDER)
    made = wang_borders(picture(pixels), params, np.random.default_rng(0), rectangles=rectangles)
    for row, column in np.ndindex(4, 4):
        color = int(WangSet(2, "corners").corners[row, column])
        near = [np.arange(at * TILE - 2, at * TILE + 2) % (4 * TILE) for at in (row, column)]
        assert (made.match[near[0][:, None], near[1], 0] >= 104).all() == (color == 1), (row, column)


def test_elements_that_are_too_large_for_tiles_are_told(caplog: pytest.LogCaptureFixture) -> None:
    both = picture(np.concatenate([np.full((96, 96, 3), 0.5, np.float32), stones(np.random.default_rng(0)).pixels]))
    halves = np.array([[0, 0, 96, 96], [96, 0, 96, 96]], np.int32)
    with caplog.at_level(logging.WARNING):
        tell_large_elements(both, halves, 64)
    assert not caplog.records
    with caplog.at_level(logging.WARNING):
        tell_large_elements(both, halves, 24)
    assert "px in exemplar 2 are larger than a third of tiles of 24 px: they are cut, or return" in caplog.text


def stones(rng: np.random.Generator) -> Image:
    """Smooth stones of different colours with dark joints, about 12 px wide."""
    seeds = rng.uniform(0, 96, (64, 2))
    away = np.linalg.norm(np.moveaxis(np.indices((96, 96)), 0, 2)[:, :, None] - seeds, axis=3)
    nearest = np.sort(away, axis=2)
    colors = rng.uniform(0.2, 0.9, (64, 3))[away.argmin(axis=2)]
    joint = np.clip((nearest[..., 1] - nearest[..., 0]) / 3, 0.2, 1)
    return picture(colors * joint[..., None])


def test_a_cut_that_does_not_fit_shows(exemplar: Image) -> None:
    """Tiles of noise that has no borders."""
    noise = picture(np.random.default_rng(0).random((160, 160, 3)))
    smooth = picture(np.kron(np.random.default_rng(0).random((4, 4, 3)), np.ones((TILE, TILE, 1))))
    table = {"size": TILE, "kind": "edges", "colors": 2}
    assert wang_tiling(noise, table, WangTilingParams()).table["albedo"]["ratio"] == pytest.approx(1, abs=0.02)
    assert wang_tiling(smooth, table, WangTilingParams()).table["albedo"]["ratio"] > TILE / 2


def test_change_across_borders_is_compared_with_that_of_the_same_materials() -> None:
    """Borders of rough noise between interiors of noise a tenth as strong are no seams."""
    side, rough = 4 * TILE, np.zeros((4 * TILE, 4 * TILE), bool)
    for axis in (0, 1):
        near = (np.arange(side) % TILE + TILE // 8) % TILE < TILE // 4
        rough |= near[:, None] if axis == 0 else near
    noise = np.random.default_rng(0).random((side, side, 1)).repeat(3, axis=2)
    atlas = picture(0.4 + noise * np.where(rough, 0.5, 0.05)[..., None])
    match = np.zeros((side, side, 2), np.uint32)
    match[..., 1] = np.where(rough, 70, 10)
    rectangles = np.array([[0, 0, 64, 64], [0, 64, 64, 64]], np.int32)
    table = {"size": TILE, "kind": "edges", "colors": 2}
    told = wang_tiling(atlas, table, WangTilingParams(), match, rectangles).table["albedo"]
    assert told["ratio"] == pytest.approx(1, abs=0.03)
    assert wang_tiling(atlas, table, WangTilingParams()).table["albedo"]["ratio"] > 1.5


def test_the_preview_of_large_tiles_has_fewer(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """16 x 16 tiles of 2048 px would take 13 GB and more."""
    atlas = picture(np.random.default_rng(0).random((160, 160, 3)))
    monkeypatch.setattr("texloom.stages.evaluation.wang_tiling._MOST", 5 * TILE)
    made = wang_tiling(atlas, {"size": TILE, "kind": "edges", "colors": 2}, WangTilingParams())
    assert made.image.shape == (5 * TILE, 5 * TILE, 3)
    assert "cells: 5 tiles of 40 px along a side, as 16 are too large together" in caplog.messages


def test_any_number_of_threads_gives_the_same_tiles(exemplar: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = run_with_threads(lambda: made(exemplar)[1].image.pixels, monkeypatch)
    np.testing.assert_array_equal(one, two)


def test_all_maps_are_copied_together_and_masked_pixels_never(exemplar: Image) -> None:
    usable = np.ones((72, 80), bool)
    usable[20:34, 50:70] = False
    height = exemplar.pixels[..., :1] * 3 - 1
    image = masked(Image(np.concatenate([exemplar.pixels, height], axis=2), ("R", "G", "B", "height")), usable, 9.0)
    _, tiles = made(image)
    assert tiles.image.channels == ("R", "G", "B", "height")
    assert tiles.image.pixels.max() <= 2
    assert usable[tuple(tiles.match.T.astype(int))].all()
    assert np.abs(tiles.image.pixels[..., 3] - (tiles.image.pixels[..., 0] * 3 - 1)).mean() < 0.3


def test_tiles_contain_whole_cells_of_a_lattice() -> None:
    generators = np.array([[13.0, 0], [0.0, 19.0]], np.float32)
    image = stamped(generators, np.random.default_rng(0), (80, 96))
    assert tile_side(36, generators) == (38, pytest.approx(1))
    assert tile_side(36, generators[:1]) == (39, 0.0)
    assert tile_side(36, None) == (36, 0.0)
    borders, tiles = made(image, generators, tile=36)
    assert borders.table["size"] == 38
    phase = np.exp(2j * np.pi * tiles.match.astype(float) @ np.linalg.inv(generators))
    own = np.exp(2j * np.pi * np.moveaxis(np.indices(tiles.match.shape[:2]), 0, 2) / [38 / 3, 19.0])
    assert (np.abs((phase / own).mean(axis=(0, 1))) > 0.9).all()


def test_a_lattice_larger_than_tiles_is_told_and_not_kept(
    exemplar: Image, caplog: pytest.LogCaptureFixture
) -> None:
    """Such as one of the slow tones of wood; tiles were then as small as may be, and grain was cut at borders."""
    large, small = np.array([[70, 0], [0, 90]], np.float32), np.array([[19, 0], [0, 13]], np.float32)
    assert fitting(large, TILE) is None
    assert fitting(small, 38) is small
    assert fitting(small[:0], 38) is None
    params = WangBordersParams(**QUICK, colors=1, tile=TILE, border=BORDER)
    with caplog.at_level(logging.WARNING):
        told, plain = (
            wang_borders(exemplar, params, np.random.default_rng(0), generators=g) for g in (large, None)
        )
    assert f"no tile near {TILE} px contains whole cells of the lattice, which tiles do not keep" in caplog.text
    np.testing.assert_array_equal(told.match, plain.match)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"tile": 36, "border": 10}, "tile: 36 px are too small for borders of 10 px; the minimum is 40 px"),
        ({"tile": 2048, "colors": 3}, "tile: 81 tiles of 2048 px are 339738624 px in all, at most 268435456"),
        ({"tile": 2048, "colors": 1, "variants": (10, 10)}, "tile: 100 tiles of 2048 px are"),
        ({"weights": {"height": 2.0}}, "no map 'height'"),
        ({"patch_size": 32, "tile": 128}, None),
    ],
)
def test_sizes_are_checked(exemplar: Image, params: dict[str, Any], message: str | None) -> None:
    if message is None:
        check_size(WangBordersParams(**params), {"image": exemplar})
        return
    with pytest.raises(InputError, match=re.escape(message)):
        check_size(WangBordersParams(**params), {"image": exemplar})


# -- shaders


def test_variants_have_no_shaders() -> None:
    layout = {"kind": "edges", "colors": 1, "variants": [1, 2], "size": 64}
    with pytest.raises(InputError, match="not among variants"):
        wang_shaders(layout, WangShadersParams())


@pytest.fixture(params=[("edges", 2), ("edges", 3), ("corners", 2), ("corners", 3)], ids=str)
def shaders(request: pytest.FixtureRequest) -> tuple[WangSet, WangShaders]:
    kind, colors = request.param
    return WangSet(colors, kind), wang_shaders({"kind": kind, "colors": colors, "size": 64}, WangShadersParams())


def test_the_glsl_function_chooses_the_tiles_of_the_preview(
    shaders: tuple[WangSet, WangShaders], tmp_path: Path
) -> None:
    """Its integer part is C++ but for the vector type and the array's constructor."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    tiles, made = shaders
    text = re.sub(r"= ivec2\[\d+\]\((.*?)\n\);", r"= {\1};", made.glsl[: made.glsl.index("vec4 wang(")], flags=re.S)
    source = tmp_path / "wang.cpp"
    source.write_text(
        "#include <cstdio>\nusing uint = unsigned int;\n"
        "struct ivec2 { int x, y; ivec2(int a, int b) : x(a), y(b) {} };\n"
        "ivec2 operator+(ivec2 a, ivec2 b) { return ivec2(a.x + b.x, a.y + b.y); }\n" + text + "int main() {\n"
        "  for (int y = -9; y < 9; ++y) for (int x = -9; x < 9; ++x) {\n"
        '    ivec2 place = placeOf(ivec2(x, y)); printf("%d %d ", place.y, place.x);\n  }\n}\n'
    )
    program = tmp_path / "wang"
    subprocess.run([compiler, str(source), "-o", str(program)], check=True)
    printed = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    cells = np.indices((18, 18)) - 9
    expected = tiles.covering(cells[0], cells[1], 0)
    np.testing.assert_array_equal(np.array(printed.split(), int).reshape(18, 18, 2), expected)


def test_the_glsl_text_compiles(shaders: tuple[WangSet, WangShaders], tmp_path: Path) -> None:
    validator = shutil.which("glslangValidator")
    if validator is None:
        pytest.skip("no glslangValidator")
    main = "uniform sampler2D tiles; in vec2 at; out vec4 color; void main() { color = wang(tiles, at); }\n"
    for version in ("330", "300 es\nprecision highp float;"):
        source = tmp_path / "wang.frag"
        source.write_text(f"#version {version}\n{shaders[1].glsl}{main}")
        subprocess.run([validator, str(source)], check=True, capture_output=True)


def test_the_materialx_document_is_valid_and_looks_up_the_atlas(shaders: tuple[WangSet, WangShaders]) -> None:
    tiles, made = shaders
    library, document = MaterialX.createDocument(), MaterialX.createDocument()
    folders, paths = MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(folders, paths, library)
    MaterialX.readFromXmlString(document, made.materialx)
    document.setDataLibrary(library)
    valid, message = document.validate()
    assert valid, message
    graph = document.getNodeGraph("wang_tiles")
    assert graph.getNode("tiles").getInputValue("file") == "tiles.png"
    places = [
        tuple(graph.getNode(f"place_{number // tiles.side}").getInputValue(f"in{number % tiles.side + 1}"))
        for number in range(tiles.side**2)
    ]
    rows, columns = tiles.places.T
    expected = np.stack([columns / tiles.side, 1 - (rows + 1) / tiles.side], axis=1)
    np.testing.assert_allclose(places, expected, atol=1e-6)


def test_a_preview_lays_tiles_side_by_side() -> None:
    atlas = np.arange(16).reshape(4, 4)
    places = np.array([[[1, 0], [0, 1]]])
    np.testing.assert_array_equal(laid(atlas, places, 2), [[8, 9, 2, 3], [12, 13, 6, 7]])
