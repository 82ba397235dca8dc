"""Layouts of materials: what is written is read back as it was."""

from __future__ import annotations

import importlib.util
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from texloom.pipelines.media.conventions import COLORS, LAYOUTS, ROLES, role_of
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import channels_of, write_maps
from texloom.pipelines.media.material_set import holds_one_material, looks_like_one
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.pipelines.media.writers.same import write_same
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL, unit

SIDES = (16, 24)
CHANNELS = (
    *("R", "G", "B", *NORMAL),
    *(role for role in ROLES if role not in (*COLORS, "normal", "mask")),
    *(f"{role}.{letter}" for role in ("emissive", "translucency") for letter in "RGB"),
)
FORMS = [name for name, one in LAYOUTS.items() if one.kind == "png" or importlib.util.find_spec("OpenImageIO")]


@pytest.fixture
def material(rng: np.random.Generator) -> Image:
    """A material with all maps but a mask."""
    pixels = rng.random((*SIDES, len(CHANNELS)), np.float32)
    pixels[..., 3:6] = unit(pixels[..., 3:6] * [2, 2, 1] - [1, 1, -0.2])
    return Image(pixels, CHANNELS)


def without_text(folder: Path) -> None:
    """Leave nothing in PNGs that says what they are."""
    for path in folder.glob("*.png"):
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert values is not None
        assert cv2.imwrite(str(path), values)


@pytest.mark.parametrize("is_silent", [False, True])
@pytest.mark.parametrize("name", FORMS)
def test_what_a_layout_writes_is_read_back(material: Image, tmp_path: Path, name: str, is_silent: bool) -> None:
    layout, folder = LAYOUTS[name], tmp_path / "moss"
    write_layout(material, folder, "moss", Delivery(name), {})
    if is_silent:
        without_text(folder)
    source = open_source("exemplar", str(folder))
    again = source.read()
    held = {
        role_of(plane)[0]: part.bits
        for part in layout.written
        for plane in part.planes
        if plane and channels_of(role_of(plane)[0], material.channels)
    }
    assert {one.role for one in source.maps} == set(held)
    for role, bits in held.items():
        for channel in channels_of(role, material.channels):
            wanted, found = (one.pixels[..., one.channels.index(channel)] for one in (material, again))
            if role == "normal" and not again.facts.of_map(role).green and channel == NORMAL[1]:
                found = found * np.sign((wanted * found).sum())
            if role in COLORS and layout.kind == "png":
                wanted, found = srgb_from_linear(wanted), srgb_from_linear(found)
            most = 2**bits - 1 if layout.kind == "png" else 2**10
            tolerance = (1.2 if role == "normal" else 0.51) / most
            np.testing.assert_allclose(found, wanted, atol=tolerance, err_msg=f"{role} {channel}")


def folder_of(tmp_path: Path, *names: str, colored: str = "") -> Path:
    """Pictures of one size; grey but for ``colored``, separated by spaces."""
    folder = tmp_path / "stones"
    folder.mkdir()
    ramp = np.arange(SIDES[0] * SIDES[1]).reshape(SIDES).astype(np.uint8)
    for name in names:
        color = np.dstack([ramp, ramp // 2, ramp // 3 + 99]) if name in colored.split() else ramp
        assert cv2.imwrite(str(folder / f"{name}.png"), color)
    return folder


def roles(folder: Path) -> dict[str, str]:
    """Stem to the map that it is read as, with its channel."""
    maps = open_source("exemplar", str(folder)).maps
    return {one.role: f"{one.stem.rpartition('_')[2]}{f'.{one.plane}' if one.plane else ''}" for one in maps}


@pytest.mark.parametrize(
    ("names", "colored", "expected"),
    [
        ("T_S_BC T_S_N T_S_D", "T_S_BC T_S_N", {"albedo": "BC", "normal": "N", "height": "D"}),
        ("s_d s_n s_r", "s_d s_n", {"albedo": "d", "normal": "n", "roughness": "r"}),
        ("s_d s_n s_r s_m", "s_d s_n", {"albedo": "d", "normal": "n", "roughness": "r", "metallic": "m"}),
        ("T_S_D T_S_N T_S_M", "T_S_D T_S_N", {"albedo": "D", "normal": "N", "metallic": "M"}),
        ("s s_n s_s", "s s_n", {"albedo": "s", "normal": "n", "specular": "s"}),
        (
            "s_Base_Color s_Normal_OpenGL s_Normal_DirectX s_Roughness",
            "s_Base_Color s_Normal_OpenGL s_Normal_DirectX",
            {"albedo": "Color", "normal": "OpenGL", "roughness": "Roughness"},
        ),
        ("s_d s_n s_o s_s", "s_d s_n", {"albedo": "d", "normal": "n", "ao": "o", "specular": "s"}),
        (
            "T_S_B T_S_N T_S_DpRA",
            "T_S_B T_S_N T_S_DpRA",
            {"albedo": "B", "normal": "N", "roughness": "DpRA.G", "ao": "DpRA.B", "height": "DpRA.R"},
        ),
        (
            "s_diff s_nor s_ao s_rough_ao",
            "s_diff s_nor s_rough_ao",
            {"albedo": "diff", "normal": "nor", "ao": "ao", "roughness": "ao.R"},
        ),
        (
            "s_diff s_nor s_rough_ao",
            "s_diff s_nor s_rough_ao",
            {"albedo": "diff", "normal": "nor", "roughness": "ao.R", "ao": "ao.G"},
        ),
        ("s_rough_dif s_rough_ao", "s_rough_dif", {"albedo": "dif", "ao": "ao"}),
        ("s_Color s_Preview1 s_depth", "s_Color s_Preview1", {"albedo": "Color", "height": "depth"}),
        ("normal_moss albedo_moss", "normal_moss albedo_moss", {"albedo": "moss", "normal": "moss"}),
        (
            "s_COL_VAR1_3K s_COL_VAR2_3K s_NRM_3K",
            "s_COL_VAR1_3K s_COL_VAR2_3K s_NRM_3K",
            {"albedo": "3K", "normal": "3K"},
        ),
        (
            "s_COL s_NRM s_NRM16 s_DISP s_DISP16",
            "s_COL s_NRM s_NRM16",
            {"albedo": "COL", "normal": "NRM16", "height": "DISP16"},
        ),
    ],
)
def test_names_of_a_folder_are_read_together(
    tmp_path: Path, names: str, colored: str, expected: dict[str, str]
) -> None:
    assert roles(folder_of(tmp_path, *names.split(), colored=colored)) == expected


def test_maps_of_several_materials_are_refused_with_what_each_would_be(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "a_wall_d", "a_wall_n", "B_d", "B_n", "B_r", colored="a_wall_d a_wall_n B_d B_n")
    with pytest.raises(InputError, match=r"holds maps of 2 materials") as raised:
        open_source("exemplar", str(folder))
    assert "B.yaml {albedo: B_d.png, normal: B_n.png, roughness: B_r.png}" in str(raised.value)
    assert "a_wall.yaml {albedo: a_wall_d.png, normal: a_wall_n.png}" in str(raised.value)


def test_names_of_any_script_tell_materials_apart(tmp_path: Path) -> None:
    names = ("石_d", "石_n", "木_d", "木_n")
    with pytest.raises(InputError, match=r"石\.yaml {albedo: 石_d\.png, normal: 石_n\.png}"):
        open_source("exemplar", str(folder_of(tmp_path, *names, colored=" ".join(names))))


def test_of_several_resolutions_the_largest_is_read(tmp_path: Path) -> None:
    names = ("s_058_1K-JPG_Color", "s_058_1K-JPG_Roughness", "s_058_2K-PNG_Color", "s_058_2K-PNG_NormalGL")
    folder = folder_of(tmp_path, *names, colored="s_058_1K-JPG_Color s_058_2K-PNG_Color s_058_2K-PNG_NormalGL")
    source = open_source("exemplar", str(folder))
    assert [one.stem for one in source.maps] == [names[2], names[3], names[1]]
    assert "s_058_1K-JPG_Color.png not read: the same maps are there with more pixels" in source.notes[0]


@pytest.mark.parametrize("name", ["AlbedoSmoothness", "diffuse_gloss", "SpecularSmoothness", "normal_roughness"])
def test_a_map_in_the_alpha_of_another_is_read_and_written_back(
    tmp_path: Path, rng: np.random.Generator, name: str
) -> None:
    folder = folder_of(tmp_path, "s_color" if name[0] in "Sn" else "s_normal", colored="s_color s_normal")
    both = rng.integers(100, 256, (*SIDES, 4)).astype(np.uint8)
    assert cv2.imwrite(str(folder / f"s_{name}.png"), both)
    source = open_source("exemplar", str(folder))
    roughness = next(one for one in source.maps if one.role == "roughness")
    assert (roughness.stem, roughness.plane, roughness.inverted) == (f"s_{name}", "A", "rough" not in name)
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    again = cv2.imread(str(tmp_path / "out" / f"s_{name}.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(again, both)


def test_channels_that_hold_nothing_are_written_back(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = folder_of(tmp_path, "s_albedo", "s_MetallicSmoothness", "s_orm", colored="s_albedo")
    grey = cv2.imread(str(folder / "s_orm.png"))
    packed = np.dstack([grey[..., 0] * 0 + 99, *[grey[..., 0]] * 2, 255 - grey[..., 0]])
    assert cv2.imwrite(str(folder / "s_MetallicSmoothness.png"), packed)
    (folder / "s_orm.png").unlink()
    source = open_source("exemplar", str(folder))
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    again = cv2.imread(str(tmp_path / "out" / "s_MetallicSmoothness.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(again, packed)
    assert not caplog.text


def test_names_in_doubt_are_refused_with_what_they_may_be(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "s_d", "s_n", "s_m", colored="s_d s_n")
    with pytest.raises(InputError) as caught:
        open_source("exemplar", str(folder))
    assert "has names that leave doubt: s_m.png (metallic or mask); if these are one material" in str(caught.value)
    assert "{albedo: s_d.png, normal: s_n.png, metallic: s_m.png}" in str(caught.value)


def test_files_of_unknown_names_but_one_material_are_no_set(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "s_tint", "s_slope")
    assert looks_like_one(folder)
    with pytest.raises(InputError, match=r"has no albedo .* write stones/stones\.yaml with its maps, as {albedo"):
        open_source("exemplar", str(folder))
    for path in folder.iterdir():
        path.rename(path.with_name(f"s_{len(path.stem)}.png"))
    assert not looks_like_one(folder)


def test_channels_in_yaml(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, "color", "packed", colored="color packed")
    listing = folder / "stones.yaml"
    listing.write_text("{albedo: color.png, roughness: {file: packed.png, channel: G, invert: true}, gloss: x.png}")
    with pytest.raises(InputError, match="gloss: there is a file for roughness already"):
        open_source("exemplar", str(listing))
    listing.write_text("{albedo: color.png, roughness: {file: packed.png, channel: G, invert: true}}")
    image = open_source("exemplar", str(listing)).read()
    packed = cv2.imread(str(folder / "packed.png"))
    np.testing.assert_allclose(image.pixels[..., 3], 1 - packed[..., 1] / 255, atol=1e-6)
    listing.write_text("{albedo: color.png, roughness: {file: packed.png, channel: A}}")
    with pytest.raises(InputError, match=r"roughness: packed\.png has no channel A"):
        open_source("exemplar", str(listing))


def test_udim_tiles_are_read_as_one(material: Image, tmp_path: Path) -> None:
    write_layout(material, tmp_path / "whole", "moss", Delivery("unreal"), {})
    write_layout(material, tmp_path / "tiles", "moss", Delivery("unreal", udim=(2, 3)), {})
    whole, tiles = (open_source("exemplar", str(tmp_path / name)).read() for name in ("whole", "tiles"))
    np.testing.assert_array_equal(whole.pixels, tiles.pixels)
    (tmp_path / "tiles" / "T_moss_H.1012.png").unlink()
    with pytest.raises(
        InputError, match=r"T_moss_H\.<UDIM>\.png: tiles are missing: 1012; they have to fill 3 x 2"
    ):
        open_source("exemplar", str(tmp_path / "tiles"))


@pytest.mark.parametrize("name", [name for name, one in LAYOUTS.items() if one.kind == "png"])
def test_the_layout_of_the_exemplar_is_written_back(material: Image, tmp_path: Path, name: str) -> None:
    folder, out = tmp_path / "moss", tmp_path / "out"
    write_layout(material, folder, "moss", Delivery(name), {})
    source = open_source("exemplar", str(folder))
    write_same(source.read(), out, source.maps, Delivery("same"), {})
    pictures = [path for path in folder.iterdir() if path.suffix == ".png"]
    assert {path.name for path in out.iterdir()} == {path.name for path in pictures}
    for path in pictures:
        before, after = (cv2.imread(str(one), cv2.IMREAD_UNCHANGED) for one in (path, out / path.name))
        np.testing.assert_array_equal(before, after, err_msg=path.name)
    # and without it, packed and inverted files become one for each map, which mean the same
    write_maps(source.read(), tmp_path / "maps", source.maps, {})
    again = open_source("exemplar", str(tmp_path / "maps")).read()
    assert again.channels == source.channels
    np.testing.assert_allclose(again.pixels, source.read().pixels, atol=1.2 / 255)


@pytest.mark.skipif("arnold" not in FORMS, reason="needs OpenImageIO")
def test_textures_of_renderers_are_written_back(material: Image, tmp_path: Path) -> None:
    write_layout(material, tmp_path / "moss", "moss", Delivery("arnold"), {})
    source = open_source("exemplar", str(tmp_path / "moss"))
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    again = open_source("exemplar", str(tmp_path / "out"))
    assert [one.stem for one in again.maps] == [one.stem for one in source.maps]
    np.testing.assert_allclose(again.read().pixels, source.read().pixels, atol=1e-6)


def test_maps_that_a_layout_has_no_file_for_are_counted(
    material: Image, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_layout(material, tmp_path / "moss", "moss", Delivery("unreal"), {})
    assert caplog.messages[-1] == "4 maps are not part of layout unreal: bump, cavity, translucency, fuzz"
    write_layout(material, tmp_path / "all", "moss", Delivery("plain"), {})
    assert len(caplog.messages) == 1


def test_variants_of_colour_that_were_not_read_are_not_written(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = ("m_COL_VAR1", "m_COL_VAR2", "m_NRM")
    source = open_source("exemplar", str(folder_of(tmp_path, *names, colored=" ".join(names))))
    assert set(write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})) == {
        "m_COL_VAR1.png",
        "m_NRM.png",
    }
    assert "m_COL_VAR2.png: not written, as its colours were not read" in caplog.text


def test_gloss_beside_roughness_and_both_normals_are_written_back(tmp_path: Path) -> None:
    names = ("m_Albedo", "m_Normal", "m_Roughness", "m_Gloss", "m_NormalDX")
    folder = folder_of(tmp_path, *names, colored="m_Albedo m_Normal m_NormalDX")
    (folder / "m_NormalDX.png").unlink()
    normal = cv2.imread(str(folder / "m_Normal.png"))
    assert cv2.imwrite(str(folder / "m_NormalDX.png"), normal * [1, -1, 1] + [0, 255, 0])
    rough = cv2.imread(str(folder / "m_Roughness.png"), cv2.IMREAD_UNCHANGED)
    source = open_source("exemplar", str(folder))
    out = tmp_path / "out"
    assert set(write_same(source.read(), out, source.maps, Delivery("same"), {})) == {
        f"{name}.png" for name in names
    }
    np.testing.assert_array_equal(cv2.imread(str(out / "m_Gloss.png"), cv2.IMREAD_UNCHANGED), 255 - rough)


@pytest.mark.parametrize("suffix", ["tga", "dds", "webp", "bmp", "jp2", "tif", "avif", "jpg", "psd", "gif"])
def test_maps_are_written_back_in_their_formats(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    folder = tmp_path / "m"
    folder.mkdir()
    ramp = np.add.outer(np.arange(SIDES[0]), 3 * np.arange(SIDES[1])).astype(np.uint8)
    for role, levels in {
        "albedo": np.dstack([ramp, ramp // 2, ramp // 3 + 99]),
        "orm": np.dstack([ramp] * 3),
    }.items():
        picture = PIL.Image.fromarray(levels)
        if suffix == "psd":
            (folder / f"m_{role}.psd").write_bytes(psd_of(levels))
        else:
            picture.save(folder / f"m_{role}.{suffix}")
    source = open_source("exemplar", str(folder))
    written = set(write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {}))
    end = "png" if suffix in ("psd", "gif") else suffix
    assert written == {f"m_albedo.{end}", f"m_orm.{end}"}
    assert ("m_orm.psd: written as m_orm.png" in caplog.text) == (suffix == "psd")
    again = open_source("exemplar", str(tmp_path / "out"))
    assert again.map_bits == source.map_bits
    lossy = {"jpg": 0.05, "avif": 0.05}.get(suffix, 1e-6)
    np.testing.assert_allclose(again.read().pixels, source.read().pixels, atol=lossy)


def test_blocks_of_dds_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "m").mkdir()
    levels = PIL.Image.fromarray(np.full((16, 16, 3), 128, np.uint8))
    levels.convert("RGBA").save(tmp_path / "m" / "albedo.dds", pixel_format="DXT1")
    levels.save(tmp_path / "m" / "normal.dds")
    source = open_source("exemplar", str(tmp_path / "m"))
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    assert [record.getMessage()[:32] for record in caplog.records] == ["albedo.dds: written uncompressed"]


@pytest.mark.parametrize(("mode", "name", "suffix"), [("CMYK", "CMYK", "jpg"), ("LAB", "Lab", "tif")])
def test_colours_of_print_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, mode: str, name: str, suffix: str
) -> None:
    folder = folder_of(tmp_path, "s_roughness")
    levels = np.full((*SIDES, 4 if mode == "CMYK" else 3), 128, np.uint8)
    PIL.Image.fromarray(levels, mode).save(folder / f"s_albedo.{suffix}")
    source = open_source("exemplar", str(folder))
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    assert caplog.messages == [f"s_albedo.{suffix}: written in sRGB, as {name} is only read"]


def test_palettes_and_few_bits_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = folder_of(tmp_path, "s_height")
    greys = PIL.Image.fromarray(np.arange(np.prod(SIDES)).reshape(SIDES).astype(np.uint8))
    greys.convert("P").save(folder / "s_albedo.png")
    greys.convert("1").save(folder / "s_opacity.tif")
    (folder / "s_roughness.png").write_bytes(png_of_4_bits(*SIDES))
    source = open_source("exemplar", str(folder))
    write_same(source.read(), tmp_path / "out", source.maps, Delivery("same"), {})
    assert set(caplog.messages) == {
        "s_albedo.png: written in RGB, as palettes are only read",
        "s_opacity.tif: written in 8 bits, as 1 bit is only read",
        "s_roughness.png: written in 8 bits, as 4 bits are only read",
    }


def png_of_4_bits(height: int, width: int) -> bytes:
    """A grey PNG, black."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">2I5B", width, height, 4, 0, 0, 0, 0)
    lines = zlib.compress(bytes(height * (1 + -(-width // 2))))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", lines) + chunk(b"IEND", b"")


def psd_of(levels: np.ndarray) -> bytes:
    """A PSD of 8-bit colour without layers, (h, w, 3)."""
    height, width, planes = levels.shape
    head = struct.pack(">4sH6xHIIHH", b"8BPS", 1, planes, height, width, 8, 3)
    return head + bytes(4 * 3 + 2) + np.moveaxis(levels, 2, 0).tobytes()


@pytest.mark.parametrize(("letters", "roles"), [("dh", "albedo height"), ("dhm", ""), ("dr", "albedo roughness")])
def test_letters_alone_are_maps_where_one_file_has_colour(tmp_path: Path, letters: str, roles: str) -> None:
    """A metallic map or a mask leave doubt, and what is numbered by letters is no material."""
    grey = np.arange(400, dtype=np.uint8).reshape(20, 20)
    for letter in letters:
        picture = np.dstack([grey, grey, 255 - grey]) if letter == "d" else grey
        assert cv2.imwrite(str(tmp_path / f"x_{letter}.png"), picture)
    if roles:
        assert " ".join(one.role for one in open_source("exemplar", str(tmp_path)).maps) == roles
    else:
        with pytest.raises(InputError, match=r"x_m\.png \(metallic or mask\)"):
            open_source("exemplar", str(tmp_path))
    for path in list(tmp_path.iterdir()):
        assert cv2.imwrite(str(path), np.dstack([grey, grey, 255 - grey]))
    assert not holds_one_material(tmp_path)
