"""Writers by extension, read back by independent libraries where they are installed."""

from __future__ import annotations

import dataclasses
import json
import struct
from pathlib import Path
from typing import Annotated, Any

import cv2
import MaterialX
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from jaxtyping import Float32

from texloom.pipelines.media import conventions
from texloom.pipelines.media.color_spaces import ACESCG, PRIMARIES, REC709, conversion
from texloom.pipelines.media.delivery import AS_IS, LAYOUTS, Delivery, parse_delivery
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.writers import tx
from texloom.pipelines.media.writers.layouts import material_name, write_layout
from texloom.pipelines.media.writers.registry import SUFFIXES, WRITERS, WriteJob, write, writer_of
from texloom.pipelines.store.atomic import file_digest
from texloom.pipelines.store.codec import ArtifactError
from texloom.stages.vocabulary import scratch
from texloom.stages.vocabulary.arrays import Channels, Image, ScalarMap
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Facts, Wraps
from texloom.stages.vocabulary.normals import NORMAL, unit

SIDES = (24, 36)
TEXEL = Delivery(texel_size=0.0005)


@pytest.fixture
def image(rng: np.random.Generator) -> Image:
    """A material with all maps but specular and opacity."""
    pixels = rng.random((*SIDES, 13), np.float32)
    names = (
        "R",
        "G",
        "B",
        *NORMAL,
        "roughness",
        "metallic",
        "ao",
        "height",
        "emissive.R",
        "emissive.G",
        "emissive.B",
    )
    pixels[..., 3:6] = unit(pixels[..., 3:6] * [2, 2, 1] - [1, 1, -0.2])
    return Image(pixels, names)


def plane(image: Image, name: str) -> np.ndarray:
    return image.pixels[..., image.channels.index(name)]


def png(path: Path) -> np.ndarray:
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert values is not None
    return values[..., [2, 1, 0, *range(3, values.shape[2])]] if values.ndim == 3 else values


def codes(values: np.ndarray, largest: int = 255) -> np.ndarray:
    return np.rint(np.clip(values.astype(np.float64), 0, 1) * largest)


def made(path: Path, value: Any, hint: Any = Image, delivery: Delivery = AS_IS, **options: Any) -> Path:
    """The file that a writer has written; all its digests are checked."""
    digests = write(WriteJob(path, value, hint, {"seed": 3}, delivery, **options))
    assert {name: file_digest(path.parent / name if name else path) for name in digests} == digests
    return path


def test_each_suffix_has_its_writer() -> None:
    assert writer_of("a.slopes.tx") is not writer_of("a.tx")
    assert writer_of("texture.bmp") is None
    assert {writer.suffix for writer in WRITERS} - set(SUFFIXES) == {
        ".slopes.tx", ".hex.mtlx", ".wang.mtlx", ".data.png", ".data.dds",
    }  # fmt: skip


@pytest.mark.parametrize("suffix", ["jpg", "webp", "tif"])
def test_pictures(image: Image, tmp_path: Path, suffix: str) -> None:
    smooth = Image(cv2.GaussianBlur(image.pixels, (0, 0), 4), image.channels)
    path = made(tmp_path / f"a.{suffix}", smooth)
    expected = srgb_from_linear(smooth.color.astype(np.float64))
    if suffix == "tif":
        np.testing.assert_array_equal(png(path), np.rint(expected * 65535))
        return
    found = np.asarray(PIL.Image.open(path), float)
    assert np.abs(found - np.rint(expected * 255)).max() <= (0 if suffix == "webp" else 6)


def test_fields_as_tiff_are_floats(tmp_path: Path, rng: np.random.Generator) -> None:
    field = rng.normal(size=(9, 7)).astype(np.float32)
    np.testing.assert_array_equal(png(made(tmp_path / "field.tif", field, ScalarMap)), field)


def test_data_as_png_has_16_bits_and_is_not_stretched(tmp_path: Path, rng: np.random.Generator) -> None:
    planes = (rng.random((6, 5, 4)) * 0.5 + 0.2).astype(np.float32)
    hint = Annotated[Float32[np.ndarray, "h w 4"], Channels(("R", "G", "B", "A"))]
    np.testing.assert_array_equal(png(made(tmp_path / "a.data.png", planes, hint)), codes(planes, 65535))
    field = planes[..., 0].copy()
    with PIL.Image.open(made(tmp_path / "a.data.dds", planes, hint)) as dds:
        np.testing.assert_array_equal(np.asarray(dds), codes(planes, 255))
    np.testing.assert_array_equal(png(made(tmp_path / "b.data.png", field, ScalarMap)), codes(field, 65535))


def test_data_that_a_png_cannot_hold_is_refused(image: Image, tmp_path: Path) -> None:
    hint = Float32[np.ndarray, "h w c"]
    for value, kind, message in (
        (np.full((3, 3), 1.5, np.float32), ScalarMap, "outside of 0..1"),
        (np.full((3, 3), np.nan, np.float32), ScalarMap, "outside of 0..1"),
        (np.zeros((3, 3, 5), np.float32), hint, "at most 4 planes"),
        (image, Image, "export it as .png"),
    ):
        with pytest.raises(ArtifactError, match=message):
            write(WriteJob(tmp_path / "a.data.png", value, kind, {}))
    assert not list(tmp_path.iterdir())


def test_alpha_of_pictures(tmp_path: Path, rng: np.random.Generator) -> None:
    picture = Image(rng.random((8, 9, 4), np.float32), ("R", "G", "B", "A"))
    assert np.asarray(PIL.Image.open(made(tmp_path / "a.jpg", picture))).shape == (8, 9, 3)
    for name in ("a.webp", "a.tif"):
        values = png(made(tmp_path / name, picture))
        np.testing.assert_array_equal(values[..., 3], codes(picture.pixels[..., 3], np.iinfo(values.dtype).max))


@pytest.mark.parametrize("suffix", ["tga", "dds"])
@pytest.mark.parametrize("channels", ["Y", "RGB", "RGBA"])
def test_pictures_of_games(tmp_path: Path, rng: np.random.Generator, suffix: str, channels: str) -> None:
    picture = Image(rng.random((8, 9, len(channels)), np.float32), tuple(channels))
    as_png = png(made(tmp_path / "a.png", picture))
    found = PIL.Image.open(made(tmp_path / f"a.{suffix}", picture))
    np.testing.assert_array_equal(np.asarray(found), as_png)


def test_radiance(tmp_path: Path, rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    light = rng.random((8, 40, 3), np.float32) * 90
    found = open_source("a", str(made(tmp_path / "a.hdr", Image(light, ("R", "G", "B"))))).read()
    assert np.abs(found.pixels - light).max() <= light.max() / 128
    assert found.pixels.max() > 80
    assert not caplog.text
    light[0, 0, 0] = -1
    made(tmp_path / "a.hdr", Image(light, ("R", "G", "B")))
    assert "0.1 % of the values are negative and were set to 0" in caplog.text
    field = made(tmp_path / "b.hdr", light[..., 1], ScalarMap)
    grey = open_source("b", str(field)).read()
    assert np.abs(grey.pixels - light[..., 1:2]).max() <= light.max() / 128


def test_sizes_are_bounded(tmp_path: Path) -> None:
    wide = Image(np.zeros((1, 17000, 1), np.float32), ("Y",))
    with pytest.raises(ArtifactError, match=r"17000 x 1 px, \.webp holds at most 16383 px a side"):
        write(WriteJob(tmp_path / "a.webp", wide, Image, {}))
    assert not any(tmp_path.iterdir())


def test_exr_tells_its_colour_space_and_size(image: Image, tmp_path: Path) -> None:
    header = OpenEXR.File(str(made(tmp_path / "a.exr", image, delivery=TEXEL))).parts[0].header
    assert header["colorInteropID"] == REC709
    np.testing.assert_allclose(header["chromaticities"], PRIMARIES[REC709], atol=1e-6)
    assert header["xDensity"] == pytest.approx(50.8)
    field = OpenEXR.File(str(made(tmp_path / "b.exr", plane(image, "height"), ScalarMap))).parts[0].header
    assert field["colorInteropID"] == "data"
    assert "chromaticities" not in field


def test_acescg_out_and_in(image: Image, tmp_path: Path) -> None:
    path = made(tmp_path / "a.exr", image, delivery=Delivery(color_space=ACESCG))
    part = OpenEXR.File(str(path), separate_channels=True).parts[0]
    assert part.header["colorInteropID"] == ACESCG
    matrix = conversion(PRIMARIES[REC709], PRIMARIES[ACESCG])
    found = np.stack([part.channels[name].pixels for name in "RGB"], axis=2)
    np.testing.assert_allclose(found, image.color @ matrix.T, atol=1e-6)
    again = open_source("exemplar", str(path)).read()
    for name in image.channels:
        tolerance = 1e-6 if name in "RGB" else 0
        expected = plane(image, name) if not name.startswith("emissive") else plane(again, name)
        np.testing.assert_allclose(plane(again, name), expected, atol=tolerance, err_msg=name)


# -- tx


def read_tx(path: Path) -> tuple[Any, np.ndarray, int]:
    """The specification, the pixels and the number of levels."""
    oiio = pytest.importorskip("OpenImageIO")
    opened = oiio.ImageInput.open(str(path))
    spec = opened.spec()
    levels = 0
    while opened.seek_subimage(0, levels):
        levels += 1
    opened.close()
    return spec, np.asarray(oiio.ImageBuf(str(path)).get_pixels("float")), levels


@pytest.mark.parametrize("is_tileable", [True, False])
def test_tx_of_colour(image: Image, tmp_path: Path, is_tileable: bool) -> None:
    pytest.importorskip("OpenImageIO")
    spec, pixels, levels = read_tx(made(tmp_path / "a.tx", image.wrapping(is_tileable), delivery=TEXEL))
    np.testing.assert_allclose(pixels, image.color, rtol=2**-11)  # half floats
    assert (spec.tile_width, spec.tile_height, levels, str(spec.format)) == (64, 64, 6, "half")
    wrap = "periodic" if is_tileable else "clamp"
    assert spec["wrapmodes"] == f"{wrap},{wrap}"
    assert spec["colorInteropID"] == REC709
    assert spec["XResolution"] == pytest.approx(50.8)


def test_tx_is_repeatable_and_takes_fields(image: Image, tmp_path: Path) -> None:
    pytest.importorskip("OpenImageIO")
    height = plane(image, "height")
    first, again = (made(tmp_path / name, height, ScalarMap) for name in ("a.tx", "b.tx"))
    assert first.read_bytes() == again.read_bytes()
    spec, pixels, _ = read_tx(first)
    np.testing.assert_array_equal(pixels[..., 0], height)
    assert spec["colorInteropID"] == "data"


def test_tx_of_large_pictures_is_made_from_a_file(
    image: Image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    monkeypatch.setattr(tx, "LARGE", 100)
    large = made(tmp_path / "large.tx", image)
    monkeypatch.undo()
    small = made(tmp_path / "small.tx", image)
    for level in range(read_tx(small)[2]):
        one, other = (oiio.ImageBuf(str(path), 0, level).get_pixels("float") for path in (small, large))
        np.testing.assert_array_equal(one, other)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["large.tx", "small.tx"]


def test_slopes_of_heights(image: Image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("OpenImageIO")
    height = plane(image, "height").astype(np.float64)
    whole = made(tmp_path / "a.slopes.tx", image.wrapping(True))
    monkeypatch.setattr(scratch, "_BAND", 5)
    with scratch.using(scratch.Scratch(tmp_path, 0)):
        assert made(tmp_path / "bands.slopes.tx", image.wrapping(True)).read_bytes() == whole.read_bytes()
    spec, pixels, _ = read_tx(whole)
    assert spec.channelnames == ("b0_h", "b1_dhds", "b2_dhdt", "b3_dhds2", "b4_dhdt2", "b5_dh2dsdt")
    np.testing.assert_array_equal(pixels[..., 0], plane(image, "height"))
    for index, (kernel, square) in enumerate([(cv2.Sobel, 3), (cv2.Sobel, 4)]):
        padded = np.pad(height, 1, mode="wrap")
        slope = kernel(padded, cv2.CV_64F, 1 - index, index, ksize=3)[1:-1, 1:-1] / 8
        np.testing.assert_allclose(pixels[..., 1 + index], slope, atol=1e-6)
        np.testing.assert_allclose(pixels[..., square], slope**2, atol=1e-6)
    colored = Image(image.pixels[..., :3], ("R", "G", "B"))
    with pytest.raises(ArtifactError, match="slopes are made from heights"):
        write(WriteJob(tmp_path / "b.slopes.tx", colored, Image, {}))


# -- documents


def test_usda(image: Image, tmp_path: Path) -> None:
    path = made(tmp_path / "moss.usda", image, delivery=TEXEL)
    assert not (path.parent / "material.usda").exists()
    pxr = pytest.importorskip("pxr")
    from pxr import Sdf, Usd, UsdGeom, UsdShade

    assert pxr
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/moss/plane"))
    size = np.ptp(np.array(mesh.GetPointsAttr().Get()), axis=0)
    np.testing.assert_allclose(size[:2], [0.018, 0.012], rtol=1e-6)
    material = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
    shader = material.ComputeSurfaceSource()[0]
    assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
    files = {}
    for entry in shader.GetInputs():
        texture = UsdShade.Shader(entry.GetConnectedSources()[0][0].source)
        asset = texture.GetInput("file").Get()
        assert isinstance(asset, Sdf.AssetPath)
        assert Path(asset.resolvedPath).is_file()
        files[entry.GetBaseName()] = (Path(asset.path).name, texture.GetInput("sourceColorSpace").Get())
    assert files == {
        "diffuseColor": ("moss_base_color.png", "sRGB"),
        "emissiveColor": ("moss_emissive.png", "sRGB"),
        "normal": ("moss_normal.png", "raw"),
        "roughness": ("moss_roughness.png", "raw"),
        "metallic": ("moss_metallic.png", "raw"),
        "occlusion": ("moss_ao.png", "raw"),
        "displacement": ("moss_height.png", "raw"),
    }
    height = UsdShade.Shader(stage.GetPrimAtPath("/moss/moss/height"))
    assert height.GetInput("scale").Get()[0] == pytest.approx(0.05 * 0.018)


def validated(path: Path) -> Any:
    """A MaterialX document that is valid."""
    library = MaterialX.createDocument()
    folders, paths = MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(folders, paths, library)
    document = MaterialX.createDocument()
    MaterialX.readFromXmlFile(document, str(path))
    document.setDataLibrary(library)
    valid, problems = document.validate()
    assert valid, problems
    return document


def test_mtlx(image: Image, tmp_path: Path) -> None:
    document = validated(made(tmp_path / "moss.mtlx", image, delivery=TEXEL))
    images = document.getNodes("tiledimage")
    assert len(images) == 7
    for node in images:
        assert (tmp_path / node.getInputValue("file")).is_file()
        assert node.getInput("realworldimagesize").getUnit() == "meter"
        np.testing.assert_allclose(node.getInputValue("realworldimagesize").asTuple(), [0.018, 0.012], rtol=1e-6)
    (displacement,) = document.getNodes("displacement")
    assert displacement.getInputValue("scale") == pytest.approx(0.05 * 0.018)
    plain = validated(made(tmp_path / "plain.mtlx", image))
    assert len(plain.getNodes("image")) == 7


def test_hex_tiled_mtlx(image: Image, tmp_path: Path) -> None:
    document = validated(made(tmp_path / "moss.hex.mtlx", image, delivery=TEXEL))
    images = [*document.getNodes("hextiledimage"), *document.getNodes("hextilednormalmap")]
    assert len(images) == 7
    assert len(document.getNodes("extract")) == 4
    for node in images:
        assert (tmp_path / node.getInputValue("file")).is_file()
        assert node.getInputValue("file").startswith("moss_hex_maps/")
    assert document.getNode("moss_shader").getInput("normal").getConnectedNode() == images[-1]


def test_glb(image: Image, tmp_path: Path) -> None:
    path = made(tmp_path / "moss.glb", image, delivery=TEXEL)
    content = path.read_bytes()
    assert struct.unpack("<4sII", content[:12]) == (b"glTF", 2, len(content))
    pygltflib = pytest.importorskip("pygltflib")
    scene = pygltflib.GLTF2().load(str(path))
    assert (len(scene.images), len(scene.textures), len(scene.bufferViews)) == (4, 4, 9)
    (material,) = scene.materials
    packed = material.occlusionTexture.index
    assert material.pbrMetallicRoughness.metallicRoughnessTexture.index == packed
    blob = scene.binary_blob()

    def decoded(texture: int) -> np.ndarray:
        view = scene.bufferViews[scene.images[scene.textures[texture].source].bufferView]
        data = np.frombuffer(blob[view.byteOffset : view.byteOffset + view.byteLength], np.uint8)
        return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[..., ::-1]

    orm = np.stack([plane(image, name) for name in ("ao", "roughness", "metallic")], axis=2)
    np.testing.assert_array_equal(decoded(packed), codes(orm))
    normals = np.stack([plane(image, name) for name in NORMAL], axis=2)
    np.testing.assert_array_equal(decoded(material.normalTexture.index), codes((normals + 1) / 2))
    low, high = scene.accessors[1].min, scene.accessors[1].max
    np.testing.assert_allclose(np.subtract(high, low)[:2], [0.018, 0.012], rtol=1e-6)


# -- layouts


def test_the_names_of_layouts_agree() -> None:
    assert {*LAYOUTS} == {*conventions.LAYOUTS, "same"} - {"short_specular"}


@pytest.mark.parametrize(
    ("layout", "names", "green", "bits"),
    [
        ("unreal", "T_moss_BC T_moss_ORM T_moss_N T_moss_H T_moss_E", -1, 8),
        ("unity", "moss_BaseMap moss_MaskMap moss_Normal moss_HeightMap moss_Emissive", 1, 8),
        (
            "blender",
            "moss_base_color moss_roughness moss_metallic moss_normal moss_height moss_ao moss_emissive",
            *(1, 16),
        ),
        ("gltf", "moss_baseColor moss_occlusionRoughnessMetallic moss_normal moss_emissive", 1, 8),
        (
            "substance",
            "moss_basecolor moss_normal moss_roughness moss_metallic moss_ambientocclusion moss_height "
            "moss_emissive",
            *(-1, 16),
        ),
    ],
)
def test_layouts(image: Image, tmp_path: Path, layout: str, names: str, green: int, bits: int) -> None:
    written = write_layout(image, tmp_path / "out", "moss", Delivery(layout), {})
    assert {name.removesuffix(".png") for name in written if name.endswith(".png")} == set(names.split())
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(written)
    files = {name.rpartition("_")[2].removesuffix(".png").lower(): png(tmp_path / "out" / name) for name in written
             if name.endswith(".png")}  # fmt: skip
    normal = files.get("normal", files.get("n"))
    assert normal is not None
    assert normal.dtype.itemsize * 8 == bits
    vectors = np.stack([plane(image, name) for name in NORMAL], axis=2) * [1, green, 1]
    np.testing.assert_allclose(normal / np.iinfo(normal.dtype).max * 2 - 1, vectors, atol=2 / 2**bits)
    height = next((files[name] for name in ("height", "h", "heightmap") if name in files), None)
    assert (height is None) == (layout == "gltf")
    assert height is None or height.dtype == np.uint16
    orm = files.get("orm", files.get("occlusionroughnessmetallic"))
    if orm is not None:
        for index, name in enumerate(("ao", "roughness", "metallic")):
            np.testing.assert_array_equal(orm[..., index], codes(plane(image, name)))
    if layout == "unity":
        mask = files["maskmap"]
        np.testing.assert_array_equal(mask[..., 3], 255 - codes(plane(image, "roughness")))
        np.testing.assert_array_equal(mask[..., 0], codes(plane(image, "metallic")))
        assert (mask[..., 2] == 255).all()


@pytest.mark.parametrize(("layout", "green"), [("substance", "down"), ("blender", "up")])
def test_our_normals_say_where_green_points(image: Image, tmp_path: Path, layout: str, green: str) -> None:
    write_layout(image, tmp_path / "out", "moss", Delivery(layout), {})
    albedo = next((tmp_path / "out").glob("moss_base*color.png"))
    listing = tmp_path / "moss.yaml"
    listing.write_text(f"albedo: {albedo}\nnormal: {tmp_path}/out/moss_normal.png\n")
    again = open_source("exemplar", str(listing)).read()
    assert again.facts.maps["normal"].green == green
    np.testing.assert_allclose(plane(again, NORMAL[1]), plane(image, NORMAL[1]), atol=1e-4)


def test_packed_maps_that_a_material_lacks(tmp_path: Path, rng: np.random.Generator) -> None:
    image = Image(rng.random((*SIDES, 4), np.float32), ("R", "G", "B", "roughness"))
    write_layout(image, tmp_path, "moss", Delivery("unreal"), {})
    orm = png(tmp_path / "T_moss_ORM.png")
    assert (orm[..., 0] == 255).all()
    assert (orm[..., 2] == 0).all()
    plain = Image(image.pixels[..., :3], ("R", "G", "B"))
    assert set(write_layout(plain, tmp_path / "plain", "moss", Delivery("unreal"), {})) == {"T_moss_BC.png"}


def test_the_layout_of_arnold(image: Image, tmp_path: Path) -> None:
    pytest.importorskip("OpenImageIO")
    delivery = Delivery("arnold", 0.001, ACESCG)
    write_layout(image.wrapping(True), tmp_path, "moss", delivery, {})
    spec, pixels, _ = read_tx(tmp_path / "moss_baseColor.tx")
    assert spec["colorInteropID"] == ACESCG
    np.testing.assert_allclose(pixels, delivery.encoded(image).color, rtol=2**-10, atol=1e-6)
    spec, pixels, _ = read_tx(tmp_path / "moss_height.tx")
    assert (spec["colorInteropID"], str(spec.format), spec["wrapmodes"]) == ("data", "float", "periodic,periodic")
    np.testing.assert_array_equal(pixels[..., 0], plane(image, "height"))
    document = validated(tmp_path / "moss.mtlx")
    (shader,) = document.getNodes("standard_surface")
    inputs = {"base_color", "specular_roughness", "metalness", "normal", "emission", "emission_color"}
    assert {entry.getName() for entry in shader.getInputs()} == inputs
    color = shader.getConnectedNode("base_color")
    assert color.getInput("file").getColorSpace() == "acescg"


def test_udim_tiles_continue_each_other(image: Image, tmp_path: Path) -> None:
    write_layout(image.wrapping(True), tmp_path / "whole", "moss", Delivery("blender"), {})
    written = write_layout(image.wrapping(True), tmp_path / "tiles", "moss", Delivery("blender", udim=(2, 3)), {})
    numbers = ("1001", "1002", "1003", "1011", "1012", "1013")
    tiles = {number: png(tmp_path / "tiles" / f"moss_base_color.{number}.png") for number in numbers}
    assert len([name for name in written if name.startswith("moss_base_color.")]) == 6
    lower, upper = (np.concatenate([tiles[number] for number in row], axis=1) for row in (numbers[:3], numbers[3:]))
    whole = png(tmp_path / "whole" / "moss_base_color.png")
    np.testing.assert_array_equal(np.concatenate([upper, lower]), whole)
    assert "moss_base_color.<UDIM>.png@" in (tmp_path / "tiles" / "moss.usda").read_text()
    with pytest.raises(ArtifactError, match="36 x 24 px cannot be cut into 3x5 equal tiles"):
        write_layout(image.wrapping(True), tmp_path / "no", "moss", Delivery("blender", udim=(5, 3)), {})


@pytest.mark.parametrize(
    ("text", "name"),
    [
        *(("moss", "moss"), ("Rough stone, 2K", "Rough_stone_2K"), ("007", "material_007"), ("", "material")),
        *(("石垣 2K", "石垣_2K"), ("Blo\u0308cke", "Bl\u00f6cke")),
    ],
)
def test_names_of_materials(image: Image, tmp_path: Path, text: str, name: str) -> None:
    assert material_name(text) == name
    for layout in ("blender", "materialx"):
        write_layout(image, tmp_path, name, Delivery(layout), {})
    material = validated(tmp_path / f"{name}.mtlx").getNodes("surfacematerial")[0]
    assert f'defaultPrim = "{material.getName()}"' in (tmp_path / f"{name}.usda").read_text()
    assert material.getName().isascii()
    assert f"@{name}_base_color.png@" in (tmp_path / f"{name}.usda").read_text()


def test_options() -> None:
    options = {"layout": "unity", "texel_size": "0.5mm", "color_space": "acescg", "udim": "3x2"}
    assert parse_delivery(options) == Delivery("unity", 0.0005, ACESCG, (2, 3))
    assert parse_delivery({"texel_size": "1in"}).texel_size == pytest.approx(0.0254)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"layout": "unrael"}, "--layout: no layout 'unrael'; did you mean 'unreal'?"),
        ({"color_space": "acesgc"}, "--color-space: no colour space 'acesgc'; did you mean 'acescg'?"),
        ({"texel_size": "0.5"}, "--texel-size: must be a length as 0.5mm"),
        ({"texel_size": "0mm"}, "--texel-size: must be a length"),
        ({"texel_size": "9" * 9 + "m"}, "--texel-size: must be a length"),
        ({"udim": "2x2"}, "--udim: needs a layout"),
        ({"layout": "same", "udim": "2x2"}, "--udim: not with the layout same"),
        ({"layout": "unity", "udim": "11x2"}, "--udim: must be COLUMNSxROWS"),
        ({"layout": "unity", "udim": "1x0"}, "--udim: must be COLUMNSxROWS"),
    ],
)
def test_options_that_are_wrong(options: dict[str, str], words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_delivery(options)
    assert str(caught.value).startswith(words)


def test_provenance_of_layouts(image: Image, tmp_path: Path) -> None:
    write_layout(image, tmp_path, "moss", Delivery("unity"), {"seed": 3})
    with PIL.Image.open(tmp_path / "moss_BaseMap.png") as picture:
        assert json.loads(picture.info["texloom.provenance"]) == {"seed": 3}


def test_documents_repeat_where_the_picture_wraps(image: Image, tmp_path: Path) -> None:
    along = dataclasses.replace(image, facts=Facts(Wraps(across=True)))
    usd = made(tmp_path / "a.usda", along).read_text()
    assert 'wrapS = "repeat"' in usd
    assert 'wrapT = "clamp"' in usd
    assert 'wrapS = "clamp"' not in usd
    materialx = made(tmp_path / "a.mtlx", along).read_text()
    assert 'name="vaddressmode" type="string" value="clamp"' in materialx
    assert "uaddressmode" not in materialx
    assert b'"wrapS":10497,"wrapT":33071' in made(tmp_path / "a.glb", along).read_bytes()
    torus = image.wrapping(True)
    assert "clamp" not in made(tmp_path / "b.usda", torus).read_text()
    assert "addressmode" not in made(tmp_path / "b.mtlx", torus).read_text()
    assert b'"wrapS":10497,"wrapT":10497' in made(tmp_path / "b.glb", torus).read_bytes()
