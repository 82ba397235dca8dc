"""Export of maps: lossless files, and the MaterialX document that binds them."""

from __future__ import annotations

from pathlib import Path

import cv2
import MaterialX
import numpy as np
import pytest

from tests.pipelines.flows import Events
from tests.pipelines.media.test_material_set import colors, normals, save
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.material_export import write_maps
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

SIDES = (12, 14)

FLOW = """
flow: copies
sources: {exemplar: moss}
steps:
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 20x16, method: pixels}}
exports:
  maps/: {image: start.image, like: exemplar}
"""


def saved(path: Path) -> np.ndarray:
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert values is not None
    return values


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    alpha = np.where(rng.random(SIDES) < 0.8, 255, 30).astype(np.uint8)
    rgba = np.concatenate([colors(rng, SIDES), alpha[..., None]], axis=2)[..., [2, 1, 0, 3]]
    (tmp_path / "moss").mkdir()
    assert cv2.imwrite(str(tmp_path / "moss" / "moss_Color.png"), rgba)
    save(tmp_path / "moss" / "moss_NormalDX.png", normals(rng, SIDES))
    for name in ("rough", "metalness", "ao", "opacity"):
        save(tmp_path / "moss" / f"moss_{name}.png", rng.integers(0, 256, SIDES).astype(np.uint8))
    save(tmp_path / "moss" / "moss_disp.png", rng.integers(0, 65536, SIDES).astype(np.uint16))
    save(tmp_path / "moss" / "moss_emission.png", rng.integers(0, 65536, (*SIDES, 3)).astype(np.uint16))
    save(tmp_path / "moss" / "moss_specular.png", colors(rng, SIDES))
    return tmp_path / "moss"


def written(folder: Path, out: Path) -> Image:
    """Write the maps of a folder or YAML file again; its image."""
    source = open_source("exemplar", str(folder))
    image = source.read()
    write_maps(image, out, source.maps, {"seed": 3})
    return image


def test_copies_are_bit_identical_and_keep_their_names(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    written(folder, out)
    files = sorted(path.name for path in folder.iterdir())
    assert sorted(path.name for path in out.iterdir()) == sorted([*files, "material.exr", "material.mtlx"])
    for name in files:
        original, copy = saved(folder / name), saved(out / name)
        assert copy.dtype == original.dtype
        np.testing.assert_array_equal(copy, original, err_msg=name)


@pytest.mark.parametrize("bits", [8, 16])
def test_every_level_of_color_and_data_survives(tmp_path: Path, bits: int) -> None:
    ramp = np.arange(2**bits).astype(np.uint8 if bits == 8 else np.uint16).reshape(2 ** (bits // 2), -1)
    folder = tmp_path / "ramp"
    save(folder / "color.png", np.stack([ramp, ramp[::-1], ramp[:, ::-1]], axis=2))
    save(folder / "height.png", ramp)
    written(folder, tmp_path / "out")
    for name in ("color.png", "height.png"):
        np.testing.assert_array_equal(saved(tmp_path / "out" / name), saved(folder / name))


def test_the_exr_holds_all_maps_as_layers_and_is_an_exemplar_again(folder: Path, tmp_path: Path) -> None:
    image = written(folder, tmp_path / "out")
    again = open_source("exemplar", str(tmp_path / "out" / "material.exr")).read()
    assert sorted(again.channels) == sorted(image.channels)
    order = [again.channels.index(name) for name in image.channels]
    np.testing.assert_array_equal(again.pixels[..., order], image.pixels)


def test_averages_of_normals_get_unit_length(folder: Path, tmp_path: Path) -> None:
    source = open_source("exemplar", str(folder))
    image = source.read()
    mean = (image.pixels + np.roll(image.pixels, 1, axis=1)) / 2
    write_maps(Image(mean, image.channels), tmp_path / "out", source.maps, {})
    again = open_source("exemplar", str(tmp_path / "out" / "material.exr")).read()
    vectors = np.stack([again.pixels[..., again.channels.index(name)] for name in NORMAL], axis=2)
    lengths = np.linalg.norm(vectors, axis=2)
    assert np.abs(lengths - 1).max() < 0.007
    packed = saved(tmp_path / "out" / "moss_NormalDX.png")[..., ::-1] / 255 * 2 - 1
    assert np.abs(np.linalg.norm(packed, axis=2) - 1).max() < 0.014


def test_maps_without_an_original(tmp_path: Path, rng: np.random.Generator) -> None:
    image = Image(rng.random((*SIDES, 3), np.float32), ("Y", "height", "dust"))
    write_maps(image, tmp_path / "out", (), {})
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("albedo.png", "height.png", "material.exr", "material.mtlx")
    }
    assert saved(tmp_path / "out" / "albedo.png").shape == (*SIDES, 3)
    height = saved(tmp_path / "out" / "height.png")
    np.testing.assert_array_equal(height, np.rint(image.pixels[..., 1].astype(np.float64) * 65535))


@pytest.mark.parametrize("layout", [None, "unreal"])
def test_a_grey_albedo_is_written_as_colour_which_is_told(
    tmp_path: Path, rng: np.random.Generator, caplog: pytest.LogCaptureFixture, layout: str | None
) -> None:
    image = Image(rng.random((*SIDES, 1), dtype=np.float32), ("Y",))
    if layout is None:
        write_maps(image, tmp_path, (), {})
    else:
        write_layout(image, tmp_path, "moss", Delivery(layout=layout), {})
    assert {saved(path).ndim for path in tmp_path.glob("*.png")} == {3}
    assert "albedo: is grey, and written as three equal channels, as shaders expect" in caplog.messages


def test_files_of_one_name_from_several_folders(tmp_path: Path, rng: np.random.Generator) -> None:
    save(tmp_path / "a" / "1.png", colors(rng, SIDES))
    save(tmp_path / "b" / "1.png", rng.integers(0, 256, SIDES).astype(np.uint8))
    (tmp_path / "set.yaml").write_text("{albedo: a/1.png, roughness: b/1.png}")
    written(tmp_path / "set.yaml", tmp_path / "out")
    assert {path.stem for path in (tmp_path / "out").glob("*.png")} == {"albedo", "roughness"}


def test_the_materialx_document_is_valid(folder: Path, tmp_path: Path) -> None:
    written(folder, tmp_path / "out")
    library = MaterialX.createDocument()
    folders, paths = MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(folders, paths, library)
    document = MaterialX.createDocument()
    MaterialX.readFromXmlFile(document, str(tmp_path / "out" / "material.mtlx"))
    document.setDataLibrary(library)
    valid, problems = document.validate()
    assert valid, problems
    assert MaterialX.writeToXmlString(document) == (tmp_path / "out" / "material.mtlx").read_text()
    (material,) = document.getMaterialNodes()
    (shader,) = MaterialX.getShaderNodes(material)
    assert shader.getNodeDef() is not None
    bound = {entry.getName(): entry.getConnectedNode() for entry in shader.getInputs() if entry.getNodeName()}
    files = {name: node.getInputValue("file") for name, node in bound.items() if node.getInput("file")}
    assert files == {
        "base_color": "moss_Color.png",
        "roughness": "moss_rough.png",
        "metallic": "moss_metalness.png",
        "occlusion": "moss_ao.png",
        "specular_color": "moss_specular.png",
        "alpha": "moss_opacity.png",
        "emissive": "moss_emission.png",
    }
    assert bound["base_color"].getInput("file").getColorSpace() == "srgb_texture"
    assert bound["specular_color"].getInput("file").getColorSpace() == "lin_rec709"
    normal = bound["normal"]
    assert normal.getConnectedNode("in").getInputValue("file") == "moss_NormalDX.png"
    assert tuple(normal.getInputValue("scale").asTuple()) == (1, -1)
    (displacement,) = MaterialX.getShaderNodes(material, "displacementshader")
    assert displacement.getConnectedNode("displacement").getInputValue("file") == "moss_disp.png"
    assert all((tmp_path / "out" / name).is_file() for name in files.values())


def test_a_flow_exports_a_folder_of_aligned_maps(folder: Path, tmp_path: Path) -> None:
    (folder / "moss_Color.png").write_bytes((folder / "moss_specular.png").read_bytes())  # without alpha
    places = np.arange(SIDES[0] * SIDES[1], dtype=np.uint16).reshape(SIDES)
    save(folder / "moss_disp.png", places)  # tells where a pixel comes from
    files = list(folder.iterdir())
    (folder / "sphere.png").write_bytes((folder / "moss_ao.png").read_bytes())
    (tmp_path / "flow.yaml").write_text(FLOW)
    opened = Run(load_flow(tmp_path / "flow.yaml"), Store(tmp_path / "artifacts"))
    listener = Events()
    exports = execute(opened, listener, tmp_path / "out")
    assert exports == {"maps/": tmp_path / "out" / "maps"}
    assert listener.notes == [f"sources.exemplar: {folder}: 1 file beside the maps ignored: sphere.png"]
    row, column = np.divmod(saved(tmp_path / "out" / "maps" / "moss_disp.png"), SIDES[1])
    assert row.shape == (16, 20)
    for path in files:
        np.testing.assert_array_equal(saved(tmp_path / "out" / "maps" / path.name), saved(path)[row, column])
    both = Overrides(seeds=2)
    opened = Run(load_flow(tmp_path / "flow.yaml", both), Store(tmp_path / "artifacts"))
    exports = execute(opened, Events(), tmp_path / "out")
    assert list(exports) == ["0/maps/", "1/maps/"]
    first, again = (saved(out / "moss_rough.png") for out in (exports["0/maps/"], tmp_path / "out" / "maps"))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize(
    ("export", "message"),
    [
        ("maps/: {image: start.image, like: exemplr}", "exports.maps/.like: no source 'exemplr'; did you mean"),
        ("maps/: {image: start.image, lik: exemplar}", "exports.maps/.lik: unknown; did you mean 'like'?"),
        ("maps/: {like: exemplar}", "exports.maps/: must be a source or STEP.OUTPUT, got nothing"),
        (
            "maps/: start.match",
            "exports.maps/: must be an image, whose maps it will hold, but start.match is uint32",
        ),
        ("maps.png: {image: start.image}", "exports.maps.png: must be a source or STEP.OUTPUT"),
        ("../maps/: start.image", "'../maps/' is not a file name"),
    ],
)
def test_folders_of_maps_are_checked(tmp_path: Path, export: str, message: str) -> None:
    text = FLOW.replace("maps/: {image: start.image, like: exemplar}", export)
    (tmp_path / "flow.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_flow(tmp_path / "flow.yaml")
    assert message in str(caught.value)


def test_a_folder_of_maps_is_like_its_own_item(tmp_path: Path) -> None:
    text = FLOW.replace("{exemplar: moss}", "{exemplar: {each: '*'}, other: moss}")
    (tmp_path / "flow.yaml").write_text(text.replace("{image: exemplar}", "{image: other}"))
    with pytest.raises(InputError, match=r"'exemplar' is a set, but start\.image exists only once"):
        load_flow(tmp_path / "flow.yaml")
