"""Colour spaces of sources: profiles and chromaticities are honoured, or refused by one line."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageCms
import PIL.PngImagePlugin
import pytest

from tests.pipelines.media.test_sources import exr, planes, problem, read
from texloom.pipelines.media import color_spaces, icc
from texloom.pipelines.media.color_spaces import ACESCG, PRIMARIES, REC709, conversion
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
