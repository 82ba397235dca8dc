"""Opens what `tests.hosts.write` wrote by readers of USD, glTF, MaterialX and textures that are installed.

python in_readers.py FOLDER
"""

import importlib.util
import json
import sys
from pathlib import Path


def usd(folder: Path, name: str) -> str:
    """The stage opens, all assets are there, and the colour spaces are said."""
    from pxr import Usd, UsdShade

    stage = Usd.Stage.Open(str(folder / "blender" / f"{name}.usda"))
    spaces = {}
    for prim in stage.Traverse():
        shader = UsdShade.Shader(prim)
        if shader and shader.GetIdAttr().Get() == "UsdUVTexture":
            file = shader.GetInput("file").Get()
            assert Path(file.resolvedPath).is_file(), file
            spaces[Path(file.path).name] = shader.GetInput("sourceColorSpace").Get()
    colors = {f"{name}_base_color.png", f"{name}_emissive.png"}
    assert set(spaces) > colors, spaces
    assert all((space == "sRGB") == (file in colors) for file, space in spaces.items()), spaces
    return f"{len(spaces)} textures"


def gltf(folder: Path, name: str) -> str:
    """The material has its textures, each an embedded PNG."""
    import pygltflib

    document = pygltflib.GLTF2().load(str(folder / "gltf" / f"{name}.glb"))
    (material,) = document.materials
    assert material.name == name, material.name
    surface = material.pbrMetallicRoughness
    textures = [
        surface.baseColorTexture, surface.metallicRoughnessTexture, material.normalTexture,
        material.occlusionTexture, material.emissiveTexture,
    ]  # fmt: skip
    assert all(one is not None for one in textures), textures
    for image in document.images:
        view = document.bufferViews[image.bufferView]
        start = document.binary_blob()[view.byteOffset : view.byteOffset + 4]
        assert start == b"\x89PNG", start
    return f"{len(document.images)} pictures"


def materialx(folder: Path, name: str) -> str:
    """The documents are valid with the standard libraries, and their files are there."""
    import MaterialX

    library = MaterialX.createDocument()
    folders, paths = MaterialX.getDefaultDataLibraryFolders(), MaterialX.getDefaultDataSearchPath()
    MaterialX.loadLibraries(folders, paths, library)
    counts = []
    for layout in ("materialx", "arnold"):
        file = folder / layout / f"{name}.mtlx"
        if not file.is_file():
            continue
        document = MaterialX.createDocument()
        MaterialX.readFromXmlFile(document, str(file))
        document.importLibrary(library)
        valid, message = document.validate()
        assert valid, message
        own = [one for one in document.traverseTree() if one.getSourceUri() in ("", str(file))]
        files = {one.getValueString() for one in own if one.isA(MaterialX.Input) and one.getType() == "filename"}
        files.discard("")
        assert files, layout
        assert all((file.parent / one).is_file() for one in files), files
        counts.append(len(files))
    return f"{' and '.join(map(str, counts))} pictures"


def textures(folder: Path, _: str) -> str:
    """PNGs have the size and channels, .tx files are tiled and have levels."""
    import OpenImageIO

    expected = json.loads((folder.parent / "expected.json").read_text())
    count = 0
    for path in [*folder.rglob("*.png"), *folder.rglob("*.tx")]:
        picture = OpenImageIO.ImageInput.open(str(path))
        assert picture, path
        spec = picture.spec()
        assert (spec.width, spec.height) == (expected["side"],) * 2, path
        if path.suffix == ".tx":
            assert spec.tile_width, path
            assert picture.seek_subimage(0, 1), path
        picture.close()
        count += 1
    return f"{count} files"


READERS = {
    "USD": ("pxr", usd), "glTF": ("pygltflib", gltf), "MaterialX": ("MaterialX", materialx),
    "OpenImageIO": ("OpenImageIO", textures),
}  # fmt: skip


if __name__ == "__main__":
    skipped, written = [], Path(sys.argv[1])
    materials = json.loads((written / "expected.json").read_text())["names"]
    for reader, (module, check) in READERS.items():
        if importlib.util.find_spec(module) is None:
            skipped.append(reader)
            continue
        for number, material in enumerate(materials):
            print(f"{reader}: {material} right ({check(written / str(number), material)})")
    if skipped:
        print(f"skipped: {', '.join(skipped)}: not installed")
