"""USD files as sources: prims, transforms, units, axes, primvars, and what cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from texloom.pipelines.media.sources import SourceError, open_mesh
from texloom.stages.common.surface.mesh import areas

pytest.importorskip("pxr")

SQUARE = """
def Mesh "square"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
    %s
}
"""
CORNERS = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]
"""of the two triangles of the square"""


def read(path: Path) -> np.ndarray:
    mesh = open_mesh("mesh", str(path)).value()
    assert isinstance(mesh, np.ndarray)
    return mesh


def written(path: Path, body: str, head: str = 'metersPerUnit = 1\nupAxis = "Y"') -> Path:
    path.write_text(f"#usda 1.0\n(\n{head}\n)\n{body}")
    return path


@pytest.mark.parametrize(
    "primvar",
    [
        'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")',
        'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")',
        'texCoord2f[] primvars:st = [(1, 1), (0, 1), (0, 0), (1, 0)] (interpolation = "faceVarying")\n'
        "    int[] primvars:st:indices = [2, 3, 0, 1]",
        'texCoord2f[] primvars:UVMap = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "varying")',
        'float2[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")',
    ],
)
def test_texture_coordinates(tmp_path: Path, primvar: str) -> None:
    mesh = read(written(tmp_path / "square.usda", SQUARE % primvar))
    np.testing.assert_allclose(mesh[:, :2], CORNERS)
    np.testing.assert_allclose(mesh[:, 6:8], CORNERS)


def test_modules_of_the_working_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "texloom.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    assert len(read(written(tmp_path / "square.usda", SQUARE % ""))) == 6


def test_units_and_the_upper_axis(tmp_path: Path) -> None:
    normals = 'normal3f[] normals = [(0, 0, 1)] (interpolation = "uniform")'
    mesh = read(written(tmp_path / "square.usda", SQUARE % normals, 'metersPerUnit = 0.01\nupAxis = "Z"'))
    np.testing.assert_allclose(mesh[:, [0, 2]], np.array(CORNERS) * [0.01, -0.01], atol=1e-9)
    np.testing.assert_allclose(mesh[:, 3:6], np.tile([0, 1, 0], (6, 1)), atol=1e-6)


def test_prims_and_their_transforms(tmp_path: Path) -> None:
    """Moved, mirrored, left-handed and instanced ones; what is not rendered does not count."""
    body = f"""
def Xform "moved" {{
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {SQUARE % ""}
}}
def Xform "mirrored" {{
    float3 xformOp:scale = (-2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:scale"]
    {SQUARE % ""}
}}
def Xform "left" {{ {SQUARE % 'uniform token orientation = "leftHanded"'} }}
def Xform "hidden" {{ token visibility = "invisible"
    {SQUARE % ""} }}
def Xform "guide" {{ uniform token purpose = "guide"
    {SQUARE % ""} }}
class Xform "source" {{ {SQUARE % ""} }}
def "first" (instanceable = true
    inherits = </source>) {{}}
def "second" (instanceable = true
    inherits = </source>) {{}}
"""
    mesh = read(written(tmp_path / "scene.usda", body))
    assert len(mesh) == 5 * 6
    np.testing.assert_allclose(np.sort(areas(mesh)), [0.5] * 8 + [2] * 2)
    points = mesh[:, :3].reshape(-1, 3, 3)
    facing = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])[:, 2]
    is_left = (points[..., 0] >= 0).all(axis=1) & (facing < 0)
    assert is_left.sum() == 2
    assert (facing > 0).sum() == 8
    assert points[..., 0].max() == 6


def test_faces_with_more_corners_and_holes(tmp_path: Path) -> None:
    body = """
def Mesh "pentagon" {
    int[] faceVertexCounts = [5, 3, 2]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 0, 2, 1, 0, 1]
    int[] holeIndices = [1]
    point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
}
"""
    mesh = read(written(tmp_path / "pentagon.usda", body))
    assert areas(mesh).sum() == pytest.approx(3)


def test_vectors_and_control_at_the_vertices(tmp_path: Path) -> None:
    primvars = """
    vector3f[] primvars:direction = [(0, 3, 0)] (interpolation = "constant")
    float[] primvars:control = [0, 0.25, 0.5, 1] (interpolation = "vertex")
    float3 xformOp:rotateXYZ = (0, 0, 90)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]"""
    mesh = read(written(tmp_path / "square.usda", SQUARE % primvars))
    np.testing.assert_allclose(mesh[:, 8:11], np.tile([-1, 0, 0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(mesh[:, 11], [0, 0.25, 0.5, 0, 0.5, 1])


@pytest.mark.parametrize("suffix", [".usd", ".usdc", ".usdz"])
def test_other_encodings(tmp_path: Path, suffix: str) -> None:
    from pxr import Sdf, UsdUtils

    text = written(tmp_path / "square.usda", SQUARE % "")
    path = tmp_path / f"square{suffix}"
    if suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(text), str(path))
    else:
        assert Sdf.Layer.FindOrOpen(str(text)).Export(str(path))
    np.testing.assert_allclose(read(path)[:, :2], CORNERS)


def test_the_layers_that_a_file_is_composed_from_count(tmp_path: Path) -> None:
    part = written(tmp_path / "part.usda", SQUARE % "", 'defaultPrim = "square"')
    whole = written(tmp_path / "whole.usda", 'def "one" (references = @part.usda@) {}')
    before = open_mesh("mesh", str(whole))
    part.write_text(part.read_text().replace("(1, 1, 0)", "(1, 2, 0)"))
    with pytest.raises(SourceError, match="has changed"):
        before.value()
    assert areas(read(whole)).sum() == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("not a mesh", "cannot be read as USD"),
        ("#usda 1.0\ndef Mesh {", "cannot be read as USD"),
        ("#usda 1.0\n", "has no faces"),
        ('#usda 1.0\ndef "one" (references = @part.usda@) {}', "part.usda, which is missing"),
        ("#usda 1.0\n" + SQUARE.replace("[4]", "[5]") % "", "its faces do not fit its list of vertices"),
        ("#usda 1.0\n" + SQUARE.replace("2, 3]", "2, 9]") % "", "a face names a vertex that is not there"),
        (
            "#usda 1.0\n" + SQUARE % 'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")',
            "primvars:st has 1 values, too few",
        ),
        (
            "#usda 1.0\n" + SQUARE % 'string[] primvars:control = ["a"] (interpolation = "constant")',
            "primvars:control has other values than numbers",
        ),
    ],
)
def test_what_is_broken_is_refused_by_one_line(
    tmp_path: Path, content: str, problem: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mesh.usda"
    path.write_text(content)
    with pytest.raises(SourceError, match=problem) as error:
        open_mesh("mesh", str(path)).value()
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"sources.mesh: {path}: ")
    assert capfd.readouterr() == ("", "")
