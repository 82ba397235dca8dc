"""Kinds of fuzzed input: each case is made from its number alone, and is accepted or refused by one line."""

from __future__ import annotations

import io
import os
import random
import shutil
import tempfile
import traceback
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image

from tests.conftest import ROOT
from tests.fuzz.mutations import mutated, mutated_text, odd_value
from tests.fuzz.programs import arrays, projects, shared
from tests.fuzz.studio import messages
from tests.pipelines.flows import Events, files, run_local, write_flow
from tests.pipelines.media.test_meshes import PLY, SQUARE_OBJ
from tests.surfaces import square
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.media.sources import open_mesh, open_source
from texloom.pipelines.media.writers.writer_registry import WriteJob, write
from texloom.pipelines.store import codec
from texloom.pipelines.store.store import Store
from texloom.stages.analysis.surfaces.surface_charts import SurfaceChartsParams, surface_charts
from texloom.stages.analysis.surfaces.surface_direction import SurfaceDirectionParams, surface_direction
from texloom.stages.common.surface.mesh import has_texture, of_faces, sound, with_normals
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

MEMORY = "300MB"
"""limit of the memory for the pictures of a case"""
_FLOWS = sorted((ROOT / "configs").glob("*.yaml"))
_GEOMETRIES = sorted((ROOT / "configs" / "photographs").glob("*.yaml"))
_STORED = """
flow: stored
sources: {exemplar: exemplar.png}
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 24}}
  edges: {stage: analysis.edges, inputs: {image: part.image}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
exports: {part.exr: part.image, structure.png: structure.structure}
"""


class UnexpectedError(Exception):
    """A case was neither accepted nor refused in the right way."""


def _pixels(rng: random.Random, height: int = 12, width: int = 16, planes: int = 3) -> np.ndarray:
    return np.frombuffer(rng.randbytes(height * width * planes), np.uint8).reshape(height, width, planes)


def _picture(rng: random.Random) -> tuple[str, bytes]:
    """Suffix and content of a picture."""
    kind = rng.choice(("png", "jpeg", "tiff", "webp", "bmp"))
    mode = rng.choice(("RGB", "L", "1", "P") if kind in ("jpeg", "bmp") else ("RGB", "RGBA", "L", "LA", "P"))
    picture = PIL.Image.fromarray(_pixels(rng)).convert("L" if kind == "jpeg" and mode in "1P" else mode)
    if kind in ("webp", "bmp") and mode == "LA":
        picture = picture.convert("RGBA")
    stream = io.BytesIO()
    options = {"compression": rng.choice((None, "tiff_lzw", "tiff_deflate"))} if kind == "tiff" else {}
    picture.save(stream, kind, **options)
    return kind, stream.getvalue()


@cache
def _exrs() -> list[bytes]:
    """EXRs of one part and several, deep, tiled and with levels."""
    folder = Path(tempfile.mkdtemp())
    rng = random.Random(0)

    def planes(names: str, kind: type = np.float16) -> dict[str, np.ndarray]:
        return {name: (_pixels(rng)[..., 0] / 255).astype(kind) for name in names}

    samples = np.empty((3, 3), object)
    for place in np.ndindex(3, 3):
        samples[place] = np.ones(2, np.float32)
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 8
    levels = OpenEXR.TileDescription()
    levels.xSize = levels.ySize = 8
    levels.mode = OpenEXR.MIPMAP_LEVELS
    tiled = {"type": OpenEXR.tiledimage}
    made: list[Any] = [
        [OpenEXR.Part({}, planes("RGB"), "")],
        [OpenEXR.Part({"compression": OpenEXR.PIZ_COMPRESSION}, planes("RGBA", np.float32), "")],
        [OpenEXR.Part({"type": OpenEXR.scanlineimage}, planes(one), one) for one in ("RGB", "Y", "ZN")],
        [
            OpenEXR.Part(
                {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION},
                dict.fromkeys("RGB", samples),
                "",
            )
        ],
        [OpenEXR.Part({**tiled, "tiles": tiles}, planes("RGB"), "")],
        [OpenEXR.Part({**tiled, "tiles": levels}, planes("RGB"), "")],
    ]
    contents = []
    for index, parts in enumerate(made):
        path = folder / f"{index}.exr"
        OpenEXR.File(parts).write(str(path))
        contents.append(path.read_bytes())
    path = folder / "ours.exr"
    codec.export(Image.of(_pixels(rng)), Image, path, {"flow": "a", "output": "a.image", "seed": 1})
    contents.append(path.read_bytes())
    shutil.rmtree(folder)
    return contents


def pictures(rng: random.Random, folder: Path) -> None:
    """Damaged pictures of all formats but EXR."""
    suffix, content = _picture(rng)
    path = folder / f"a.{suffix}"
    path.write_bytes(mutated(rng, content))
    open_source("exemplar", str(path)).read()


def exr(rng: random.Random, folder: Path) -> None:
    """Damaged EXRs, as sources and as files to show."""
    path = folder / "a.exr"
    path.write_bytes(mutated(rng, rng.choice(_exrs())))
    if rng.random() < 0.5:
        open_source("exemplar", str(path)).read()
    else:
        codec.describe(path)
        codec.pictures(path, folder / "pictures")


def flows(rng: random.Random, folder: Path) -> None:
    """Flow files with other words and lines."""
    source = rng.choice(_FLOWS)
    path = folder / "flow.yaml"
    path.write_bytes(mutated_text(rng, source.read_text()).encode(errors="surrogatepass"))
    for other in _FLOWS:
        (folder / other.name).symlink_to(other)
    (folder / "photographs").symlink_to(ROOT / "configs" / "photographs")
    _planned(path, folder)


@cache
def _plannable() -> list[Path]:
    """The flows that ship with texloom and need no file of the user's."""
    known = []
    for path in _FLOWS:
        try:
            Run(load_flow(path), Store(Path("nowhere"))).plan()
        except InputError:
            continue
        known.append(path)
    return known


def params(rng: random.Random, folder: Path) -> None:
    """Values of ``--set`` that nobody should give."""
    path = rng.choice(_plannable())
    flow = load_flow(path)
    chosen = {}
    for _ in range(rng.choice((1, 1, 2))):
        step = rng.choice(list(flow.steps.values()))
        names = [*type(step.params).model_fields, odd_value(rng)]
        target = (
            f"{step.name}.{rng.choice(names)}" if rng.random() < 0.8 else rng.choice([*flow.params, odd_value(rng)])
        )
        number = str(rng.choice((0.5, 1, 3, 64, rng.randint(-5, 5000))))
        chosen[target] = rng.choice((odd_value(rng), number, number, mutated_text(rng, number)))
    _planned(path, folder, params=chosen)


def _planned(path: Path, folder: Path, **overrides: Any) -> None:
    """Load a flow, and plan it where its sources are there."""
    Run(load_flow(path, Overrides(**overrides)), Store(folder / "store")).plan()


def map_sets(rng: random.Random, folder: Path) -> None:
    """Folders and YAML files of maps."""
    words = (
        "albedo",
        "Color",
        "normal_dx",
        "NormalGL",
        "rough",
        "height",
        "mask",
        "x",
        "metal",
        "ao",
        "=1+1",
        "a\nb",
    )
    for name in dict.fromkeys([*rng.sample(words, rng.randint(1, 5)), *(words[:1] if rng.random() < 0.7 else ())]):
        suffix, content = _picture(rng)
        (folder / f"{name}.{suffix}").write_bytes(mutated(rng, content) if rng.random() < 0.1 else content)
    reference = folder
    if rng.random() < 0.5:
        named = sorted(path.name for path in folder.iterdir())
        lines = [f"{rng.choice(words)!r}: {rng.choice(named)!r}" for _ in named]
        text = "\n".join([*lines, rng.choice(("resample: true", "normal_convention: directx", "resample: 3"))])
        reference = folder / "set.yaml"
        reference.write_text(mutated_text(rng, text) if rng.random() < 0.7 else text)
    open_source("exemplar", str(reference)).read()


def stacks(rng: random.Random, folder: Path) -> None:
    """Frame stacks: folders, patterns and files, some damaged or of other sizes and channels."""
    for number in rng.sample(range(12), rng.randint(1, 4)):
        path = folder / f"{rng.choice(('frame', 'frame', 'f_1_'))}{number}.png"
        planes = rng.choice((3,) * 9 + (1,))
        pixels = _pixels(rng, height=rng.choice((12,) * 9 + (8,)), planes=planes)
        PIL.Image.fromarray(pixels[..., 0] if planes == 1 else pixels).save(path)
        if rng.random() < 0.1:
            path.write_bytes(mutated(rng, path.read_bytes()))
    content = rng.choice(_exrs())
    (folder / "parts.exr").write_bytes(mutated(rng, content) if rng.random() < 0.7 else content)
    (folder / "a.tiff").write_bytes(b"II*")
    name = rng.choice(
        ("frame*.png", "frame*.png", "*[0-9].png", "", "parts.exr", "none", "*.exr", "**", odd_value(rng))
    )
    open_source("frames", f"stack:{folder}/{name}").read()


def masks(rng: random.Random, folder: Path) -> None:
    """Masks and control maps of any size, channels and values."""
    path = write_flow(
        folder,
        "flow: masks\n"
        "sources: {exemplar: exemplar.png, mask: mask.png, target: target.png}\n"
        "steps:\n"
        "  rest: {stage: analysis.exclusion_mask, inputs: {image: exemplar, mask: mask}}\n"
        "  result:\n"
        "    stage: synthesis.reconstruct\n"
        "    inputs: {image: exemplar, control: mask, target: target}\n",
        side=32,
    )
    for name in ("mask", "target"):
        sides = rng.choice(((32, 32), (32, 32), (16, 16), (32, 31), (2, 2), (64, 64)))
        planes = rng.choice((1, 3, 4))
        values = np.full((*sides, planes), rng.choice((0, 1, 255)), np.uint8)
        if rng.random() < 0.5:
            values[: rng.randint(0, 40), : rng.randint(0, 40), rng.randrange(planes) :] = rng.randrange(256)
        PIL.Image.fromarray(values[..., 0] if planes == 1 else values).save(folder / f"{name}.png")
    run = Run(load_flow(path), Store(folder / "store"))
    run.plan()
    run.shared.values()


def geometry(rng: random.Random, folder: Path) -> None:
    """Geometry files with other words and lines."""
    source = rng.choice(_GEOMETRIES)
    for picture in source.parent.glob("*.png"):
        (folder / picture.name).symlink_to(picture)
    path = folder / "geometry.yaml"
    path.write_bytes(mutated_text(rng, source.read_text()).encode(errors="surrogatepass"))
    chosen = {"surface.geometry": str(path)}
    _planned(ROOT / "configs" / "photo_completion.yaml", folder, params=chosen, sources={"photo": "skimage:coffee"})


@cache
def _meshes() -> dict[str, bytes]:
    """Suffix and content of a mesh with texture coordinates, of each kind that can be read here."""
    made = {
        ".obj": SQUARE_OBJ.encode(),
        ".ply": PLY.encode(),
        ".off": b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n",
    }
    mesh, image = with_normals(square()), Image(np.full((2, 2, 3), 0.5, np.float32), ("R", "G", "B"))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "square.glb"
        write(WriteJob(path, image, Image, {}, mesh=mesh))
        made[".glb"] = path.read_bytes()
        if find_spec("pxr") is not None:
            from pxr import Sdf

            write(WriteJob(path.with_suffix(".usda"), image, Image, {}, mesh=mesh))
            Sdf.Layer.FindOrOpen(str(path.with_suffix(".usda"))).Export(str(path.with_suffix(".usdc")))
            made[".usdc"] = path.with_suffix(".usdc").read_bytes()
    return made


def meshes(rng: random.Random, folder: Path) -> None:
    """Meshes with flipped, cut, repeated or replaced parts, which get charts and directions if they can be read."""
    suffix, content = rng.choice(sorted(_meshes().items()))
    path = folder / f"mesh{suffix}"
    path.write_bytes(mutated(rng, content))
    mesh = open_mesh("mesh", str(path)).value()
    assert isinstance(mesh, np.ndarray)
    if has_texture(mesh):
        mesh = surface_charts(mesh, SurfaceChartsParams(size=(16, 16), charts="own")).mesh
    else:
        whole = of_faces(mesh, sound(mesh))
        if not len(whole):
            raise InputError("no face has an area")  # as `surface_charts` does, which comes first in flows
        mesh = with_normals(whole)
    made = surface_direction(mesh, SurfaceDirectionParams(field="curvature", passes=4))
    if not np.isfinite(made.direction).all():
        raise UnexpectedError("a direction that is not finite")


@cache
def _stored() -> tuple[Path, dict[str, bytes]]:
    """A folder with a flow and a store in which it has run, and its exports."""
    folder = Path(tempfile.mkdtemp())
    path = write_flow(folder, _STORED, side=32)
    run_local(Run(load_flow(path), Store(folder / "store")), folder / "out")
    expected = files(folder / "out")
    shutil.rmtree(folder / "out")
    return folder, expected


def stores(rng: random.Random, folder: Path) -> None:
    """Stores in which a file is damaged or gone; the run ends with the same exports."""
    whole, expected = _stored()
    shutil.copytree(whole, folder, dirs_exist_ok=True)
    files_there = (path for path in (folder / "store").rglob("*") if path.is_file())
    there = sorted(path for path in files_there if path.parent.name != "markers")  # without it is another's store
    for path in rng.sample(there, rng.choice((1, 1, 2))):
        content, times = path.read_bytes(), path.stat()
        match rng.randrange(5):
            case 0:
                path.unlink()
            case 1 | 2:
                path.write_bytes(mutated(rng, content))
            case 3:
                path.write_bytes(mutated_text(rng, content.decode("latin-1")).encode("latin-1", "replace"))
            case 4:
                other = rng.choice(there)
                path.write_bytes(other.read_bytes() if other.exists() else b"")
        if path.exists() and rng.random() < 0.3:
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    run = Run(load_flow(folder / "flow.yaml"), Store(folder / "store"))
    run.plan()
    run_local(run, folder / "out", Events())
    if files(folder / "out") != expected:
        raise UnexpectedError("a damaged store changed the exports")


KINDS: dict[str, Callable[[random.Random, Path], None]] = {
    one.__name__: one
    for one in (
        pictures,
        exr,
        flows,
        params,
        map_sets,
        stacks,
        masks,
        geometry,
        meshes,
        stores,
        messages,
        arrays,
        projects,
        *((shared,) if find_spec("fsspec") is not None else ()),
    )
}


def run_case(kind: str, number: int) -> tuple[bool, str | None]:
    """Whether a case was accepted, and what is wrong with how it went."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            KINDS[kind](random.Random(f"{kind} {number}"), folder)
        except InputError as error:
            text = str(error)
            if not text.isprintable() or not text:
                return False, f"an error that is no printable line: {ascii(text)[:200]}"
            accepted = False
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            return False, f"{type(error).__name__} at {where}: {ascii(str(error))[:120]}"
        else:
            accepted = True
        left = [path.name for path in folder.rglob(".new-*")]
        return accepted, f"left {left[0][:5]}..." if left else None
