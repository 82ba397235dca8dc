"""Colour spaces of sources: profiles and chromaticities are honoured, or refused by one line."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageCms
import PIL.PngImagePlugin
import pytest

from tests.pipelines.media.test_sources import exr, planes, problem, read
from tests.pipelines.pictures import chunk, png
from texloom.pipelines.media import color_spaces, icc, locate
from texloom.pipelines.media.color_spaces import ACESCG, PRIMARIES, REC709, conversion
from texloom.pipelines.media.sources import open_source
from texloom.stages.vocabulary.color import srgb_from_linear

P3 = PRIMARIES["lin_p3d65_scene"]
ADOBE = PRIMARIES["lin_adobergb_scene"]


def profile(primaries: tuple[float, ...], curve: bytes, space: bytes = b"RGB ") -> bytes:
    """An ICC profile written by hand."""
    columns = color_spaces._to_d50(primaries).T
    tags = {b"wtpt": struct.pack(">4s4x3i", b"XYZ ", 63190, 65536, 54061)}
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        for name, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True):
            tags[name] = struct.pack(">4s4x3i", b"XYZ ", *(round(value * 65536) for value in xyz))
        tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve)
    tags[b"desc"] = struct.pack(">4s4xI12s67x", b"desc", 5, b"hand")
    tags[b"cprt"] = b"text\0\0\0\0none\0\0\0\0"
    offset, table, content = 132 + 12 * len(tags), b"", b""
    for name, value in tags.items():
        padded = value + bytes(-len(value) % 4)
        table += struct.pack(">4sII", name, offset + len(content), len(value))
        content += padded
    head = struct.pack(">I4sI4s4s4s12s4s28s", 132 + len(table + content), b"", 0x02100000, b"mntr", space, b"XYZ ",
                       bytes(12), b"acsp", bytes(28))  # fmt: skip
    head += struct.pack(">3i", 63190, 65536, 54061)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + content


GAMMA = struct.pack(">4s4xIH", b"curv", 1, round(2.2 * 256))
SRGB_CURVE = struct.pack(
    ">4s4xHxx5i", b"para", 3, *(round(v * 65536) for v in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
)


def save(path: Path, values: np.ndarray, content: bytes | None = None, **options: object) -> Path:
    PIL.Image.fromarray(values).save(path, icc_profile=content, **options)
    return path


@pytest.fixture
def values(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, (12, 9, 3)).astype(np.uint8)


def test_matrices_are_those_that_are_published() -> None:
    # ACES: linear Rec.709 (D65) to ACEScg, by Bradford
    published = [[0.6131, 0.3395, 0.0474], [0.0702, 0.9164, 0.0135], [0.0206, 0.1096, 0.8698]]
    np.testing.assert_allclose(conversion(PRIMARIES[REC709], PRIMARIES[ACESCG]), published, atol=1e-4)
    both = conversion(P3, ADOBE) @ conversion(ADOBE, P3)
    np.testing.assert_allclose(both, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("suffix", ["png", "tif", "webp"])
def test_srgb_profiles_change_no_bit(tmp_path: Path, values: np.ndarray, suffix: str) -> None:
    known = PIL.ImageCms.ImageCmsProfile(PIL.ImageCms.createProfile("sRGB")).tobytes()
    options = {"lossless": True} if suffix == "webp" else {}
    plain = read(save(tmp_path / f"plain.{suffix}", values, **options))
    for name, content in (("own", profile(PRIMARIES[REC709], SRGB_CURVE)), ("pillow", known)):
        tagged = read(save(tmp_path / f"{name}.{suffix}", values, content, **options))
        np.testing.assert_array_equal(tagged.pixels, plain.pixels)


@pytest.mark.parametrize(("primaries", "curve"), [(P3, SRGB_CURVE), (ADOBE, GAMMA), (PRIMARIES[REC709], GAMMA)])
def test_profiles_are_honoured_as_littlecms_does(
    tmp_path: Path, values: np.ndarray, primaries: tuple[float, ...], curve: bytes
) -> None:
    content = profile(primaries, curve)
    image = read(save(tmp_path / "tagged.png", values, content))
    picture = PIL.Image.fromarray(values)
    target = PIL.ImageCms.createProfile("sRGB")
    expected = PIL.ImageCms.profileToProfile(picture, PIL.ImageCms.ImageCmsProfile(io.BytesIO(content)), target)
    found = np.rint(srgb_from_linear(image.pixels) * 255)
    assert np.abs(found - np.asarray(expected, float)).max() <= 2
    assert np.abs(found - values).max() > 4


def test_grey_profiles(tmp_path: Path, values: np.ndarray) -> None:
    linear = struct.pack(">4s4xI", b"curv", 0)
    image = read(save(tmp_path / "grey.png", values[..., 0], profile(P3, linear, b"GRAY")))
    np.testing.assert_allclose(image.pixels[..., 0], values[..., 0] / 255, rtol=1e-6)


def test_tables_of_curves() -> None:
    table = struct.pack(">4s4xI3H", b"curv", 3, 0, 65535 // 4, 65535)
    decoding = icc.of_profile(profile(PRIMARIES[REC709], table), 3)
    assert decoding is not None
    codes = np.array([0, 128, 255], np.uint8).reshape(1, 3, 1).repeat(3, axis=2)
    np.testing.assert_allclose(decoding.linear(codes)[0, :, 0], [0, 0.253, 1], atol=0.002)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"nothing", "has a broken ICC profile"),
        (profile(P3, b"curv\0\0\0\0\0\0\xff\xff"), "has a broken ICC profile"),
        (profile(P3, GAMMA, b"CMYK"), "has an ICC profile (CMYK) that is no matrix with curves"),
        (profile(P3, GAMMA, b"GRAY"), "has an ICC profile (GRAY)"),
    ],
)
def test_profiles_that_are_not_read(tmp_path: Path, values: np.ndarray, content: bytes, words: str) -> None:
    assert words in problem(save(tmp_path / "tagged.png", values, content))


def test_gamma_and_chromaticities_of_png(tmp_path: Path, values: np.ndarray) -> None:
    def tagged(name: str, *chunks: tuple[bytes, bytes]) -> np.ndarray:
        info = PIL.PngImagePlugin.PngInfo()
        for kind, content in chunks:
            info.add(kind, content)
        return read(save(tmp_path / name, values, pnginfo=info)).pixels

    *primaries, x, y = (round(value * 100000) for value in P3)
    wide = (b"cHRM", struct.pack(">8I", x, y, *primaries))
    plain = tagged("plain.png")
    np.testing.assert_array_equal(tagged("usual.png", (b"gAMA", struct.pack(">I", 45455))), plain)
    np.testing.assert_array_equal(tagged("srgb.png", (b"sRGB", b"\0"), wide), plain)
    linear = tagged("linear.png", (b"gAMA", struct.pack(">I", 100000)))
    np.testing.assert_allclose(linear, values / 255, rtol=1e-6)
    expected = plain.astype(np.float64) @ conversion(P3, PRIMARIES[REC709]).T
    np.testing.assert_allclose(tagged("wide.png", wide), expected, atol=1e-4)


def test_color_spaces_of_exr(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = planes(rng, "R", "G", "B", "A", "height")
    plain = read(exr(tmp_path / "plain.exr", channels)).pixels
    expected = plain[..., :3].astype(np.float64) @ conversion(PRIMARIES[ACESCG], PRIMARIES[REC709]).T
    for name, header in {
        "chromaticities": {"chromaticities": PRIMARIES[ACESCG]},
        "name": {"colorInteropID": ACESCG, "chromaticities": PRIMARIES[REC709]},
    }.items():
        image = read(exr(tmp_path / f"{name}.exr", channels, **header))
        np.testing.assert_allclose(image.pixels[..., :3], expected, atol=1e-5)
        np.testing.assert_array_equal(image.pixels[..., 3:], plain[..., 3:])
    for header in ({"chromaticities": PRIMARIES[REC709]}, {"colorInteropID": "data"}, {"colorInteropID": REC709}):
        np.testing.assert_array_equal(read(exr(tmp_path / "same.exr", channels, **header)).pixels, plain)
    grey = exr(tmp_path / "grey.exr", planes(rng, "Y"), chromaticities=PRIMARIES[ACESCG])
    assert read(grey).channels == ("Y",)


def test_color_spaces_of_exr_that_are_not_read(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = planes(rng, "R", "G", "B")
    encoded = exr(tmp_path / "encoded.exr", channels, colorInteropID="srgb_rec709_scene")
    assert "is in the colour space 'srgb_rec709_scene'; lin_rec709_scene, lin_ap1_scene" in problem(encoded)
    line = exr(tmp_path / "line.exr", channels, chromaticities=(0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3))
    assert "chromaticities are not those of a colour space" in problem(line)


def coded_points(path: Path, values: np.ndarray, content: bytes, *others: bytes) -> Path:
    """A PNG with a chunk cICP, then ``others``."""
    depth = 16 if values.dtype == np.uint16 else 8
    path.write_bytes(png(values, depth, chunk(b"cICP", content) + b"".join(others)))
    return path


HLG_WHITE = (np.exp((0.75 - 0.55991073) / 0.17883277) + 0.28466892) / 12
TRANSFERS = {
    1: lambda v: np.where(v < 0.0812428583, v / 4.5, ((v + 0.0992968268) / 1.0992968268) ** (1 / 0.45)),
    4: lambda v: v**2.2,
    5: lambda v: v**2.8,
    8: lambda v: v,
    18: lambda v: (
        np.where(v <= 0.5, v**2 / 3, (np.exp((v - 0.55991073) / 0.17883277) + 0.28466892) / 12) / HLG_WHITE
    ),
}
TRANSFERS |= dict.fromkeys((6, 14, 15), TRANSFERS[1])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("transfer", list(TRANSFERS))
def test_transfer_functions_of_cicp(
    tmp_path: Path, rng: np.random.Generator, dtype: type[np.integer], transfer: int
) -> None:
    largest = np.iinfo(dtype).max
    values = rng.integers(0, largest + 1, (12, 9, 4)).astype(dtype)
    image = read(coded_points(tmp_path / "a.png", values, bytes((1, transfer, 0, 1))))
    codes = values / largest
    np.testing.assert_allclose(image.pixels[..., :3], TRANSFERS[transfer](codes[..., :3]), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(image.pixels[..., 3], codes[..., 3], rtol=1e-6)


def test_pq_of_cicp_is_relative_to_diffuse_white(tmp_path: Path) -> None:
    # ITU-R BT.2408, table 1: 203 cd/m2 has 58 % of the signal; ITU-R BT.2100: the whole signal 10,000 cd/m2.
    values = np.array([0, 0.58, 0.580689, 1]).reshape(2, 2, 1) * 65535
    source = open_source(
        "photo", str(coded_points(tmp_path / "a.png", values.astype(np.uint16), bytes((9, 16, 0, 1))))
    )
    np.testing.assert_allclose(source.read().pixels.ravel(), [0, 0.994, 1, 10000 / 203], atol=0.001)
    assert [note.rpartition(": ")[2] for note in source.notes] == [
        "cICP says PQ, so 1.0 is taken as diffuse white of 203 cd/m2 (ITU-R BT.2408)"
    ]


def test_hlg_of_cicp_tells_what_was_assumed(tmp_path: Path, values: np.ndarray) -> None:
    for name in ("1.png", "2.png"):
        coded_points(tmp_path / name, values, bytes((9, 18, 0, 1)))
    (tmp_path / "maps").mkdir()
    coded_points(tmp_path / "maps" / "albedo.png", values, bytes((9, 18, 0, 1)))
    for reference in (tmp_path / "1.png", tmp_path / "maps", f"stack:{tmp_path}"):
        (note,) = open_source("photo", str(reference)).notes
        assert "cICP says HLG, so 1.0 is taken as the scene's light at signal 0.75" in note


@pytest.mark.parametrize(
    ("number", "primaries"),
    [(9, PRIMARIES["lin_rec2020_scene"]), (12, P3), (11, (*P3[:6], 0.314, 0.351))],
)
def test_primaries_of_cicp(tmp_path: Path, values: np.ndarray, number: int, primaries: tuple[float, ...]) -> None:
    image = read(coded_points(tmp_path / "a.png", values, bytes((number, 8, 0, 1))))
    expected = values / 255 @ conversion(primaries, PRIMARIES[REC709]).T
    np.testing.assert_allclose(image.pixels, expected, atol=1e-5)


def test_cicp_comes_before_all_other_chunks_of_colour(tmp_path: Path, values: np.ndarray) -> None:
    plain = tmp_path / "plain.png"
    plain.write_bytes(png(values, 8))
    others = [
        chunk(b"iCCP", b"other\0\0" + zlib.compress(profile(ADOBE, GAMMA))),
        chunk(b"sRGB", b"\0"),
        chunk(b"gAMA", struct.pack(">I", 100000)),
    ]
    for other in others:
        same = read(coded_points(tmp_path / "same.png", values, bytes((1, 13, 0, 1)), other))
        np.testing.assert_array_equal(same.pixels, read(plain).pixels)
        linear = read(coded_points(tmp_path / "linear.png", values, bytes((1, 8, 0, 1)), other))
        np.testing.assert_allclose(linear.pixels, values / 255, rtol=1e-6)


def test_cicp_of_palettes(tmp_path: Path, values: np.ndarray) -> None:
    path, palette = tmp_path / "palette.png", values[:4, 0]
    picture = PIL.Image.fromarray(np.arange(12, dtype=np.uint8).reshape(4, 3) % 4).convert("P")
    picture.putpalette(palette.tobytes())
    picture.save(path)
    plain = path.read_bytes()
    path.write_bytes(plain[:33] + chunk(b"cICP", bytes((1, 8, 0, 1))) + plain[33:])  # behind IHDR
    np.testing.assert_allclose(read(path).pixels, palette[np.asarray(picture)] / 255, rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ((2, 13, 0, 1), "has a cICP chunk with colour primaries 2, which is not read (1, 9, 11, 12)"),
        (
            (1, 17, 0, 1),
            "has a cICP chunk with transfer function 17, which is not read (1, 4, 5, 6, 8, 13, 14, 15, ",
        ),
        ((9, 16, 9, 1), "has a cICP chunk with matrix coefficients 9, which is not read (0)"),
        ((9, 16, 0, 0), "has a cICP chunk with full range flag 0, which is not read (1)"),
        ((9, 16, 0), "has a broken cICP chunk, not of 4 bytes"),
    ],
)
def test_cicp_that_is_not_read(tmp_path: Path, values: np.ndarray, content: tuple[int, ...], words: str) -> None:
    line = problem(coded_points(tmp_path / "a.png", values, bytes(content)))
    assert line.startswith(words)
    assert line.endswith("; save the picture as sRGB without that chunk")


def test_cicp_of_data_does_not_matter(tmp_path: Path, values: np.ndarray) -> None:
    paths = [tmp_path / f"{name}.png" for name in ("plain", "tagged")]
    paths[0].write_bytes(png(values[..., :1], 8))
    coded_points(paths[1], values[..., :1], bytes((2, 99, 9, 0)))
    plain, tagged = (
        locate.decode(str(path), locate.inspect(str(path), data=True).digest, data=True) for path in paths
    )
    np.testing.assert_array_equal(tagged.pixels, plain.pixels)
