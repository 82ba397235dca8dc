"""Formats beyond PNG, JPEG, TIFF and EXR: their pixels, and what is told of them."""

import importlib.util
import io
import re
import struct
import zipfile
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
import tifffile
from PIL import ImageCms

from tests.pipelines.media.test_sources import coded, problem, read
from texloom.pipelines.media import formats
from texloom.pipelines.media.locate import inspect
from texloom.pipelines.media.sources import Source, open_source


def opened(path: Path) -> Source:
    return open_source("exemplar", str(path))


@pytest.fixture
def values(rng: np.random.Generator) -> np.ndarray:
    """8-bit colours with alpha that differ in every pixel, (12, 20, 4)."""
    return rng.integers(0, 256, (12, 20, 4)).astype(np.uint8)


@pytest.mark.parametrize("options", [{}, {"compression": "tga_rle"}, {"orientation": 1}])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_tga(tmp_path: Path, values: np.ndarray, count: int, options: dict) -> None:
    PIL.Image.fromarray(values[..., :count].squeeze()).save(path := tmp_path / "a.tga", **options)
    np.testing.assert_array_equal(coded(read(path), 255), values[..., :count])
    assert all("alpha is below a half" in note for note in opened(path).notes)


def test_tga_without_alpha_in_its_header(tmp_path: Path, values: np.ndarray) -> None:
    PIL.Image.fromarray(values).save(path := tmp_path / "a.tga")
    content = bytearray(path.read_bytes())
    content[17] &= 0xF0
    path.write_bytes(content)
    np.testing.assert_array_equal(coded(read(path), 255), values[..., :3])
    assert opened(path).notes == (
        f"sources.exemplar: {path}: its alpha is not read: the header says that it has none",
    )


@pytest.mark.parametrize("first", [b"#?RADIANCE\n", b"#?RGBE\n"])
def test_radiance(tmp_path: Path, rng: np.random.Generator, first: bytes) -> None:
    light = (rng.random((9, 40, 3)) * 50).astype(np.float32)
    content = cv2.imencode(".hdr", np.ascontiguousarray(light[..., ::-1]))[1].tobytes()
    (path := tmp_path / "a.hdr").write_bytes(first + content.partition(b"\n")[2])
    image = read(path)
    np.testing.assert_allclose(image.pixels, light, atol=0.5, rtol=0.01)
    assert image.pixels.max() > 40
    assert opened(path).bits == 32


def radiance(path: Path, lines: bytes = b"", order: bytes = b"-Y 2 +X 2") -> Path:
    path.write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + lines + b"\n" + order + b"\n" + b"\x80\x40\x20\x81" * 4
    )
    return path


def test_radiance_headers(tmp_path: Path) -> None:
    path = tmp_path / "a.hdr"
    np.testing.assert_allclose(read(radiance(path)).pixels[0, 0], (1, 0.5, 0.25), rtol=0.01)
    assert (
        opened(radiance(path, b"EXPOSURE=2\nEXPOSURE=4\n")).notes[0].endswith("its EXPOSURE of 8 is not taken out")
    )
    wide = read(radiance(path, b"PRIMARIES=0.708 0.292 0.17 0.797 0.131 0.046 0.3127 0.329\n"))
    assert wide.pixels[0, 0, 0] > 1.1
    assert "order that is not read" in problem(radiance(path, order=b"+Y 2 +X 2"))
    assert problem(radiance(path, order=b"-Y 50000 +X 50000")).startswith("is too large: 50000 x 50000 px")
    assert "truncated or broken HDR" in problem(radiance(path, b"PRIMARIES=1 2\n"))


@pytest.mark.parametrize("count", [1, 3, 4])
def test_dds(tmp_path: Path, values: np.ndarray, count: int) -> None:
    PIL.Image.fromarray(values[..., :count].squeeze()).save(path := tmp_path / "a.dds")
    np.testing.assert_array_equal(coded(read(path), 255), values[..., :count])


@pytest.mark.parametrize("kind", ["DXT1", "DXT3", "DXT5", "BC3"])
def test_dds_in_blocks(tmp_path: Path, kind: str) -> None:
    picture = PIL.Image.new("RGBA", (16, 8), (200, 100, 40, 255))
    picture.save(path := tmp_path / "a.dds", pixel_format=kind)
    assert np.abs(coded(read(path), 255) - np.array([200, 100, 40, 255])).max() <= 8


def test_dds_of_normals_gets_a_blue(tmp_path: Path) -> None:
    PIL.Image.new("RGB", (16, 8), (128, 204, 0)).save(path := tmp_path / "a.dds", pixel_format="BC5")
    seen = inspect(str(path), data=True)
    assert seen.note == "has two channels (BC5): blue is computed, so that normals have length 1"
    with path.open("rb") as file:
        from texloom.pipelines.media.decode import read_header

        vectors = read_header(file, data=True).decode() * 2 - 1
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=2), 1, atol=0.01)


def test_dds_of_floats_is_refused(tmp_path: Path) -> None:
    PIL.Image.new("RGBA", (16, 8)).save(path := tmp_path / "a.dds", pixel_format="BC3")
    content = bytearray(path.read_bytes())
    content[84:88], content[128:132] = b"DX10", struct.pack("<I", 95)
    path.write_bytes(content)
    assert problem(path) == "is BC6H, whose floats are not read; save it as EXR"


def psd(path: Path, planes: np.ndarray, depth: int) -> Path:
    """Flattened planes, (c, h, w), without layers."""
    count, height, width = planes.shape
    head = struct.pack(">4sH6xHIIHH", b"8BPS", 1, count, height, width, depth, 3 if count > 2 else 1)
    path.write_bytes(head + bytes(12) + bytes(2) + planes.astype({8: ">u1", 16: ">u2", 32: ">f4"}[depth]).tobytes())
    return path


@pytest.mark.parametrize("count", [1, 3, 4])
def test_psd(tmp_path: Path, values: np.ndarray, count: int) -> None:
    path = psd(tmp_path / "a.psd", np.moveaxis(values[..., :count], 2, 0), 8)
    np.testing.assert_array_equal(coded(read(path), 255), values[..., :count])


@pytest.mark.skipif(importlib.util.find_spec("psd_tools") is None, reason="texloom[photos] is not installed")
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_deep_psd(tmp_path: Path, rng: np.random.Generator, count: int) -> None:
    codes = rng.integers(0, 65536, (count, 5, 7))
    image = read(psd(tmp_path / "a.psd", codes, 16))
    np.testing.assert_array_equal(coded(image, 65535), np.moveaxis(codes, 0, 2))
    light = rng.random((count, 5, 7), np.float32) * 9
    np.testing.assert_array_equal(read(psd(tmp_path / "b.psd", light, 32)).pixels, np.moveaxis(light, 0, 2))


def test_deep_psd_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = psd(tmp_path / "a.psd", np.zeros((3, 4, 4)), 16)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert problem(path) == "is a PSD of over 8 bits, which needs psd_tools; pip install 'texloom[photos]'"


@pytest.mark.parametrize("suffix", [".jp2", ".j2k"])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_jpeg_2000(tmp_path: Path, values: np.ndarray, count: int, suffix: str) -> None:
    PIL.Image.fromarray(values[..., :count].squeeze()).save(path := tmp_path / f"a{suffix}", irreversible=False)
    np.testing.assert_array_equal(coded(read(path), 255), values[..., :count])


@pytest.mark.parametrize("count", [1, 3])
def test_deep_jpeg_2000(tmp_path: Path, rng: np.random.Generator, count: int) -> None:
    codes = rng.integers(0, 65536, (96, 80, count)).astype(np.uint16)
    options = [cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, 1000]
    cv2.imwrite(str(path := tmp_path / "a.jp2"), codes[..., ::-1] if count == 3 else codes, options)
    image = read(path)
    assert opened(path).bits == 16
    np.testing.assert_allclose(coded(image, 65535), codes, atol=8)


def test_gif(tmp_path: Path) -> None:
    PIL.Image.new("RGB", (6, 4), (200, 100, 40)).save(path := tmp_path / "a.gif")
    np.testing.assert_array_equal(coded(read(path), 255)[1, 1], (200, 100, 40))


# AVIF and HEIC


def avif(path: Path, picture: PIL.Image.Image, **options: object) -> Path:
    from PIL import features

    if not features.check("avif"):
        pytest.skip("this Pillow has no AVIF")
    picture.save(path, quality=100, subsampling="4:4:4", **options)
    return path


def test_avif(tmp_path: Path) -> None:
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    picture = PIL.Image.new("RGBA", (20, 12), (200, 100, 40, 100))
    path = avif(tmp_path / "a.avif", picture, exif=exif)
    image = read(path)
    assert image.pixels.shape == (20, 12, 4)
    assert np.abs(coded(image, 255) - np.array([200, 100, 40, 100])).max() <= 2


def test_deep_avif(tmp_path: Path) -> None:
    cv2.imwrite(
        str(path := tmp_path / "a.avif"),
        np.full((12, 20, 3), 401, np.uint16),
        [cv2.IMWRITE_AVIF_DEPTH, 10, cv2.IMWRITE_AVIF_QUALITY, 100],
    )
    image = read(path)
    assert opened(path).bits == 16
    np.testing.assert_allclose(coded(image, 1023), 401, atol=1)


def test_code_points_of_avif_count(tmp_path: Path) -> None:
    path = avif(tmp_path / "a.avif", PIL.Image.new("RGB", (20, 12), (148, 148, 148)))
    content = path.read_bytes()
    at = content.index(b"colrnclx") + 8
    path.write_bytes(content[:at] + struct.pack(">HH", 9, 16) + content[at + 4 :])
    np.testing.assert_allclose(read(path).pixels, 1, atol=0.05)  # PQ of 203 cd/m2
    assert "PQ" in opened(path).notes[0]


@pytest.mark.skipif(importlib.util.find_spec("pillow_heif") is None, reason="texloom[photos] is not installed")
@pytest.mark.parametrize("mode", ["RGB", "RGBA", "RGB;16"])
def test_heic(tmp_path: Path, mode: str) -> None:
    import pillow_heif

    kind, largest = (np.uint16, 65535) if "16" in mode else (np.uint8, 255)
    pixel = np.array([0.8, 0.4, 0.2, 0.5][: 4 if mode == "RGBA" else 3]) * largest
    levels = np.broadcast_to(pixel.astype(kind), (12, 20, len(pixel)))
    path = tmp_path / "a.heic"
    pillow_heif.from_bytes(mode, (20, 12), levels.tobytes()).save(path, quality=-1, chroma=444)
    image = read(path)
    assert np.abs(coded(image, largest) / largest - pixel / largest).max() <= 0.01
    assert opened(path).bits == (16 if "16" in mode else 8)


def test_heic_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path := tmp_path / "a.heic").write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(40))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert problem(path) == "is HEIC, which needs pillow_heif; pip install 'texloom[photos]'"
    assert formats.readable()["HEIC"] == "pillow_heif"


# Other colours


def table_profile(space: bytes) -> bytes:
    """An ICC profile of one table of two nodes an axis: CMYK of rough inks, or RGB whose mean is L of Lab."""
    count = 4 if space == b"CMYK" else 3
    nodes = []
    for index in range(2**count):
        inks = [index >> (count - 1 - place) & 1 for place in range(count)]
        lightness = max(0, 1 - inks[3] - sum(inks[:3]) / 3) if count == 4 else sum(inks) / 3
        nodes += [int(255 * lightness), 128, 128]
    identity = bytes(range(256))
    sizes = bytes([count, 3, 2, 0]) + struct.pack(">9i", 65536, 0, 0, 0, 65536, 0, 0, 0, 65536)
    table = b"mft1" + bytes(4) + sizes + identity * count + bytes(nodes) + identity * 3
    start = struct.pack(">I4sI4s4s4s12x4s", 144 + len(table), b"none", 0x02400000, b"prtr", space, b"Lab ", b"acsp")
    head = (start.ljust(68, b"\0") + struct.pack(">3i", 63190, 65536, 54061)).ljust(128, b"\0")
    return head + struct.pack(">I4sII", 1, b"A2B0", 144, len(table)) + table


def test_cmyk_without_a_profile(tmp_path: Path) -> None:
    PIL.Image.new("CMYK", (8, 8), (0, 255, 255, 0)).save(path := tmp_path / "a.tif")
    np.testing.assert_array_equal(coded(read(path), 255)[0, 0], (255, 0, 0))
    assert "is CMYK without a profile" in opened(path).notes[0]
    assert opened(path).channels == ("R", "G", "B")
    with pytest.raises(Exception, match="is a CMYK picture"):
        inspect(str(path), data=True)


def test_cmyk_by_its_profile(tmp_path: Path) -> None:
    profile = table_profile(b"CMYK")
    PIL.Image.new("CMYK", (8, 8), (128, 128, 128, 0)).save(path := tmp_path / "a.tif", icc_profile=profile)
    assert np.abs(coded(read(path), 255) - 118).max() <= 1  # L 50
    assert "CMYK is converted by its ICC profile to sRGB of 8 bits" in opened(path).notes[0]


@pytest.mark.parametrize("count", [3, 4])
def test_colour_by_a_profile_of_tables(tmp_path: Path, values: np.ndarray, count: int) -> None:
    levels = np.full((8, 8, count), 128, np.uint8)
    levels[..., 3:] = 77
    PIL.Image.fromarray(levels).save(path := tmp_path / "a.png", icc_profile=table_profile(b"RGB "))
    found = coded(read(path), 255)
    assert np.abs(found[..., :3] - 119).max() <= 1
    assert (found[..., 3:] == 77).all()
    np.testing.assert_array_equal(inspect(str(path), data=True).note, "")
    cv2.imwrite(str(path := tmp_path / "b.tif"), np.zeros((8, 8, 3), np.uint16))
    assert read(path).pixels.max() == 0


def test_profiles_of_tables_with_16_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("imagecodecs")
    options: dict[str, Any] = {"metadata": None, "iccprofile": table_profile(b"RGB ")}
    steps = np.linspace(20000, 40000, 96).round().reshape(8, 12, 1).repeat(3, axis=2).astype(np.uint16)
    tifffile.imwrite(path := tmp_path / "a.tif", steps, photometric="rgb", **options)
    assert len(np.unique(read(path).pixels[..., 0])) == 96  # 30 in 8 bits
    assert "converted by its ICC profile" in opened(path).notes[0]
    mid = np.full((8, 12, 4), 32896, np.uint16)
    tifffile.imwrite(path, mid[..., :3], photometric="rgb", **options)
    assert np.abs(coded(read(path), 255) - 119).max() <= 1
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert "which needs imagecodecs" in problem(path)
    monkeypatch.undo()
    mid[..., 3] = 0
    options["iccprofile"] = table_profile(b"CMYK")
    tifffile.imwrite(path, mid, photometric="separated", **options)
    assert np.abs(coded(read(path), 255) - 118).max() <= 1
    del options["iccprofile"]
    tifffile.imwrite(path, mid, photometric="separated", **options)
    assert np.abs(coded(read(path), 65535) - 32639).max() <= 1
    assert "is CMYK without a profile" in opened(path).notes[0]


def test_lab(tmp_path: Path) -> None:
    lab = ImageCms.profileToProfile(
        PIL.Image.new("RGB", (8, 8), (200, 100, 40)),
        ImageCms.createProfile("sRGB"),
        ImageCms.createProfile("LAB"),
        outputMode="LAB",
    )
    del lab.info["icc_profile"]
    lab.save(path := tmp_path / "a.tif")
    assert np.abs(coded(read(path), 255) - np.array([200, 100, 40])).max() <= 3
    assert "taken as CIE Lab (D50)" in opened(path).notes[0]


def test_lab_of_16_bits(tmp_path: Path) -> None:
    """The values of littleCMS for 8 bits; steps that 8 bits do not have are kept, and ICC's codes are refused."""
    colours = np.linspace(0, 255, 64 * 3).reshape(8, 8, 3).astype(np.uint8)[:, ::-1]
    spaces = ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB")
    lab = np.asarray(ImageCms.profileToProfile(PIL.Image.fromarray(colours), *spaces, outputMode="LAB"))
    codes = np.dstack([lab[..., 0] * np.uint16(257), lab[..., 1:].astype(np.uint16) << 8])
    tifffile.imwrite(path := tmp_path / "a.tif", codes, photometric="cielab")
    assert np.abs(coded(read(path), 255) - colours).max() <= 3
    assert "is converted from CIE Lab (D50)" in opened(path).notes[0]
    assert opened(path).bits == 16
    before, near = read(path).pixels, codes.copy()
    near[..., 0] ^= 1
    tifffile.imwrite(path, near, photometric="cielab")
    assert (read(path).pixels != before).any(axis=2).all()
    tifffile.imwrite(path, codes, photometric="icclab")
    assert problem(path) == "is Lab, but not plain CIE L*a*b* of 8 or 16 bits; save it as RGB of 16 bits"


@pytest.mark.parametrize("suffix", ["gif", "webp", "png"])
def test_only_the_first_frame_is_read_and_that_is_told(tmp_path: Path, suffix: str) -> None:
    first, second = (PIL.Image.new("RGB", (8, 8), (level, level, level)) for level in (200, 20))
    first.save(path := tmp_path / f"a.{suffix}", save_all=True, append_images=[second], lossless=True)
    assert np.abs(coded(read(path), 255)[..., :3] - 200).max() <= 1
    assert opened(path).notes[0].endswith("has several frames, of which the first is read")


def test_an_orientation_that_is_applied_is_told(tmp_path: Path, values: np.ndarray) -> None:
    """As another map of the material may lack it."""
    exif = PIL.Image.Exif()
    exif[0x112] = 6
    PIL.Image.fromarray(values[..., :3]).save(path := tmp_path / "a.jpg", exif=exif)
    assert opened(path).notes[0].endswith("is turned as its EXIF orientation says")


def test_an_archive_is_named(tmp_path: Path) -> None:
    with zipfile.ZipFile(path := tmp_path / "Rock023_1K-PNG.zip", "w") as archive:
        archive.writestr("a.png", b"")
    assert problem(path) == "is a ZIP archive; unpack it, and give its folder"


def test_a_broken_cmyk_profile(tmp_path: Path) -> None:
    PIL.Image.new("CMYK", (8, 8)).save(path := tmp_path / "a.jpg", icc_profile=bytes(200))
    assert problem(path) == "has an ICC profile that littleCMS cannot use; convert it to sRGB"


# TIFF


@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
def test_planar_tiff(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, compression: str | None
) -> None:
    codes = rng.integers(0, 65536, (3, 12, 20)).astype(np.uint16)
    options: dict[str, Any] = {"planarconfig": "separate", "photometric": "rgb", "metadata": None}
    if compression:
        pytest.importorskip("imagecodecs")
        options |= {"compression": compression, "predictor": True}
    tifffile.imwrite(path := tmp_path / "a.tif", codes, **options)
    np.testing.assert_array_equal(coded(read(path), 65535), np.moveaxis(codes, 0, 2))
    light = (codes / 65535).astype(np.float32)
    tifffile.imwrite(path := tmp_path / "b.tif", light, **options)
    np.testing.assert_array_equal(read(path).pixels, np.moveaxis(light, 0, 2))
    if compression:
        monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
        assert problem(path).startswith("is compressed in a way that needs imagecodecs")


@pytest.mark.parametrize("kind", [np.int8, np.int16, np.float16, np.float64])
def test_kinds_of_tiff(tmp_path: Path, rng: np.random.Generator, kind: type) -> None:
    largest = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    values = (rng.uniform(-1, 1, (6, 9)) * largest).astype(kind)
    tifffile.imwrite(path := tmp_path / "a.tif", values, photometric="minisblack", metadata=None)
    np.testing.assert_allclose(read(path).pixels[..., 0], values.astype(float) / largest, rtol=1e-6, atol=1e-7)
    assert bool(opened(path).notes) == np.issubdtype(kind, np.integer)


def test_a_planar_tiff_without_a_strip(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content = encoded("planar")
    offsets = content.index(struct.pack("<HHI", 273, 4, 3))
    (path := tmp_path / "a.tif").write_bytes(content[: offsets + 4] + struct.pack("<I", 1) + content[offsets + 8 :])
    assert "is a truncated or broken TIFF file" in problem(path, decode=True)
    assert capfd.readouterr() == ("", "")


def test_what_is_not_read_of_a_tiff_is_told(tmp_path: Path, rng: np.random.Generator) -> None:
    codes = rng.integers(0, 256, (8, 9, 2)).astype(np.uint8)
    options: dict[str, Any] = {"photometric": "minisblack", "metadata": None}
    tifffile.imwrite(path := tmp_path / "a.tif", codes, planarconfig="contig", extrasamples=[0], **options)
    assert "its last channel is not read" in opened(path).notes[0]
    tifffile.imwrite(path, codes, planarconfig="contig", extrasamples=[2], **options)
    assert opened(path).channels == ("Y", "A")
    assert all("alpha is below a half" in note for note in opened(path).notes)
    tifffile.imwrite(path, np.moveaxis(codes, 2, 0), **options)
    assert "has several pages, of which the first is read" in opened(path).notes[0]


# All of them


def encoded(kind: str) -> bytes:
    rng = np.random.default_rng(1)
    ramp = np.add.outer(np.arange(40) * 3, np.arange(50) * 2)[..., None] + rng.integers(0, 9, (40, 50, 3))
    picture = PIL.Image.fromarray(ramp.astype(np.uint8))
    file = io.BytesIO()
    if kind == "hdr":
        return bytes(cv2.imencode(".hdr", ramp.astype(np.float32))[1])
    if kind == "psd":
        path = io.BytesIO()
        path.write_bytes = path.write  # type: ignore[attr-defined]
        return psd(path, np.moveaxis(ramp, 2, 0), 8).getvalue()  # type: ignore[arg-type]
    if kind == "planar":
        tifffile.imwrite(
            file, np.moveaxis(ramp, 2, 0).astype(np.uint16), planarconfig="separate", photometric="rgb"
        )
    elif kind == "heic":
        pytest.importorskip("pillow_heif").from_pillow(picture).save(file)
    else:
        picture.save(file, {"jp2": "jpeg2000"}.get(kind, kind))
    return file.getvalue()


KINDS = ["tga", "hdr", "dds", "psd", "jp2", "gif", "avif", "heic", "planar"]


@pytest.mark.parametrize("kind", KINDS)
def test_truncation(tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    content = encoded(kind)
    (path := tmp_path / "a").write_bytes(content)
    read(path)
    for share in (0.3, 0.5, 0.8):
        path.write_bytes(content[: int(len(content) * share)])
        assert re.match("is a truncated or broken", problem(path, decode=True))
    assert capfd.readouterr() == ("", "")
