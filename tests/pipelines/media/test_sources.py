from __future__ import annotations

import concurrent.futures
import errno
import io
import os
import re
import struct
import subprocess
import sys
import warnings
import zlib
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import PIL.Image
import PIL.ImageOps
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.pipelines.pictures import BLACK, chunk, png, tiff
from texloom.pipelines.media import decode as pictures
from texloom.pipelines.media.formats import FORMATS, known_names
from texloom.pipelines.media.locate import shipped_pictures
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.store.capture import capture_output
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear
from texloom.stages.vocabulary.declare import InputError


def problem(reference: object, decode: bool = False) -> str:
    """The one line that says what is wrong, less its place."""
    line = attempt(reference, decode)
    assert line, "not refused"
    return line


def attempt(reference: object, decode: bool) -> str:
    """Opens a source, and reads it if ``decode``: what is wrong, or nothing."""
    try:
        source = open_source("exemplar", str(reference))
        if decode:
            source.read()
    except InputError as error:
        line = str(error)
    else:
        return ""
    place = f"sources.exemplar: {reference}: "
    assert line.startswith(place)
    assert line.isprintable()
    return line.removeprefix(place)


def read(path: Path) -> Image:
    source = open_source("exemplar", str(path))
    image = source.read()
    assert (image.height, image.width, image.channels) == (source.height, source.width, source.channels)
    assert image.pixels.dtype == np.float32
    assert image.pixels.flags.c_contiguous
    return image


def coded(image: Image, largest: int) -> np.ndarray:
    """The sRGB integers that a picture came from; the last plane of RGBA and YA is alpha."""
    alpha = int("A" in image.channels)
    colors = image.pixels.shape[2] - alpha
    parts = [srgb_from_linear(image.pixels[..., :colors].astype(float)), image.pixels[..., colors:]]
    return np.rint(np.concatenate(parts, axis=2) * largest).astype(int)


def exr(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))
    return path


def planes(rng: np.random.Generator, *names: str, shape: tuple[int, int] = (5, 7)) -> dict[str, np.ndarray]:
    return {name: rng.random(shape, np.float32) for name in names}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A small black PNG."""
    path = tmp_path / "a.png"
    path.write_bytes(BLACK)
    return path


NAMES = {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


# Integers to linear light


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_png_keeps_every_bit(path: Path, rng: np.random.Generator, depth: int, count: int) -> None:
    values = rng.integers(0, 2**depth, (9, 13, count))
    path.write_bytes(png(values, depth))
    image = read(path)
    assert image.channels == NAMES[count]
    np.testing.assert_array_equal(coded(image, 2**depth - 1), values)


@pytest.mark.parametrize("depth", [8, 16])
def test_every_code_is_decoded_by_the_standard(path: Path, depth: int) -> None:
    values = np.arange(2**depth).reshape(-1, 16, 1)
    path.write_bytes(png(values, depth))
    pixels = read(path).pixels
    np.testing.assert_array_equal(pixels, linear_from_srgb(values / (2**depth - 1)).astype(np.float32))
    np.testing.assert_array_equal(np.rint(srgb_from_linear(pixels) * (2**depth - 1)), values)
    assert pixels.min() == 0
    assert pixels.max() == 1


def test_alpha_is_linear(path: Path) -> None:
    path.write_bytes(png(np.full((2, 2, 4), 51), 8))
    np.testing.assert_allclose(read(path).pixels[0, 0], [*[linear_from_srgb(np.array(0.2))] * 3, 0.2], rtol=1e-6)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("count", [1, 3])
def test_a_transparent_colour_becomes_alpha(path: Path, rng: np.random.Generator, depth: int, count: int) -> None:
    values = rng.integers(0, 2**depth, (4, 5, count))
    values[1, 2], values[3, 3] = 7, 7
    if count == 3:
        values[3, 3, 0] = 8
    path.write_bytes(png(values, depth, chunk(b"tRNS", struct.pack(f">{count}H", *[7] * count))))
    image = read(path)
    assert image.channels == NAMES[count + 1]
    np.testing.assert_array_equal(coded(image, 2**depth - 1)[..., :count], values)
    np.testing.assert_array_equal(image.pixels[..., -1], ~(values == 7).all(axis=2))


@pytest.mark.parametrize("bits", [1, 2, 4])
def test_few_bits_of_grey(path: Path, bits: int) -> None:
    rows = np.array([[0, 1], [1, 0]])
    packed = b"".join(bytes([0, (row[0] << 8 - bits) | (row[1] << 8 - 2 * bits)]) for row in rows.tolist())
    content = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, bits, 0, 0, 0, 0)) + chunk(b"tRNS", struct.pack(">H", 1))
    content += chunk(b"IDAT", zlib.compress(packed)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + content)
    image = read(path)
    assert image.channels == ("Y", "A")
    np.testing.assert_array_equal(coded(image, 2**bits - 1)[..., 0], rows)
    np.testing.assert_array_equal(image.pixels[..., 1], 1 - rows)


@pytest.mark.parametrize("transparent", [False, True])
def test_palettes(path: Path, rng: np.random.Generator, transparent: bool) -> None:
    picture = PIL.Image.fromarray(rng.integers(0, 3, (6, 4), np.uint8)).convert("P")
    colors = rng.integers(0, 256, (256, 3), np.uint8)
    picture.putpalette(colors.tobytes())
    picture.save(path, **({"transparency": bytes([0, 128, 255])} if transparent else {}))
    image, indices = read(path), np.asarray(picture)
    assert image.channels == NAMES[4 if transparent else 3]
    np.testing.assert_array_equal(coded(image, 255)[..., :3], colors[indices])
    if transparent:
        np.testing.assert_array_equal(coded(image, 255)[..., 3], np.array([0, 128, 255])[indices])


MODES = {
    "png": ["1", "L", "LA", "RGB", "RGBA"],
    "tif": ["1", "L", "LA", "RGB", "RGBA"],
    "webp": ["RGB", "RGBA"],
    "bmp": ["1", "L", "RGB"],
    "jpg": ["L", "RGB"],
}


@pytest.mark.parametrize(("suffix", "mode"), [(suffix, mode) for suffix, modes in MODES.items() for mode in modes])
def test_formats(tmp_path: Path, suffix: str, mode: str) -> None:
    ramp = np.add.outer(np.arange(24), np.arange(40)).astype(np.uint8) * 4
    picture = PIL.Image.fromarray(np.dstack([ramp, ramp // 2, 255 - ramp, 255 - ramp // 3])).convert(mode)
    path = tmp_path / f"a.{suffix}"
    picture.save(path, **({"lossless": True, "exact": True} if suffix == "webp" else {}))
    wanted = np.asarray(picture.convert("L") if mode == "1" else picture).reshape(24, 40, -1)
    image = read(path)
    assert image.channels == NAMES[wanted.shape[2]]
    np.testing.assert_allclose(coded(image, 255), wanted, atol=12 if suffix == "jpg" else 0)


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
@pytest.mark.parametrize("count", [1, 3, 4])
def test_deep_tiff(tmp_path: Path, rng: np.random.Generator, kind: type, count: int) -> None:
    values = (rng.random((8, 6, count)) * (65535 if kind is np.uint16 else 3)).astype(kind)
    path = tmp_path / "a.tif"
    cv2.imwrite(str(path), values[..., [2, 1, 0, 3][:count]] if count > 1 else values)
    image = read(path)
    assert image.channels == NAMES[count]
    np.testing.assert_array_equal(image.pixels if kind is np.float32 else coded(image, 65535), values)


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation(tmp_path: Path, rng: np.random.Generator, orientation: int, suffix: str) -> None:
    picture = PIL.Image.fromarray(
        np.kron(rng.integers(0, 256, (2, 3, 3), np.uint8), np.ones((16, 16, 1), np.uint8))
    )
    exif = PIL.Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{suffix}"
    picture.save(path, exif=exif, **({"lossless": True} if suffix == "webp" else {}))
    with PIL.Image.open(path) as stored:
        wanted = np.asarray(PIL.ImageOps.exif_transpose(stored))
    image = read(path)
    assert image.pixels.shape[:2] == ((48, 32) if orientation >= 5 else (32, 48))
    np.testing.assert_array_equal(coded(image, 255), wanted)


# EXR


def test_exr_of_mixed_types(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = planes(rng, "R", "G", "B", "A", "normal.x", "height")
    channels["G"] = channels["G"].astype(np.float16)
    channels["id"] = rng.integers(0, 9999, (5, 7), np.uint32)
    channels["R"][2, 3] = 40  # brighter than white
    image = read(exr(tmp_path / "a.exr", dict(channels)))
    assert image.channels == ("R", "G", "B", "A", "height", "id", "normal.x")
    for index, name in enumerate(image.channels):
        np.testing.assert_array_equal(image.pixels[..., index], channels[name].astype(np.float32))


@pytest.mark.parametrize(
    ("stored", "expected", "origin"),
    [
        ("Y", "Y", "Y"),
        ("Z A Y", "Y A Z", "Y A Z"),
        ("Y B G R", "R G B Y", "R G B Y"),
        ("rgba.R rgba.G rgba.B rgba.A", "R G B A", "rgba.R rgba.G rgba.B rgba.A"),
        ("a.R a.G a.B A", "R G B A", "a.R a.G a.B A"),
        ("r g b a", "R G B A", "r g b a"),
        ("red green blue", "R G B", "red green blue"),
        ("height", "Y", "height"),
        ("depth.V", "Y", "depth.V"),
        (
            "V.Combined.R V.Combined.G V.Combined.B V.Combined.A V.Depth.Z V.Diff.R V.Diff.G V.Diff.B",
            "R G B A V.Depth.Z V.Diff.B V.Diff.G V.Diff.R",
            "V.Combined.R V.Combined.G V.Combined.B V.Combined.A V.Depth.Z V.Diff.B V.Diff.G V.Diff.R",
        ),
        ("a.c.R a.c.G a.c.B a.Z", "R G B a.Z", "a.c.R a.c.G a.c.B a.Z"),
        ("N.X N.Y N.Z wet.Y", "Y N.X N.Y N.Z", "wet.Y N.X N.Y N.Z"),
        (
            "beauty.R beauty.G beauty.B R G B",
            "R G B beauty.B beauty.G beauty.R",
            "R G B beauty.B beauty.G beauty.R",
        ),
    ],
)
def test_exr_layers(tmp_path: Path, rng: np.random.Generator, stored: str, expected: str, origin: str) -> None:
    channels = planes(rng, *stored.split())
    image = read(exr(tmp_path / "a.exr", dict(channels)))
    assert image.channels == tuple(expected.split())
    for index, name in enumerate(origin.split()):
        np.testing.assert_array_equal(image.pixels[..., index], channels[name])


def test_exr_takes_the_first_part_with_colour(tmp_path: Path, rng: np.random.Generator) -> None:
    shapes = {"depth": (5, 7), "layered": (5, 7), "beauty": (4, 3)}
    names = {"depth": ("Z",), "layered": ("a.R", "a.G", "a.B"), "beauty": ("R", "G", "B")}
    channels = {part: planes(rng, *names[part], shape=shapes[part]) for part in shapes}
    window = (np.array([0, 0], np.int32), np.array([6, 4], np.int32))
    parts = []
    for part, (height, width) in shapes.items():
        data = (np.array([0, 0], np.int32), np.array([width - 1, height - 1], np.int32))
        header = {"type": OpenEXR.scanlineimage, "displayWindow": window, "dataWindow": data}
        parts.append(OpenEXR.Part(header, dict(channels[part]), part))
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    image = read(tmp_path / "a.exr")
    assert image.channels == ("R", "G", "B")
    np.testing.assert_array_equal(image.pixels[..., 0], channels["beauty"]["R"])


def test_exr_data_window(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = planes(rng, "Y")
    data = (np.array([-3, 2], np.int32), np.array([3, 6], np.int32))
    shown = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    path = exr(tmp_path / "a.exr", dict(channels), dataWindow=data, displayWindow=shown)
    np.testing.assert_array_equal(read(path).pixels[..., 0], channels["Y"])


def test_exr_tiles(tmp_path: Path, rng: np.random.Generator) -> None:
    channels = planes(rng, "R", "G", "B", shape=(70, 90))
    path = exr(tmp_path / "a.exr", dict(channels), type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription())
    np.testing.assert_array_equal(read(path).pixels[..., 2], channels["B"])


def patched(path: Path, attribute: bytes, offset: int, value: bytes) -> Path:
    """Overwrites bytes of an attribute of an EXR's header."""
    content = bytearray(path.read_bytes())
    at = content.index(attribute + b"\0") + len(attribute) + 1
    at = content.index(b"\0", at) + 5 + offset  # behind the type's name and the size
    content[at : at + len(value)] = value
    path.write_bytes(content)
    return path


def test_exr_refusals(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "a.exr"
    one = planes(rng, "Y")
    assert problem(exr(path, planes(rng, "Z", "id"))) == "has no colour: no channels R, G, B and no Y, but Z, id"
    many = planes(rng, *(f"c{index}" for index in range(10)))
    assert problem(exr(path, many)).endswith("but c0, c1, c2, c3, c4, c5, c6, c7, ...")
    assert problem(exr(path, planes(rng, "a\nb", "c"))).endswith("but a\\nb, c")
    layers = planes(rng, *(f"{layer}.{name}" for layer in ("a", "b") for name in "RGB"))
    assert problem(exr(path, layers)) == "has colour in several layers: a, b; save one as R, G, B"
    assert problem(exr(path, planes(rng, "X", "Y", "Z"))).endswith("but X, Y, Z")
    assert problem(exr(path, planes(rng, "A", "l.A", "l.R", "l.G", "l.B"))) == "has both A and l.A; remove one"
    assert problem(exr(path, planes(rng, "Y", *map(str, range(64))))) == "has 65 channels, at most 64"
    assert "luminance and chroma" in problem(exr(path, planes(rng, "Y", "RY", "BY")))
    assert problem(exr(path, planes(rng, "Y", shape=(1, 9)))) == "is too small: 9 x 1 px, at least 2 x 2 px"
    even = exr(path, planes(rng, "Y", shape=(6, 8)))
    subsampled = patched(even, b"channels", len(b"Y\0") + 8, struct.pack("<2i", 2, 2))
    assert problem(subsampled) == "has subsampled channels, which are not read"
    huge = patched(exr(path, dict(one)), b"dataWindow", 0, struct.pack("<4i", 0, 0, 49999, 49999))
    assert problem(huge) == "is too large: 50000 x 50000 px, at most 32768 px a side and 268435456 in all"
    wide = patched(exr(path, planes(rng, *"RGBAZ")), b"dataWindow", 0, struct.pack("<4i", 0, 0, 16383, 16383))
    assert problem(wide) == "is too large: 1342177280 values in all channels, at most 1073741824"
    turned = patched(exr(path, dict(one)), b"dataWindow", 0, struct.pack("<4i", 9, 9, -9, -9))
    assert problem(turned).startswith("is a truncated or broken EXR file")


def test_the_parts_of_an_exr_count_together(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "a.exr"
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, planes(rng, *"RGB"), part) for part in ("one", "two")]
    OpenEXR.File(parts).write(str(path))
    small, large = struct.pack("<4i", 0, 0, 6, 4), struct.pack("<4i", 0, 0, 16383, 16383)
    path.write_bytes(path.read_bytes().replace(small, large))
    assert problem(path) == "is too large: 1610612736 values in all channels, at most 1073741824"


def test_deep_exr(tmp_path: Path) -> None:
    samples = np.empty((3, 3), object)
    for place in np.ndindex(3, 3):
        samples[place] = np.ones(2, np.float32)
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    path = exr(tmp_path / "a.exr", dict.fromkeys("RGB", samples), **header)
    assert problem(path) == "has deep pixels, which are not read"


@pytest.mark.parametrize(("value", "kind"), [(np.nan, np.float32), (np.inf, np.float32), (-np.inf, np.float16)])
def test_exr_that_is_not_finite(tmp_path: Path, rng: np.random.Generator, value: float, kind: type) -> None:
    channels = {name: plane.astype(kind) for name, plane in planes(rng, "R", "G", "B", "height").items()}
    channels["height"][1:4, 2] = value
    path = exr(tmp_path / "a.exr", channels)
    assert problem(path, decode=True) == "channel 'height' has 3 of 35 values NaN or infinite"


def test_float_tiff_that_is_not_finite(tmp_path: Path) -> None:
    values = np.ones((4, 4, 3), np.float32)
    values[0, 0, 2] = np.nan
    cv2.imwrite(str(tmp_path / "a.tif"), values)
    assert problem(tmp_path / "a.tif", decode=True) == "channel 'R' has 1 of 16 values NaN or infinite"


# Files that are refused


def test_references_that_are_no_file(tmp_path: Path) -> None:
    assert problem(tmp_path / "none.png") == "no such file"
    (tmp_path / "stones.png").touch()
    assert problem(tmp_path / "stone.png") == "no such file; did you mean 'stones.png'?"
    (tmp_path / "stones.png").unlink()
    assert problem(tmp_path) == "is a folder without pictures, but has to hold a map set"
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "albedo.png").touch()
    assert problem(tmp_path).endswith(f"; give {tmp_path.name}/textures, which holds maps")
    assert problem("/dev/zero") == "is not a regular file"
    os.mkfifo(tmp_path / "pipe.png")
    assert problem(tmp_path / "pipe.png") == "is not a regular file"
    (tmp_path / "dangling.png").symlink_to(tmp_path / "none.png")
    assert problem(tmp_path / "dangling.png") == "no such file"
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    assert problem(tmp_path / "loop.png").startswith("cannot be read: Too many levels")
    (tmp_path / "file").write_bytes(b"x")
    assert problem(tmp_path / "file" / "a.png") == "cannot be read: Not a directory"
    assert problem(tmp_path / ("x" * 300)) == "cannot be read: File name too long"


@pytest.mark.parametrize("name", ["a\nb.png", "a\0b.png", "\udcff.png", "\x1b[31m.png"])
def test_odd_names_stay_on_one_line(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError) as caught:
        open_source("exemplar", str(tmp_path / name))
    assert str(caught.value).isprintable()
    assert str(tmp_path) in str(caught.value)


def test_links_are_followed(tmp_path: Path, path: Path) -> None:
    (tmp_path / "link").symlink_to(path)
    assert open_source("a", str(tmp_path / "link")).digest == open_source("a", str(path)).digest


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_files_without_permission(path: Path) -> None:
    path.chmod(0)
    assert problem(path) == "cannot be read: Permission denied"


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"\xff\xd8\xff", "JPEG"),
        (b"II*\0", "TIFF"),
        (b"MM\0*\0\0\0\x08", "TIFF"),
        (b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0", "TIFF"),
        (b"RIFF\x08\0\0\0WEBP", "WebP"),
        (b"BM", "BMP"),
        (b"\x76\x2f\x31\x01", "EXR"),
    ],
)
def test_signatures_without_a_picture(path: Path, start: bytes, kind: str) -> None:
    for rest in (b"", b"hello", bytes(99), b"\xff" * 99):
        path.write_bytes(start + rest)
        message = problem(path, decode=True)
        assert message.startswith((f"is a truncated or broken {kind} file", "has no pixels", "is too large"))


def png_header(height: int, width: int) -> bytes:
    """A PNG whose header has this size."""
    return png(np.zeros((1, 1, 3)), 8, shape=(height, width))


def pillow(mode: str, kind: str) -> bytes:
    PIL.Image.new(mode, (4, 4)).save(file := io.BytesIO(), kind)
    return file.getvalue()


def opencv(values: np.ndarray) -> bytes:
    return cv2.imencode(".tif", values)[1].tobytes()


WEBP = b"WEBPVP8X" + struct.pack("<I", 10) + bytes(4) + 2 * (49999).to_bytes(3, "little")
OTHER_VALUES = "has values of a kind that is not read; TIFF may hold"
REFUSED: dict[str, tuple[bytes, str | tuple[str, ...]]] = {
    "empty": (b"", "is empty"),
    **{
        repr(content): (content, f"is not a picture that can be read; {known_names()} can")
        for content in (b"brick\n", b"\0\0\0\x18ftypmp42" + bytes(40), b"RIFF\0\0\0\0WAVEfmt ", b"\x89PN")
    },
    **{
        f"{side}x{other}": (
            png_header(side, other),
            f"is too large: {other} x {side} px, at most 32768 px a side and 268435456 in all",
        )
        for side, other in ((50000, 50000), (32769, 2), (2, 32769), (16385, 16384))
    },
    **{
        f"{side}x{other}": (
            png(np.zeros((side, other, 3)), 8),
            f"is too small: {other} x {side} px, at least 2 x 2 px",
        )
        for side, other in ((1, 1), (1, 9), (9, 1))
    },
    "no pixels": (png_header(0, 5), ("has no pixels", "is a truncated or broken PNG file")),
    "huge WebP": (b"RIFF" + struct.pack("<I", len(WEBP)) + WEBP, "is too large: 50000 x 50000 px"),
    "huge TIFF": (tiff({256: 50000, 257: 50000, 258: 8, 262: 1, 277: 1}), "is too large: 50000 x 50000 px"),
    "32-bit integers": (pillow("I", "tiff"), OTHER_VALUES),
    "five channels": (
        tiff({256: 4, 257: 4, 258: 8, 259: 1, 262: 2, 273: 8, 277: 5, 279: 80}, bytes(80)),
        "has 5 channels, at most 4 in TIFF",
    ),
}


@pytest.mark.parametrize(("content", "error"), REFUSED.values(), ids=REFUSED)
def test_files_that_are_refused(path: Path, content: bytes, error: str | tuple[str, ...]) -> None:
    path.write_bytes(content)
    assert problem(path).startswith(error)


def test_the_smallest_picture(path: Path) -> None:
    path.write_bytes(png(np.zeros((2, 2, 3)), 8))
    assert read(path).pixels.shape == (2, 2, 3)


def test_large_pictures_are_opened_without_a_warning(path: Path) -> None:
    path.write_bytes(png(np.zeros((1, 1, 1)), 8, shape=(16384, 16384)))
    source = open_source("exemplar", str(path))  # beyond Pillow's own bounds
    assert (source.height, source.width) == (16384, 16384)


@pytest.mark.parametrize("lossless", [False, True])
def test_the_limit_of_pillow_is_not_ours(path: Path, monkeypatch: pytest.MonkeyPatch, lossless: bool) -> None:
    PIL.Image.new("RGB", (50, 40)).save(path, "webp", lossless=lossless)
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 900)
    assert read(path).pixels.shape == (40, 50, 3)
    assert PIL.Image.MAX_IMAGE_PIXELS == 900


def test_too_many_bytes(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n")
    os.truncate(path, 2**31 + 1)  # sparse
    assert problem(path) == "is too large: 2147483649 bytes, at most 2147483648"


# Broken files


def encoded(kind: str) -> bytes:
    rng = np.random.default_rng(1)
    ramp = np.add.outer(np.arange(40) * 3, np.arange(50) * 2)[..., None] + rng.integers(0, 9, (40, 50, 3))
    if kind == "png16":
        return png(ramp * 256, 16)
    if kind == "tif32":
        return opencv(ramp.astype(np.float32))
    file = io.BytesIO()
    if kind == "exr":
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": ramp.astype(np.float32)}).write(file)
    else:
        PIL.Image.fromarray(ramp.astype(np.uint8)).save(file, {"jpg": "jpeg", "tif": "tiff"}.get(kind, kind))
    return file.getvalue()


KINDS = ["png", "png16", "jpg", "tif", "tif32", "webp", "bmp", "exr"]


@pytest.mark.parametrize("kind", KINDS)
def test_truncation(path: Path, kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    content = encoded(kind)
    path.write_bytes(content)
    read(path)
    for share in (0.3, 0.5, 0.8, 0.95):
        path.write_bytes(content[: int(len(content) * share)])
        assert "is a truncated or broken" in problem(path, decode=True)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", KINDS)
def test_damage_raises_no_other_error(path: Path, kind: str) -> None:
    content = encoded(kind)
    rng = np.random.default_rng(2)
    for _ in range(40):
        damaged = bytearray(content)
        near_start = rng.integers(0, 2)
        for place in rng.integers(0, 200 if near_start else len(content), 3):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        attempt(path, decode=True)


STARTS = [b"", b"RIFF\0\0\0\0WEBP", b"\0\0\0\x18ftypavif", *(start for one in FORMATS for start in one.starts)]


@given(content=st.binary(max_size=300), start=st.sampled_from(STARTS))
def test_any_bytes_are_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes, start: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any"
    path.write_bytes(start + content)
    with pytest.raises(InputError, match=re.escape(f"sources.a: {path}: ")):
        open_source("a", str(path)).read()


def test_an_exr_with_one_part_cut(tmp_path: Path, rng: np.random.Generator) -> None:
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, planes(rng, *names, shape=(64, 64)), part)
        for part, names in {"one": ("Y",), "two": ("R", "G", "B")}.items()
    ]
    path = tmp_path / "a.exr"
    OpenEXR.File(parts).write(str(path))
    read(path)
    path.write_bytes(path.read_bytes()[:-9000])
    assert problem(path, decode=True) == "is a truncated or broken EXR file (not a whole EXR file)"


def test_broken_exif_is_no_orientation(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    for broken in (b"Exif\0\0", b"Exif\0\0nonsense", exif.tobytes()[:-9], exif.tobytes().replace(b"\x06", b"\x60")):
        PIL.Image.new("RGB", (8, 6)).save(path, exif=broken)
        assert read(path).pixels.shape == (6, 8, 3)


def test_threads_leave_the_process_as_it_was(capfd: pytest.CaptureFixture[str]) -> None:
    filters = list(warnings.filters)
    source = open_source("exemplar", "skimage:brick")
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        images = list(pool.map(lambda _: source.read(), range(8)))
    assert all(np.array_equal(image.pixels, images[0].pixels) for image in images)
    assert warnings.filters == filters
    print("still here")
    assert capfd.readouterr() == ("still here\n", "")


def test_closed_streams(path: Path) -> None:
    code = f"from texloom.pipelines.media.sources import open_source; open_source('a', {str(path)!r}).read()"
    subprocess.run(["sh", "-c", '"$0" -c "$1" >&- 2>&-', sys.executable, code], check=True)


def test_streams_on_a_full_device(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be printed is not the picture's fault."""

    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    path.write_bytes(BLACK)
    monkeypatch.setattr(sys, "stdout", Full())
    assert attempt(path, decode=True) == ""
    with capture_output():
        print("a library says something")


def test_what_others_print_meanwhile_is_not_lost(capfd: pytest.CaptureFixture[str]) -> None:
    with pictures._guarded("PNG"):
        print("to stdout")
        os.write(2, b"to stderr")
        assert capfd.readouterr() == ("", "")
    assert capfd.readouterr() == ("to stdout\n", "to stderr")


# Digests


def test_the_digest_follows_the_content_alone(tmp_path: Path) -> None:
    one, two = tmp_path / "one.png", tmp_path / "two.jpg"
    one.write_bytes(BLACK)
    two.write_bytes(one.read_bytes())
    first = open_source("a", str(one))
    assert re.fullmatch(r"[0-9a-f]{64}", first.digest)
    assert open_source("b", str(two)).digest == first.digest
    two.write_bytes(png(np.ones((3, 3, 3)), 8))
    assert open_source("b", str(two)).digest != first.digest


def test_the_digest_follows_the_decoding(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = open_source("a", str(path)).digest
    monkeypatch.setattr("texloom.pipelines.media.locate._VERSION", 0)
    assert open_source("a", str(path)).digest != before


def test_a_file_that_changes_in_between(path: Path) -> None:
    source = open_source("exemplar", str(path))
    path.write_bytes(png(np.ones((3, 3, 3)), 8))
    with pytest.raises(InputError, match="has changed since") as caught:
        source.read()
    assert str(caught.value) == f"sources.exemplar: {path}: has changed since the run began"
    path.unlink()
    with pytest.raises(InputError, match="no such file"):
        source.read()


def test_a_file_that_changes_while_it_is_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = open_source("exemplar", str(path))
    original = pictures.read_header

    def read_header(file: io.BufferedReader, *options: bool) -> pictures.OpenedPicture:
        path.write_bytes(png(np.ones((3, 3, 3)), 8))
        return original(file, *options)

    monkeypatch.setattr(pictures, "read_header", read_header)
    with pytest.raises(InputError, match="has changed while it was read"):
        source.read()


# References


def test_shipped_pictures() -> None:
    assert {"texloom:bricks", "skimage:grass"} <= set(shipped_pictures())
    source = open_source("exemplar", "texloom:bricks")
    assert (source.height, source.width, source.channels) == (512, 512, ("R", "G", "B"))


@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_skimage(name: str) -> None:
    source = open_source("exemplar", f"skimage:{name}")
    assert source == Source("exemplar", f"skimage:{name}", 512, 512, ("Y",), source.digest, map_bits={"albedo": 8})
    pixels = source.read().pixels
    assert 0.02 < pixels.std() < 0.5


def test_skimage_in_colour() -> None:
    assert open_source("exemplar", "skimage:coffee").channels == ("R", "G", "B")


def test_unknown_references() -> None:
    assert problem("skimage:brik") == "no such picture ships with scikit-image; did you mean 'skimage:brick'?"
    assert "there are astronaut, brick, " in problem("skimage:qqqq")
    for name in ("", "../data/brick", "/etc/passwd", "brick.png", "multipage"):
        assert problem(f"skimage:{name}").startswith("no such picture ships with scikit-image")
    assert problem("https://example.org/a.png") == (
        "no such kind of source, 'https:'; give a file, texloom:NAME or skimage:NAME"
    )
    assert problem("texloom:brick") == "no such picture ships with texloom; did you mean 'texloom:bricks'?"


def test_opening_imports_no_heavy_library(path: Path) -> None:
    path.write_bytes(png(np.zeros((3, 3, 3)), 16))
    code = (
        "import sys; from texloom.pipelines.media.sources import open_source\n"
        f"open_source('a', {str(path)!r}); open_source('b', 'skimage:brick')\n"
        "heavy = {'numba', 'cv2', 'skimage', 'scipy', 'prefect', 'OpenEXR'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("reference", "picture", "label"),
    [
        ("/set/moss wall.png", "moss wall", "exemplar: moss wall.png"),
        ("/set/moss", "moss", "exemplar: moss"),
        ("skimage:grass", "grass", "exemplar: skimage:grass"),
        (f"/store/sources/{'0f' * 32}.png", "exemplar", "exemplar: array"),
        (f"/store/sources/{'0f' * 32}/maps.yaml", "exemplar", "exemplar: array"),
    ],
)
def test_a_source_has_a_name_for_people(reference: str, picture: str, label: str) -> None:
    source = Source("exemplar", reference, 4, 4, ("Y",), "0" * 64)
    assert (source.picture, source.label) == (picture, label)


def test_what_alpha_excludes_of_a_picture_is_told(tmp_path: Path) -> None:
    levels = np.full((8, 8, 4), 255, np.uint8)
    PIL.Image.fromarray(levels).save(tmp_path / "whole.png")
    levels[:2, :, 3] = 0
    PIL.Image.fromarray(levels).save(tmp_path / "cut.png")
    (note,) = open_source("exemplar", str(tmp_path / "cut.png")).notes
    assert note.endswith("cut.png: alpha is below a half in 25 % of the pixels, which are never copied")
    assert open_source("exemplar", str(tmp_path / "whole.png")).notes == ()
    assert open_source("mask", str(tmp_path / "cut.png")).notes == ()
