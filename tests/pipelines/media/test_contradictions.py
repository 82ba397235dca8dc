"""Conventions that the content of maps contradicts, on surfaces whose truth is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter

from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.sources import SourceError, open_source
from texloom.pipelines.media.writers.same import write_same
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear

SIDES = (96, 112)


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Heights, 0..1, and their normals, green up."""
    height = gaussian_filter(np.random.default_rng(5).random(SIDES), 3, mode="wrap")
    height = (height - height.min()) / np.ptp(height)
    down, across = (np.roll(height, -1, axis) - np.roll(height, 1, axis) for axis in (0, 1))
    normals = np.dstack([-5 * across, 5 * down, np.ones(SIDES)])
    return height, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def told(folder: Path, normal: np.ndarray | None = None, **maps: np.ndarray) -> tuple[str, ...]:
    """What is told of a material of these maps, 0..1; of vectors -1..1 for normals."""
    rng = np.random.default_rng(1)
    folder.mkdir()
    maps |= {"albedo": rng.random((*SIDES, 3))}
    if normal is not None:
        maps["normal"] = (normal + 1) / 2
    for name, values in maps.items():
        codes = np.rint(values * 255).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"{name}.png"), codes[..., ::-1] if codes.ndim == 3 else codes)
    return tuple(note.partition(f"{folder}: ")[2] for note in open_source("exemplar", str(folder)).notes)


@pytest.mark.parametrize("with_height", [True, False])
def test_green_by_slopes_of_heights_or_alone(tmp_path: Path, with_height: bool) -> None:
    height, normal = surface()
    maps = {"height": height} if with_height else {}
    assert told(tmp_path / "gl", normal, **maps) == ()
    (note,) = told(tmp_path / "dx", normal * [1, -1, 1], **maps)
    measure = "by the slopes of the height" if with_height else "as its slopes are those of a surface only so"
    assert note.startswith(f"normal.png: green of normals points down {measure}, and is read so")
    assert "'normal_convention: opengl' in a YAML file" in note
    (tmp_path / "dx" / "normal.png").rename(tmp_path / "dx" / "normal_dx.png")
    assert open_source("exemplar", str(tmp_path / "dx")).notes == ()


@pytest.mark.parametrize("points", ["down", "up"])
def test_content_decides_green_that_only_names_of_other_maps_imply(tmp_path: Path, points: str) -> None:
    height, normal = surface()
    folder, right = tmp_path / "stones", normal * [1, 1 if points == "up" else -1, 1]
    told(folder, right, height=height)
    for path in folder.iterdir():
        suffix = {"albedo": "BC", "normal": "N", "height": "H"}[path.stem]
        path.rename(folder / f"T_Stones_{suffix}.png")
    source = open_source("exemplar", str(folder))
    (note,) = source.notes
    assert "T_Stones_N.png: green of normals points down in names as of Unreal Engine" in note
    assert ("clearly points up by the slopes" in note and "'normal_convention: directx'" in note) == (
        points == "up"
    )
    assert next(one for one in source.maps if one.role == "normal").facts.green == points
    image = source.read()
    y = image.pixels[..., image.channels.index("normal.Y")]
    np.testing.assert_allclose(y, normal[..., 1], atol=0.02)
    (folder / "T_Stones_N.png").rename(folder / "T_Stones_N_dx.png")  # a name of its own is believed
    assert next(one for one in open_source("exemplar", str(folder)).maps if one.role == "normal").directx


@pytest.mark.parametrize("red", ["white", "green"])
def test_normals_with_x_in_alpha(tmp_path: Path, red: str) -> None:
    height, normal = surface()
    folder = tmp_path / "stones"
    told(folder, normal, height=height)
    x, y = np.rint((np.moveaxis(normal[..., :2], 2, 0) + 1) / 2 * 255).astype(np.uint8)
    rest = np.full_like(y, 255) if red == "white" else y
    packed = np.dstack([rest, y, rest, x])  # blue first
    assert cv2.imwrite(str(folder / "normal.png"), packed)
    source = open_source("exemplar", str(folder))
    assert [note.rpartition(": ")[2] for note in source.notes] == [
        "x is read from alpha, y from green (DXT5nm), and z was rebuilt from them"
    ]
    image = source.read()
    planes = [image.channels.index(f"normal.{axis}") for axis in "XYZ"]
    np.testing.assert_allclose(image.pixels[..., planes], normal, atol=0.03)
    write_same(image, tmp_path / "same", source.maps, Delivery("same"), {})
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "same" / "normal.png"), cv2.IMREAD_UNCHANGED), packed)


def test_channels_that_are_not_read_are_told(tmp_path: Path) -> None:
    height, normal = surface()
    folder = tmp_path / "stones"
    told(folder, normal, height=height)
    codes, alpha = np.rint((normal[..., ::-1] + 1) / 2 * 255), np.rint(height * 255)
    assert cv2.imwrite(str(folder / "normal.png"), np.dstack([codes, alpha]).astype(np.uint8))
    mask = np.dstack([height, 0 * height, height, 1 - height])  # blue first
    assert cv2.imwrite(str(folder / "MaskMap.png"), np.rint(mask * [128, 255, 255, 255]).astype(np.uint8))
    notes = [note.partition(f"{folder}: ")[2] for note in open_source("exemplar", str(folder)).notes]
    assert any(note.startswith("normal.png: A not read; in a YAML file") for note in notes)
    assert any(note.startswith("MaskMap.png: B not read") for note in notes)
    assert cv2.imwrite(str(folder / "normal.png"), np.dstack([codes, 0 * alpha + 255]).astype(np.uint8))
    assert not any("normal.png: A" in note for note in open_source("exemplar", str(folder)).notes)


def test_what_alpha_excludes_is_told_unless_it_is_a_map(tmp_path: Path) -> None:
    height, _ = surface()
    folder = tmp_path / "stones"
    told(folder)
    albedo = np.dstack([cv2.imread(str(folder / "albedo.png")), np.rint(height * 255).astype(np.uint8)])
    assert cv2.imwrite(str(folder / "albedo.png"), albedo)
    (note,) = open_source("exemplar", str(folder)).notes
    assert f"albedo.png: alpha is below a half in {100 * (height < 0.5).mean():.2g} % of the pixels" in note
    (folder / "m.yaml").write_text("{albedo: albedo.png, gloss: {file: albedo.png, channel: A}}")
    source = open_source("exemplar", str(folder / "m.yaml"))
    assert not source.notes
    image = source.read()
    assert image.channels == ("R", "G", "B", "roughness")
    np.testing.assert_allclose(image.pixels[..., 3], 1 - albedo[..., 3] / 255, atol=1e-6)
    write_same(image, tmp_path / "same", source.maps, Delivery("same"), {})
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "same" / "albedo.png"), -1), albedo)


def test_udim_tiles_are_measured_as_one(tmp_path: Path) -> None:
    height, normal = surface()
    told(tmp_path / "dx", normal * [1, -1, 1], height=height)
    for path in list((tmp_path / "dx").iterdir()):
        whole = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert whole is not None
        path.unlink()
        for number, half in zip((1001, 1002), np.split(whole, 2, axis=1), strict=True):
            assert cv2.imwrite(str(path.with_suffix(f".{number}.png")), half)
    source = open_source("exemplar", str(tmp_path / "dx"))
    assert (source.height, source.width) == SIDES
    assert len(source.notes) == 1
    assert "green of normals points down by the slopes" in source.notes[0]


def test_a_depth_and_gloss_are_told(tmp_path: Path) -> None:
    height, normal = surface()
    (note,) = told(tmp_path / "depth", normal, height=1 - height)
    assert note.startswith("height: seems to be inverted")
    assert "height: {file: NAME, invert: true}" in note
    assert told(tmp_path / "rough", roughness=height, specular=1 - height) == ()
    (note,) = told(tmp_path / "gloss", roughness=height, specular=height)
    assert note.startswith("roughness: seems to be gloss")


@pytest.mark.parametrize("blue", [-1, 0, 1])
def test_normals_of_two_channels_are_rebuilt(tmp_path: Path, blue: int) -> None:
    height, normal = surface()
    (note,) = told(tmp_path / "two", np.dstack([normal[..., :2], np.full(SIDES, blue)]), height=height)
    assert note.startswith("normal: the third channel is empty; z was rebuilt")
    image = open_source("exemplar", str(tmp_path / "two")).read()
    planes = [image.channels.index(f"normal.{axis}") for axis in "XYZ"]
    np.testing.assert_allclose(image.pixels[..., planes], normal, atol=0.04)
    assert image.pixels[..., planes[2]].min() > 0


def test_content_that_does_not_tell_green_leaves_it_up_and_that_is_told(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).normal(size=(*SIDES, 3)) * [0.2, 0.2, 0] + [0, 0, 1]
    (note,) = told(tmp_path / "noise", noise / np.linalg.norm(noise, axis=2, keepdims=True))
    assert note.startswith("normal.png: green of normals is assumed to point up, as nothing says it")


def test_a_name_of_depth_is_read_inverted(tmp_path: Path) -> None:
    height, normal = surface()
    (note,) = told(tmp_path / "depth", normal, depth=1 - height)
    assert note == "depth.png read as 1-height"
    (_, note) = told(tmp_path / "height", normal, depth=height)
    assert "height: {file: NAME, invert: false}" in note


def test_flat_normals_stay(tmp_path: Path) -> None:
    flat = np.zeros((*SIDES, 3))
    flat[..., 2] = 1
    assert told(tmp_path / "flat", flat) == ()


def test_normals_through_a_curve_and_pictures_that_are_none(tmp_path: Path) -> None:
    _, normal = surface()
    (note,) = told(tmp_path / "curve", np.asarray(srgb_from_linear((normal + 1) / 2)) * 2 - 1)
    assert note.startswith("normal: an sRGB curve seems to have been put on (lengths of vectors")
    assert any(
        "is this file one?" in note for note in told(tmp_path / "none", np.full((*SIDES, 3), 0.2) * surface()[1])
    )
    inside = normal * [1, 1, -1]
    assert any("z is not positive in 100 %" in note for note in told(tmp_path / "inside", inside))


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("role", ["height", "depth"])
def test_heights_through_a_curve_by_their_slopes(tmp_path: Path, bits: int, role: str) -> None:
    height, normal = surface()
    stored = height if role == "height" else 1 - height
    told(tmp_path / "a", normal, **{role: stored})
    most = 2**bits - 1
    for curve, what in ((srgb_from_linear, "put on"), (linear_from_srgb, "taken off"), (np.asarray, "")):
        codes = np.rint(np.asarray(curve(stored)) * most).astype(np.uint8 if bits == 8 else np.uint16)
        assert cv2.imwrite(str(tmp_path / "a" / f"{role}.png"), codes)
        found = [note for note in open_source("exemplar", str(tmp_path / "a")).notes if "sRGB curve" in note]
        assert len(found) == bool(what)
        assert all(f"height: an sRGB curve seems to have been {what} (slopes fit" in note for note in found)


def test_data_through_a_curve_by_their_levels(tmp_path: Path) -> None:
    height, _ = surface()
    levels = np.rint((0.1 + 0.8 * height) * 255) / 255
    for curve, what in ((srgb_from_linear, "put on"), (linear_from_srgb, "taken off")):
        found = told(tmp_path / what, roughness=np.asarray(curve(levels)), metallic=levels)
        assert list(found) == [
            f"roughness: an sRGB curve seems to have been {what} (some levels hold twice the pixels of others, as "
            "such a curve leaves them); in a YAML file of maps "
            + f"'roughness: {{file: roughness.png, curve: {'srgb' if what == 'put on' else 'inverse_srgb'}}}' "
            + ("takes it off" if what == "put on" else "puts it on again")
        ]


@pytest.mark.parametrize("made", ["at 16 bits", "of 8 bits", "floats"])
@pytest.mark.parametrize("name", ["srgb", "inverse_srgb"])
def test_data_of_more_bits_through_a_curve_and_what_undoes_it(tmp_path: Path, name: str, made: str) -> None:
    height, _ = surface()
    folder = tmp_path / "stones"
    told(folder)
    most = 2**16 - 1 if made == "at 16 bits" else 255
    levels = np.rint((0.05 + 0.8 * height) * most) / most  # gloss
    curve = srgb_from_linear if name == "srgb" else linear_from_srgb

    def write(values: np.ndarray) -> Path:
        if made == "floats":
            path = folder / "gloss.tif"
            tifffile.imwrite(path, values.astype(np.float16).astype(np.float32))
        else:
            path = folder / "gloss.png"
            assert cv2.imwrite(str(path), np.rint(values * 65535).astype(np.uint16))
        return path

    write(levels)
    assert [note for note in open_source("exemplar", str(folder)).notes if "curve" in note] == []
    path = write(np.asarray(curve(levels)))
    (note,) = [note for note in open_source("exemplar", str(folder)).notes if "curve" in note]
    assert f"roughness: an sRGB curve seems to have been {'put on' if name == 'srgb' else 'taken off'}" in note
    entry = f"roughness: {{file: {path.name}, invert: true, curve: {name}}}"
    assert f"'{entry}'" in note

    (folder / "m.yaml").write_text(f"{{albedo: albedo.png, {entry}}}")
    source = open_source("exemplar", str(folder / "m.yaml"))
    assert source.notes == ()
    image = source.read()
    np.testing.assert_allclose(image.pixels[..., 3], 1 - levels, atol=2e-3 if made == "floats" else 2e-4)
    write_same(image, tmp_path / "same", source.maps, Delivery("same"), {})
    read = tifffile.imread if made == "floats" else lambda one: cv2.imread(str(one), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(read(tmp_path / "same" / path.name), read(path), rtol=1e-3, atol=1e-3)


def test_normals_and_colours_without_a_curve_that_yaml_names(tmp_path: Path) -> None:
    _, normal = surface()
    folder = tmp_path / "stones"
    told(folder, np.asarray(srgb_from_linear((normal * [1, -1, 1] + 1) / 2)) * 2 - 1)
    (folder / "m.yaml").write_text(
        "{albedo: {file: albedo.png, curve: inverse_srgb}, normal_dx: {file: normal.png, curve: srgb}}"
    )
    source = open_source("exemplar", str(folder / "m.yaml"))
    assert source.notes == ()
    image = source.read()
    codes = cv2.imread(str(folder / "albedo.png"))[..., ::-1]
    np.testing.assert_allclose(image.pixels[..., :3], codes / 255, atol=1e-6)
    np.testing.assert_allclose(image.pixels[..., 3:], normal, atol=0.02)
    write_same(image, tmp_path / "same", source.maps, Delivery("same"), {})
    for name in ("albedo.png", "normal.png"):
        was, is_now = (cv2.imread(str(place / name)).astype(int) for place in (folder, tmp_path / "same"))
        assert np.abs(was - is_now).max() <= (name == "normal.png")


def test_a_curve_of_values_outside_the_range_is_refused(tmp_path: Path) -> None:
    told(tmp_path / "stones")
    tifffile.imwrite(tmp_path / "stones" / "height.tif", surface()[0].astype(np.float32) - 0.5)
    (tmp_path / "stones" / "m.yaml").write_text("{albedo: albedo.png, height: {file: height.tif, curve: srgb}}")
    with pytest.raises(SourceError, match=r"height.tif has values outside 0..1"):
        open_source("exemplar", str(tmp_path / "stones" / "m.yaml")).read()
    (tmp_path / "stones" / "m.yaml").write_text("{albedo: albedo.png, height: {file: height.tif, curve: sRGB}}")
    with pytest.raises(SourceError, match=r"height.curve: must be srgb or inverse_srgb, got 'sRGB'"):
        open_source("exemplar", str(tmp_path / "stones" / "m.yaml"))
