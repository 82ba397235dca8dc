"""Map sets: roles of files, and their values."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pydantic
import pytest

from tests.conftest import ROOT
from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.media.array_sources import file_source, kinds_of, masked
from texloom.pipelines.media.map_names import recognised
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.store import codec
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import MapFacts
from texloom.stages.vocabulary.normals import NORMAL, rounding, unit

SIDES = (6, 9)


def save(path: Path, values: np.ndarray) -> Path:
    """A PNG of integers, (h, w) or (h, w, R G B)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(
        str(path), values if values.ndim == 2 else values[..., [2, 1, 0, *range(3, values.shape[2])]]
    )
    return path


def colors(rng: np.random.Generator, sides: tuple[int, int] = SIDES) -> np.ndarray:
    return rng.integers(0, 256, (*sides, 3)).astype(np.uint8)


def normals(rng: np.random.Generator, sides: tuple[int, int] = SIDES) -> np.ndarray:
    """Unit vectors in 8 bits."""
    vectors = unit(rng.normal((0, 0, 2), 1, (*sides, 3)).astype(np.float32))
    return np.rint((vectors + 1) / 2 * 255).astype(np.uint8)


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    save(tmp_path / "moss" / "moss_BaseColor.png", colors(rng))
    save(tmp_path / "moss" / "moss_NormalGL.png", normals(rng))
    save(tmp_path / "moss" / "moss_Roughness.png", rng.integers(0, 256, SIDES).astype(np.uint8))
    save(tmp_path / "moss" / "moss_Displacement.png", rng.integers(0, 65536, SIDES).astype(np.uint16))
    return tmp_path / "moss"


def problem(reference: Path) -> str:
    with pytest.raises(InputError) as caught:
        open_source("exemplar", str(reference)).read()
    line = str(caught.value)
    assert line.isprintable()
    return line.removeprefix(f"sources.exemplar: {reference}: ")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("albedo", ("albedo", None)),
        ("Bricks001_1K-JPG_Color", ("albedo", None)),
        ("rock_wall_diff_2k", ("albedo", None)),
        ("Base_Color", ("albedo", None)),
        ("brick_baseColor_4096", ("albedo", None)),
        ("rock_wall_nor_gl_1k", ("normal", "opengl")),
        ("Bricks001_1K_NormalDX", ("normal", "directx")),
        ("normaldx", ("normal", "directx")),
        ("normal-map", ("normal", None)),
        ("wall_ORM", None),
        ("MetalPlates", None),
        ("Metal012_2K_Metalness", ("metallic", None)),
        ("moss AmbientOcclusion", ("ao", None)),
        ("moss_ao_map", ("ao", None)),
        ("wall_DISP16_3K", ("height", None)),
        ("wall_bump", ("bump", None)),
        ("stones_gloss", None),
        ("stones_n", None),
        ("stones_MaskMap", None),
        ("emission", ("emissive", None)),
        ("preview", None),
        ("roughness_gl", None),
        ("2k", None),
    ],
)
def test_names_of_files(name: str, expected: tuple[str, str | None] | None) -> None:
    assert recognised(name) == expected


def test_values_of_every_map(folder: Path) -> None:
    source = open_source("exemplar", str(folder))
    assert source.channels == ("R", "G", "B", *NORMAL, "roughness", "height")
    assert [one.bits for one in source.maps] == [8, 8, 8, 16]
    image = source.read()
    assert (image.height, image.width, image.channels) == (source.height, source.width, source.channels)
    bgr = cv2.imread(str(folder / "moss_BaseColor.png"))
    np.testing.assert_allclose(image.color, linear_from_srgb(bgr[..., ::-1] / 255), rtol=1e-6)
    vectors = image.pixels[..., 3:6]
    assert np.abs(np.linalg.norm(vectors, axis=2) - 1).max() <= rounding(8)
    packed = cv2.imread(str(folder / "moss_NormalGL.png"))[..., ::-1]
    np.testing.assert_array_equal(np.rint((vectors + 1) / 2 * 255), packed)
    height = cv2.imread(str(folder / "moss_Displacement.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(np.rint(image.pixels[..., 7] * 65535), height)
    rough = cv2.imread(str(folder / "moss_Roughness.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image.pixels[..., 6], (rough / 255).astype(np.float32))


def test_sources_travel_as_json(folder: Path) -> None:
    source = open_source("exemplar", str(folder))
    kind = pydantic.TypeAdapter(Source)
    assert kind.validate_json(kind.dump_json(source)) == source


def test_directx_normals_are_turned(folder: Path, rng: np.random.Generator) -> None:
    opengl = open_source("exemplar", str(folder))
    packed = cv2.imread(str(folder / "moss_NormalGL.png"))[..., ::-1].copy()
    (folder / "moss_NormalGL.png").unlink()
    packed[..., 1] = 255 - packed[..., 1]
    save(folder / "moss_NormalDX.png", packed)
    directx = open_source("exemplar", str(folder))
    assert directx.digest != opengl.digest
    before = directx.read().pixels[..., 3:6]
    (folder / "moss_NormalDX.png").rename(folder / "normal.png")
    after = open_source("exemplar", str(folder)).read().pixels[..., 3:6]
    np.testing.assert_array_equal(before, after * np.float32([1, -1, 1]))
    save(folder / "normal_gl.png", normals(rng))
    save(folder / "normal_dx.png", normals(rng))
    assert [Path(one.reference).name for one in open_source("e", str(folder)).maps][1] == "normal_gl.png"


def facts_of(folder: Path) -> dict[str, MapFacts]:
    return dict(open_source("exemplar", str(folder)).read().facts.maps)


def test_maps_know_what_their_names_say(folder: Path) -> None:
    known = facts_of(folder)
    assert known["normal"] == MapFacts(green="up")
    assert known["height"] == known["roughness"] == MapFacts()
    (folder / "moss_NormalGL.png").rename(folder / "moss_Normal.png")
    unsaid = open_source("exemplar", str(folder))
    assert unsaid.read().facts.maps["normal"] == MapFacts()
    (folder / "moss_Normal.png").rename(folder / "moss_NormalDX.png")
    assert facts_of(folder)["normal"] == MapFacts(green="down")
    assert open_source("exemplar", str(folder)).digest != unsaid.digest


def test_heights_in_floats_know_their_range_and_unit(folder: Path) -> None:
    (folder / "moss_Displacement.png").unlink()
    heights = np.linspace(-3, 12, 54, dtype=np.float32).reshape(SIDES)
    assert cv2.imwrite(str(folder / "moss_Displacement.tiff"), heights)
    assert facts_of(folder)["height"] == MapFacts(range=(-3.0, 12.0))
    listing = folder / "moss.yaml"
    listing.write_text("{albedo: moss_BaseColor.png, height: moss_Displacement.tiff, height_unit: mm}")
    image = open_source("exemplar", str(listing)).read()
    assert image.facts.maps["height"] == MapFacts(unit="mm", range=(-3.0, 12.0))
    np.testing.assert_array_equal(image.pixels[..., 3], heights)
    given = masked(str(listing), np.ones(SIDES, bool))
    source = open_source("exemplar", file_source(given, folder / "given"))
    assert source.read().facts == image.facts
    assert [kind.role for kind in kinds_of(source, given)] == ["albedo", "height", "mask"]


def test_normals_are_normalised(folder: Path) -> None:
    packed = np.full((*SIDES, 3), 255, np.uint8)
    packed[0, 0] = 127, 128, 127
    packed[1, 0] = 0, 255, 255
    save(folder / "moss_NormalGL.png", packed)
    vectors = open_source("exemplar", str(folder)).read().pixels[..., 3:6]
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=2), 1, atol=1e-6)
    np.testing.assert_allclose(vectors[1, 0], np.float32([-1, 1, 1]) / np.sqrt(np.float32(3)), rtol=1e-6)
    flat = unit(np.zeros((1, 1, 3), np.float32))
    assert flat.tolist() == [[[0, 0, 1]]]


def test_sets_in_yaml(folder: Path, rng: np.random.Generator) -> None:
    path = folder.parent / "set.yaml"
    save(folder / "moss_small.png", rng.integers(0, 256, (6, 2)).astype(np.uint8))
    text = "basecolor: moss/moss_BaseColor.png\nnormal: moss/moss_NormalGL.png\nao: moss/moss_small.png\n"
    path.write_text(text)
    assert "moss_small.png has 2 x 6 px, moss_BaseColor.png 9 x 6 px; they cannot be resampled" in problem(path)
    save(folder / "moss_small.png", np.full((2, 3), 51, np.uint8))
    path.write_text(f"{text}resample: false\n")
    assert "9 x 6 px; bring them to one size, or leave out 'resample: false'" in problem(path)
    path.write_text(f"{text}resample: true\nnormal_convention: directx\n")
    source = open_source("exemplar", str(path))
    image = source.read()
    assert source.channels == ("R", "G", "B", *NORMAL, "ao")
    np.testing.assert_allclose(image.pixels[..., 6], 0.2, rtol=1e-6)
    assert source.maps[1].directx
    folder_normals = open_source("exemplar", str(folder)).read().pixels[..., 3:6]
    np.testing.assert_array_equal(image.pixels[..., 4], -folder_normals[..., 1])


def test_maps_of_another_size_are_resampled_and_told(folder: Path) -> None:
    save(folder / "moss_AO.png", np.full((2, 3), 51, np.uint8))
    source = open_source("exemplar", str(folder))
    (note,) = source.notes
    assert "moss_AO.png has 3 x 2 px, moss_BaseColor.png 9 x 6 px: ao is resampled; 'resample: false'" in note
    image = source.read()
    np.testing.assert_allclose(image.pixels[..., image.channels.index("ao")], 0.2, rtol=1e-6)


def test_a_mask_of_another_size_is_refused(folder: Path) -> None:
    save(folder / "moss_mask.png", np.full((2, 3), 255, np.uint8))
    assert "9 x 6 px; bring them to one size, or list them in a YAML file with 'resample: true'" in problem(folder)


def test_a_name_that_begins_otherwise_is_told(folder: Path) -> None:
    save(folder / "bark_2K_ao.png", np.full(SIDES, 51, np.uint8))
    save(folder / "T_Moss_1K_Metallic.png", np.full(SIDES, 51, np.uint8))
    (note,) = open_source("exemplar", str(folder)).notes
    assert note.endswith(
        "bark_2K_ao.png is taken for the same material as moss_BaseColor.png, though its name begins otherwise"
    )


def test_colors_beside_data(folder: Path, rng: np.random.Generator) -> None:
    save(folder / "emissive.png", colors(rng))
    save(folder / "specular.png", colors(rng))
    mask = np.full(SIDES, 255, np.uint8)
    mask[2, 3] = 0
    save(folder / "mask.png", mask)
    image = open_source("exemplar", str(folder)).read()
    planes = dict(zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True))
    bgr = cv2.imread(str(folder / "emissive.png"))[..., ::-1]
    np.testing.assert_allclose(planes["emissive.G"], linear_from_srgb(bgr[..., 1] / 255), rtol=1e-6)
    bgr = cv2.imread(str(folder / "specular.png"))[..., ::-1]
    np.testing.assert_allclose(planes["specular.B"], bgr[..., 2] / 255, rtol=1e-6)
    assert np.argwhere(planes["usable"] < 0.5).tolist() == [[2, 3]]


def test_unknown_files_are_left_out_with_a_note(folder: Path, rng: np.random.Generator) -> None:
    before = open_source("exemplar", str(folder))
    assert before.notes == ()
    save(folder / "other.png", colors(rng))
    save(folder / "preview.png", colors(rng))
    for name in ("readme.txt", "Thumbs.db", "._moss_BaseColor.png", "moss.blend"):
        (folder / name).write_text("moss")
    source = open_source("exemplar", str(folder))
    assert source.digest == before.digest
    place = f"sources.exemplar: {folder}"
    assert source.notes == (
        f"{place}: other.png ignored: the name is that of no map",
        f"{place}: 5 files beside the maps ignored: preview.png, ._moss_BaseColor.png, Thumbs.db, moss.blend, ...",
    )


def test_an_exr_of_all_maps_is_counted_beside_them(folder: Path) -> None:
    image = open_source("exemplar", str(folder)).read()
    codec.export(image, Image, folder / "material.exr", {})
    source = open_source("exemplar", str(folder))
    (note,) = source.notes
    assert note.endswith(": 1 file beside the maps ignored: material.exr")
    assert source.holds_maps
    assert open_source("exemplar", str(folder / "material.exr")).holds_maps
    codec.export(Image(image.pixels[..., :3].copy(), ("R", "G", "B")), Image, folder / "material.exr", {})
    assert "material.exr ignored: the name is that of no map" in open_source("exemplar", str(folder)).notes[0]
    assert not open_source("exemplar", str(folder / "material.exr")).holds_maps


def test_files_that_are_never_read_are_told(folder: Path) -> None:
    (folder / "moss_AO.jxl").write_text("moss")
    (folder / "moss_Metallic.png").symlink_to("nowhere.png")
    assert [note.partition(f"{folder}: ")[2] for note in open_source("exemplar", str(folder)).notes] == [
        "1 file is not read: moss_AO.jxl; save it as PNG, TIFF or EXR",
        "1 file beside the maps ignored: moss_Metallic.png",
    ]


@pytest.mark.parametrize("names", ["Z", "R", "WZ", "RZ"])
def test_maps_in_channels_of_any_name(folder: Path, names: str) -> None:
    import OpenEXR

    values = np.linspace(-1, 2, 64, dtype=np.float32).reshape(8, 8)
    assert cv2.imwrite(str(folder / "c.png"), np.zeros((8, 8, 3), np.uint8))
    planes = {name: values if name == names[-1] else -values for name in names}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, planes).write(str(folder / "x.exr"))
    listing = folder / "listing.yaml"
    for role in ("height", "specular"):
        listing.write_text(f"{{albedo: c.png, {role}: {{file: x.exr, channel: {names[-1]}}}}}")
        source = open_source("exemplar", str(listing))
        assert source.channels == ("R", "G", "B", role)
        np.testing.assert_array_equal(source.read().pixels[..., 3], values)
        listing.write_text(f"{{albedo: c.png, {role}: x.exr}}")
        if len(names) > 1:
            with pytest.raises(
                InputError, match=rf"x\.exr: has no colour, but {names[0]}, Z; name one in a YAML file"
            ):
                open_source("exemplar", str(listing))
        else:
            np.testing.assert_array_equal(open_source("exemplar", str(listing)).read().pixels[..., 3], values)
    listing.write_text("{albedo: c.png, height: {file: x.exr, channel: Q}}")
    with pytest.raises(InputError, match=rf"height: x\.exr has no channel Q, but {', '.join(names)}"):
        open_source("exemplar", str(listing))


def test_the_digest_covers_files_and_roles(folder: Path, rng: np.random.Generator) -> None:
    def digest() -> str:
        return open_source("exemplar", str(folder)).digest

    before = digest()
    (folder / "moss_Roughness.png").rename(folder / "other_rough.png")
    assert digest() == before
    (folder / "other_rough.png").rename(folder / "ao.png")
    assert digest() != before
    (folder / "ao.png").rename(folder / "roughness.png")
    assert digest() == before
    save(folder / "roughness.png", rng.integers(0, 256, SIDES).astype(np.uint8))
    assert digest() != before


def test_errors_name_the_file(folder: Path, rng: np.random.Generator) -> None:
    source = open_source("exemplar", str(folder))
    save(folder / "moss_Roughness.png", colors(rng))
    with pytest.raises(InputError, match=r"moss_Roughness\.png has changed since the run began"):
        source.read()
    assert problem(folder) == (
        "moss_Roughness.png is in colour, but roughness has one value a pixel; save it in grey, or where it holds "
        "several maps, name them in a YAML file of maps, as 'roughness: {file: NAME, channel: R}'"
    )
    save(folder / "rough.png", rng.integers(0, 256, SIDES).astype(np.uint8))
    assert problem(folder).startswith("has several files for roughness: moss_Roughness.png and rough.png")
    (folder / "moss_Roughness.png").unlink()
    (folder / "rough.png").write_bytes(b"not a picture")
    assert problem(folder).startswith("rough.png: is not a picture that can be read")
    (folder / "rough.png").unlink()
    (folder / "moss_BaseColor.png").unlink()
    assert problem(folder).startswith("has no albedo among its maps, which are ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[a]", "must map the names of maps to files, got ['a']"),
        ("albedo: {a: b}", "albedo: must be a file"),
        ("albedo: no.png", "no.png: no such file"),
        ("albdo: a.png", "'albdo' is no map; did you mean 'albedo'?"),
        ("{albedo: a.png, basecolor: b.png}", "basecolor: there is a file for albedo already"),
        ("{albedo: 'skimage:brick', normal: 'skimage:brick'}", "skimage:brick: is grey"),
        ("{albedo: 'skimage:brick', resample: 2}", "resample: must be true or false, got 2"),
        ("{albedo: 'skimage:brick', normal_convention: dx}", "normal_convention: must be opengl or directx"),
        (
            "{albedo: 'skimage:brick', height_unit: miles}",
            "height_unit: must be one of um, mm, cm, m, in, got",
        ),
        ("{albedo: 'http:x'}", "http:x"),
        ("{albedo: .}", ": is a folder, not a file"),
        ("albedo: !!python/name:os.system x", "not valid YAML"),
    ],
)
def test_wrong_sets_in_yaml(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "set.yaml"
    path.write_text(text)
    assert message in problem(path)


def test_items_of_a_library_of_sets(folder: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    library = tmp_path / "library"
    library.mkdir()
    folder = folder.rename(library / "moss")
    save(library / "rock.v2" / "albedo.png", colors(rng))
    save(library / "others" / "preview.png", colors(rng))
    flow = tmp_path / "flow.yaml"
    steps = "steps: {edges: {stage: analysis.edges, inputs: {image: exemplar}}}\n"
    flow.write_text(f"sources: {{exemplar: {{each: library/*}}}}\n{steps}")
    items = items_of(load_flow(flow))
    assert [item.name for item in items] == ["moss", "rock.v2"]
    source = open_source("exemplar", items[0].sources["exemplar"])
    assert source.digest == open_source("exemplar", str(folder)).digest


def test_the_material_that_ships_opens() -> None:
    source = open_source("exemplar", str(ROOT / "configs" / "exemplars" / "brick_maps"))
    assert {one.role for one in source.maps} == {"albedo", "normal", "height", "roughness"}
    assert not source.notes
    assert source.read().channels == source.channels
