"""How programs and libraries name and pack the maps of a material: one table, for reading and for writing.

`texloom.pipelines.media.map_names` reads names by it, `texloom.pipelines.media.writers.layouts` writes by it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

ROLES = (
    *("albedo", "normal", "roughness", "metallic", "ao", "height", "specular", "opacity", "emissive", "mask"),
    *("bump", "cavity", "translucency", "fuzz"),
)
"""of maps, in the order of their channels in an image"""
COLORS = ("albedo", "emissive", "translucency")
"""roles of maps in sRGB"""
CONVENTIONS = {"opengl": "up", "directx": "down"}
"""name of a convention of normals to where green points"""
CONVENTION_OF = {green: name for name, green in CONVENTIONS.items()}
GLOSS = "1-roughness"
"""plane of smoothness or gloss"""
DEPTH = "1-height"
"""plane of depth, white where the surface is low"""


def role_of(plane: str) -> tuple[str, bool]:
    """The role of a plane, empty where it holds none, and whether it is inverted."""
    return plane.removeprefix("1-"), plane.startswith("1-")


@dataclasses.dataclass(frozen=True)
class LayoutFile:
    """A file of a layout."""

    suffix: str
    """of its name, as it is written"""
    planes: tuple[str, ...]
    """one role, or the roles that its channels hold, of colours and normals three times; an empty one is white; see
    `role_of`"""
    bits: int = 8
    also: tuple[str, ...] = ()
    """other suffixes that are read as this one; case and separators do not count"""
    written: bool = True
    """else it is only read"""
    rare: bool = False
    """read so only where the folder's other names exclude what the suffix usually means"""

    @property
    def role(self) -> str:
        """The role of a file with one map as it is; empty where several are packed, or it is inverted."""
        return self.planes[0] if len(self.planes) == 1 and not role_of(self.planes[0])[1] else ""


@dataclasses.dataclass(frozen=True)
class Layout:
    """How a program or library names and packs the files of a material."""

    title: str
    parts: tuple[LayoutFile, ...]
    prefix: str = ""
    green: str = ""
    """where it points in normals, up or down; empty: either on reading, up on writing"""
    kind: str = "png"
    """``png`` or ``tx``"""
    document: str = ""
    """what binds the files: ``mtlx``, ``usda``, ``glb`` or nothing"""
    shader: str = "gltf_pbr"
    """of MaterialX"""

    @property
    def directx(self) -> bool:
        """Whether green of normals points down in files that are written."""
        return self.green == "down"

    @property
    def written(self) -> tuple[LayoutFile, ...]:
        """The files that are written."""
        return tuple(part for part in self.parts if part.written)


def _one(suffix: str, role: str, bits: int = 8, *also: str) -> LayoutFile:
    return LayoutFile(suffix, (role,), bits, also)


def _read(suffix: str, *planes: str, rare: bool = False) -> LayoutFile:
    return LayoutFile(suffix, planes, written=False, rare=rare)


_ORM = ("ao", "roughness", "metallic")
_PACKED = (
    *(_read("ORM", *_ORM), _read("ARM", *_ORM), _read("AORM", *_ORM), _read("occlusionRoughnessMetallic", *_ORM)),
    *(_read("RMA", "roughness", "metallic", "ao"), _read("RMAO", "roughness", "metallic", "ao")),
    *(_read("MRA", "metallic", "roughness", "ao"), _read("MRAO", "metallic", "roughness", "ao")),
    *(_read("ORD", "ao", "roughness", "height"), _read("ORDp", "ao", "roughness", "height")),
    *(_read("DpRA", "height", "roughness", "ao"), _read("DpRO", "height", "roughness", "ao")),
    *(_read("ORH", "ao", "roughness", "height"), _read("metallicRoughness", "", "roughness", "metallic")),
    _read("roughnessMetallic", "", "roughness", "metallic"),
    # in the alpha of another map
    *(
        _read(color + word, *[role] * 3, GLOSS)
        for color, role in {
            **dict.fromkeys(("albedo", "baseColor", "diffuse"), "albedo"),
            "specular": "specular",
        }.items()
        for word in ("Smoothness", "Gloss", "Glossiness")
    ),
    *(_read(f"albedo{word}", *["albedo"] * 3, "height") for word in ("Height", "Bump")),
    *(_read(f"normal{word}", *["normal"] * 3, "roughness") for word in ("Roughness", "Rough")),
    _read("ddna", *["normal"] * 3, GLOSS),
    # either of Texture Haven, or the ao of a material whose name ends in rough
    *(_read("roughAO", "roughness", "ao"), _read("roughAO", "ao")),
)
LAYOUTS: Mapping[str, Layout] = {
    "plain": Layout(
        "names of the maps",
        (
            _one(
                *("albedo", "albedo", 8, "basecolor", "basecolour", "base", "diffuse", "diff", "dif"),
                *("diffuseoriginal", "color", "colour", "col", "alb"),
            ),
            _one("normal", "normal", 16, "normals", "nor", "nrm", "norm", "nml", "nmap", "ddn"),
            _one("roughness", "roughness", 8, "rough", "rgh"),
            _one("metallic", "metallic", 8, "metalness", "metal", "met", "mtl"),
            _one("ao", "ao", 8, "ambientocclusion", "occlusion", "ambient", "occ"),
            _one("height", "height", 16, "displacement", "disp", "displ", "displace", "hgt"),
            _one("specular", "specular", 8, "spec", "specularlevel", "spc", "reflection", "refl"),
            _one("opacity", "opacity", 8, "alpha", "transparency"),
            _one("emissive", "emissive", 8, "emission", "emit", "glow", "selfillum"),
            _one("mask", "mask", 8, "usable"),
            _one("bump", "bump", 16, "bumpmap"),
            _one("cavity", "cavity", 8),
            _one("translucency", "translucency", 8, "sss", "scattering"),
            _one("fuzz", "fuzz", 8),
            _read("depth", DEPTH),
            *(_read(word, GLOSS) for word in ("gloss", "glossiness", "smoothness", "smooth", "gls")),
            *_PACKED,
        ),
    ),
    "unreal": Layout(
        "Unreal Engine",
        (
            *(
                _one("BC", "albedo", 8, "D", "diff"),
                LayoutFile("ORM", _ORM, 8, ("ARM",)),
                _one("N", "normal", 8, "NM"),
            ),
            *(_one("H", "height", 16), _one("S", "specular"), _one("O", "opacity"), _one("E", "emissive")),
            *(_read("R", "roughness"), _read("M", "metallic"), _read("AO", "ao"), _read("MSK", "mask")),
        ),
        prefix="T_",
        green="down",
    ),
    "unity": Layout(
        "Unity, HDRP",
        (
            _one("BaseMap", "albedo", 8, "BaseColorMap", "Albedo"),
            LayoutFile("MaskMap", ("metallic", "ao", "", GLOSS)),
            *(_one("Normal", "normal", 8, "NormalMap"), _one("HeightMap", "height", 16)),
            *(_one("Opacity", "opacity"), _one("Emissive", "emissive", 8, "EmissiveColorMap", "EmissionMap")),
        ),
        green="up",
    ),
    "unity_standard": Layout(
        "Unity, Standard and URP",
        (
            _one("AlbedoTransparency", "albedo", 8, "Albedo", "BaseMap", "MainTex"),
            LayoutFile("MetallicSmoothness", ("metallic", "", "", GLOSS), 8, ("MetallicGlossMap", "MetallicGloss")),
            *(_one("Normal", "normal", 8, "NormalMap", "BumpMap"), _one("Occlusion", "ao", 8, "OcclusionMap")),
            *(_one("Height", "height", 16, "ParallaxMap"), _one("Emission", "emissive", 8, "EmissionMap")),
        ),
        green="up",
    ),
    "blender": Layout(
        "Blender",
        (
            *(_one("base_color", "albedo"), _one("roughness", "roughness"), _one("metallic", "metallic")),
            *(_one("normal", "normal", 16), _one("height", "height", 16), _one("ao", "ao")),
            *(_one("specular", "specular"), _one("opacity", "opacity"), _one("emissive", "emissive")),
        ),
        document="usda",
    ),
    "gltf": Layout(
        "glTF",
        (
            *(_one("baseColor", "albedo"), LayoutFile("occlusionRoughnessMetallic", _ORM)),
            *(_one("normal", "normal"), _one("emissive", "emissive")),
            *(_read("metallicRoughness", "", "roughness", "metallic"), _read("occlusion", "ao")),
        ),
        green="up",
        document="glb",
    ),
    "godot": Layout(
        "Godot",
        (
            *(_one("albedo", "albedo"), LayoutFile("orm", _ORM), _one("normal", "normal")),
            *(_one("height", "height", 16), _one("emission", "emissive")),
            *(_read("roughness", "roughness"), _read("metallic", "metallic"), _read("ao", "ao")),
        ),
        green="up",
    ),
    "arnold": Layout(
        "Arnold",
        (
            *(_one("baseColor", "albedo"), _one("specularRoughness", "roughness"), _one("metalness", "metallic")),
            *(_one("normal", "normal"), _one("height", "height"), _one("occlusion", "ao")),
            *(_one("specular", "specular"), _one("opacity", "opacity"), _one("emission", "emissive")),
        ),
        kind="tx",
        document="mtlx",
        shader="standard_surface",
    ),
    "materialx": Layout(
        "MaterialX",
        (
            *(_one("base_color", "albedo"), _one("specular_roughness", "roughness"), _one("metalness", "metallic")),
            *(_one("normal", "normal", 16), _one("displacement", "height", 16), _one("occlusion", "ao")),
            *(_one("specular", "specular"), _one("opacity", "opacity"), _one("emission_color", "emissive")),
        ),
        green="up",
        document="mtlx",
        shader="standard_surface",
    ),
    "substance": Layout(
        "Substance",
        (
            *(_one("basecolor", "albedo"), _one("normal", "normal", 16), _one("roughness", "roughness")),
            *(_one("metallic", "metallic"), _one("ambientocclusion", "ao"), _one("height", "height", 16)),
            *(_one("specularlevel", "specular"), _one("opacity", "opacity"), _one("emissive", "emissive")),
            *(_read("glossiness", GLOSS), _read("diffuse", "albedo"), _read("specular", "specular")),
        ),
        green="down",
    ),
    "ambientcg": Layout(
        "ambientCG",
        (
            *(_one("Color", "albedo"), _one("NormalGL", "normal", 8, "NormalDX"), _one("Roughness", "roughness")),
            *(_one("Metalness", "metallic"), _one("AmbientOcclusion", "ao"), _one("Displacement", "height", 16)),
            *(_one("Opacity", "opacity"), _one("Emission", "emissive")),
        ),
        green="up",
    ),
    "polyhaven": Layout(
        "Poly Haven",
        (
            *(_one("diff", "albedo", 8, "diffuse", "col"), _one("nor_gl", "normal", 16, "nor_dx")),
            *(
                LayoutFile("arm", _ORM),
                _one("disp", "height", 16),
                _one("spec", "specular"),
                _one("alpha", "opacity"),
            ),
            *(_read("rough", "roughness"), _read("ao", "ao"), _read("metal", "metallic")),
        ),
        green="up",
    ),
    "megascans": Layout(
        "Quixel Megascans",
        (
            *(_one("Albedo", "albedo"), _one("Normal", "normal"), _one("Roughness", "roughness")),
            *(_one("Metalness", "metallic"), _one("AO", "ao"), _one("Displacement", "height", 16)),
            *(_one("Specular", "specular"), _one("Opacity", "opacity"), _one("Bump", "bump")),
            *(_one("Cavity", "cavity"), _one("Translucency", "translucency"), _one("Fuzz", "fuzz")),
            *(_read("Gloss", GLOSS), _read("Diffuse", "albedo")),
        ),
    ),
    "poliigon": Layout(
        "Poliigon",
        (
            *(_one("COL", "albedo"), _one("NRM", "normal", 8, "NRM16"), LayoutFile("GLOSS", (GLOSS,))),
            *(_one("METALNESS", "metallic"), _one("AO", "ao"), _one("DISP16", "height", 16, "DISP")),
            *(_one("REFL", "specular"), _one("ALPHAMASKED", "opacity"), _one("BUMP", "bump", 8, "BUMP16")),
            *(_one("TRANSMISSION", "translucency"), _read("ROUGHNESS", "roughness")),
        ),
        green="up",
    ),
    "cgbookcase": Layout(
        "cgbookcase",
        (
            *(_one("BaseColor", "albedo"), _one("Normal", "normal", 16), _one("Roughness", "roughness")),
            *(_one("Metallic", "metallic"), _one("AO", "ao"), _one("Height", "height", 16)),
            *(_one("Opacity", "opacity"), _one("Emission", "emissive")),
        ),
    ),
    "textures_com": Layout(
        "textures.com",
        (
            *(_one("albedo", "albedo"), _one("normal", "normal", 16), _one("roughness", "roughness")),
            *(_one("metallic", "metallic"), _one("ao", "ao"), _one("height", "height", 16)),
            *(_one("alpha", "opacity"), _one("emissive", "emissive")),
        ),
    ),
    "3dtextures": Layout(
        "3DTextures",
        (
            *(_one("basecolor", "albedo", 8, "COLOR"), _one("normal", "normal", 8, "NORM")),
            *(_one("roughness", "roughness", 8, "ROUGH"), _one("metallic", "metallic")),
            *(_one("ambientOcclusion", "ao", 8, "OCC"), _one("height", "height", 16, "DISP")),
            *(_one("opacity", "opacity"), _one("emissive", "emissive"), _read("SPEC", "specular")),
        ),
    ),
    "freepbr": Layout(
        "FreePBR",
        (
            *(_one("albedo", "albedo", 8, "basecolor"), _one("normal-ogl", "normal", 8, "normal-dx")),
            *(_one("roughness", "roughness"), _one("metallic", "metallic"), _one("ao", "ao")),
            _one("height", "height", 16),
        ),
    ),
    "short": Layout(
        "short names",
        (
            *(_one("d", "albedo", 8, "a", "c", "bc", "alb"), _one("n", "normal", 8, "nm")),
            *(_one("r", "roughness", 8, "rgh"), _one("m", "metallic", 8, "met"), _one("ao", "ao", 8, "o")),
            *(_one("h", "height", 16, "hgt"), _one("s", "specular", 8, "spc"), _one("e", "emissive")),
            *(_one("op", "opacity"), _one("b", "bump"), _one("t", "translucency"), _read("g", GLOSS)),
            *(_read("d", "height", rare=True), _read("r", "specular", rare=True), _read("s", GLOSS, rare=True)),
            *(_read("a", "opacity", rare=True), _read("a", "ao", rare=True), _read("b", "albedo", rare=True)),
            *(_read("c", "cavity", rare=True), *_PACKED),
        ),
    ),
    "short_specular": Layout(
        "short names, specular",
        (
            *(_one("d", "albedo"), _one("n", "normal"), _one("s", "specular"), LayoutFile("g", (GLOSS,))),
            *(_one("m", "mask"), _one("h", "height", 16), _one("e", "emissive")),
        ),
    ),
}
"""by their names on the command line"""
SEPARATE = LAYOUTS["blender"]
GLTF = LAYOUTS["gltf"]
