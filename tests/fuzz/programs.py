"""What programs and people leave: arrays of Python, results in a shared store, project files of the studio."""

from __future__ import annotations

import random
import shutil
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

import texloom
from tests.fuzz.mutations import mutated, mutated_text
from tests.pipelines.flows import Events, run_local, write_flow
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import exr
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages.projects import Material, ProjectView
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.projects.files import FOLDER, ProjectFiles
from texloom.pipelines.studio.projects.project import Project
from texloom.stages.vocabulary.declare import InputError

_DTYPES = (
    "u1", "u1", "u2", "f4", "f4", "f8", "f2", "?", "i1", "i4", "i8", "u4", "u8", "c8", "O", "U3", "S2", "M8[s]",
    ">u2", ">f4", "V4",
)  # fmt: skip
_SIDES = (0, 1, 2, 7, 12, 16, 24, 24, 24)
_MAPS = ("albedo", "normal", "roughness", "height", "mask", "metallic", "ao", "gloss", "../x", "", "Albedo", "é", 3)
_ID = "0123456789abcdef"


def _array(rng: random.Random) -> Any:
    """An array of any type, shape, layout in memory and values, perhaps as a list, or masked."""
    shape = [24, 24] if rng.random() < 0.6 else [rng.choice(_SIDES) for _ in range(rng.choice((0, 1, 2, 2, 4)))]
    if len(shape) == 2 and rng.random() < 0.6:
        shape.append(rng.choice((0, 1, 2, 3, 3, 3, 4, 5, 9)))
    generator = np.random.default_rng(rng.randrange(2**32))
    values = np.asarray(generator.normal(size=shape)) * rng.choice((1, 1, 300, 1e30)) + rng.choice((0, 0.5, 100))
    if values.size and rng.random() < 0.3:
        values.flat[rng.randrange(values.size)] = rng.choice((np.nan, np.inf, -np.inf, -1, 0))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        dtype = np.dtype(rng.choice(_DTYPES[:6] if rng.random() < 0.6 else _DTYPES))
        array = np.asarray(values, "i8" if dtype.kind in "MV" else None).astype(dtype)
    match rng.randrange(9):
        case 0:
            array = array[::-1] if array.ndim else array
        case 1:
            array = array.T
        case 2:
            array = np.repeat(array, 2, axis=0)[::2] if array.ndim else array
        case 3:
            array = np.broadcast_to(array, (3, *array.shape))
        case 4 if isinstance(array, np.ndarray):
            array.flags.writeable = False
        case 5:
            return np.ma.masked_array(array, mask=generator.random(array.shape) < rng.choice((0, 0.5, 1)))
        case 6:
            return np.asarray(array).tolist()
    return array


def arrays(rng: random.Random, folder: Path) -> None:
    """Arrays, and maps by name, as sources of a flow; what is accepted is read, and a run is planned."""
    given: Any = _array(rng)
    if rng.random() < 0.4:
        given = {rng.choice(_MAPS): _array(rng) for _ in range(rng.choice((0, 1, 2, 3)))}
    source = open_source("exemplar", file_source(given, folder / "arrays"))
    image = source.read()
    if not np.isfinite(image.pixels[..., : min(3, len(image.channels))]).all():
        raise AssertionError("an image that is not finite")
    if rng.random() < 0.2:
        texloom.plan("quilting", {"exemplar": given}, size=rng.choice((16, "x", -1, 32)), store=folder / "store")


@cache
def _shared() -> Path:
    """A folder with a flow, a shared store that has its results, and the exports."""
    folder = Path(tempfile.mkdtemp())
    path = write_flow(folder, side=32)
    run_local(Run(load_flow(path), Store(folder / "store", f"file://{folder}/shared")), folder / "out")
    (folder / "out" / "distance.exr").rename(folder / "expected.exr")
    (folder / "out" / "structure.png").rename(folder / "structure.png")
    for name in ("out", "store"):
        shutil.rmtree(folder / name)
    return folder


def shared(rng: random.Random, folder: Path) -> None:
    """A shared store in which an object is damaged, gone, or another's; the run ends with the same pixels.

    What else a record says, as of the program that has made a result, is believed, see ``docs/cluster.md``.
    """
    whole = _shared()
    shutil.copytree(whole, folder, dirs_exist_ok=True)
    there = sorted(path for path in (folder / "shared").rglob("*") if path.is_file())
    for path in rng.sample(there, rng.choice((1, 2, 4))):
        content = path.read_bytes()
        match rng.randrange(4):
            case 0:
                path.unlink()
            case 1:
                path.write_bytes(mutated(rng, content))
            case 2:
                path.write_bytes(mutated_text(rng, content.decode("latin-1")).encode("latin-1", "replace"))
            case 3:
                other = rng.choice(there)
                path.write_bytes(other.read_bytes() if other.exists() else b"")
    run = Run(load_flow(folder / "flow.yaml"), Store(folder / "store", f"file://{folder}/shared"))
    run.plan()
    run_local(run, folder / "out", Events())
    _, made = exr.load(folder / "out" / "distance.exr")
    _, before = exr.load(whole / "expected.exr")
    ((_, planes),) = before.items()
    same = all(np.array_equal(plane, next(iter(made.values())).get(name)) for name, plane in planes.items())
    pictures = folder / "out" / "structure.png", whole / "structure.png"
    if not same or not np.array_equal(*(np.asarray(PIL.Image.open(path)) for path in pictures)):
        raise AssertionError("a damaged shared store changed the exports")


def projects(rng: random.Random, folder: Path) -> None:
    """Project files of the studio with other words, lines and bytes; what is read can be saved again."""
    there = ProjectFiles(folder)
    recipe = Recipe(flow="quilting", sources={"exemplar": "folder:moss.png"}, seed=3)
    there.write_view(ProjectView(view="make", material=_ID))
    there.write_material(Material(id=_ID, name="Moss", made=1.0, changed=2.0, draft=recipe, tags=("wet",)))
    for path in rng.sample(sorted((folder / FOLDER).rglob("*.json")), rng.choice((1, 2))):
        content = path.read_bytes()
        if rng.random() < 0.3:
            path.write_bytes(mutated(rng, content))
        else:
            path.write_bytes(mutated_text(rng, content.decode()).encode(errors="surrogatepass"))
    materials, problems = there.read_materials()
    if not all(problem.isprintable() and problem for problem in problems):
        raise AssertionError(f"a problem that is no printable line: {ascii(problems)[:200]}")
    view = there.read_view()
    project = Project(view, materials, lambda _: None)
    for material in materials:
        project.duplicate(material.id)
        there.write_material(material)
    there.write_view(view)
    if problems:
        raise InputError(problems[0])
