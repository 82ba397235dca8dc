"""Small files by the names that commands of the documentation use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from tests.conftest import ROOT
from texloom.pipelines.store import codec
from texloom.stages.vocabulary.arrays import Image as Pixels

SIDE, REGULAR, RESULT = 160, 320, 512
"""px: of a picture, of one whose lattice or courses are found, and of a result of another program"""
COMPACTION = 128
"""px, of compactions as the flow `inverse` makes them"""
FLAGS = ("--tileable", "--json")
"""options without a value"""
WRITTEN = ("--out", "--report", "--store", "--png", "--export")
"""options that name what is written"""
GEOMETRY = """
patches:
  - {name: wall, corners: [[10, 10], [10, 150], [150, 150], [150, 10]], edge: 140}
hole: [[[60, 60], [60, 90], [90, 90]]]
"""
LIGHTS = '{"lights": [[0, 0.5, 1], [0.5, -0.5, 1], [-0.5, -0.5, 1]]}'
FLOW = "{flow: self_tuning, include: self_tuning}"
PIECES = "pieces: [{box: [0, 0, 90, 90], at: [60, 60]}]"
_EXEMPLARS = ROOT / "configs" / "exemplars"
_MAPS = {kind: _EXEMPLARS / "brick_maps" / f"bricks_{kind}.png" for kind in ("albedo", "height")}


def make_files(arguments: Sequence[str], folder: Path) -> None:
    """The files in ``folder`` that a command takes: pictures, masks, maps of materials, geometry, results."""
    previous = ""
    if ">" in arguments:  # where the shell writes its output
        arguments = arguments[: arguments.index(">")]
    for number, argument in enumerate(arguments):
        name = argument.partition("=")[2] if previous in ("--source", "--set", "--against") else argument
        is_picture = (
            number > 1 and not argument.startswith("-") and (not previous.startswith("--") or previous in FLAGS)
        )
        if name.startswith("skimage:") or previous in WRITTEN:
            pass
        elif name.endswith(".yaml"):
            is_flow = number == 1
            (folder / name).write_text(FLOW if is_flow else PIECES if "pieces" in name else GEOMETRY)
        elif name == "lights.json":
            (folder / name).write_text(LIGHTS)
        elif name == "lights":
            for place in "123":
                make_pictures(folder, f"{name}/{place}.png")
        elif name.endswith(".exr"):
            make_result(folder / name.replace("*", "any"))
        elif previous in ("--over", "--against"):
            make_pictures(
                folder, name if "*" in name else f"{name}/*.png", RESULT if previous == "--against" else SIDE
            )
        elif previous == "--source" or (is_picture and arguments[0] in ("run", "plan")):
            make_pictures(folder, name)
        previous = argument


def make_pictures(folder: Path, name: str, side: int = SIDE) -> None:
    """A picture, a folder of maps, or two that a pattern matches; square, of ``side`` px."""
    for path in [folder / name.replace("*", word) for word in (("one", "two") if "*" in name else ("",))]:
        if path.exists():
            continue
        maps = {path: _original(path)} if path.suffix else {path / f"{kind}.png": _MAPS[kind] for kind in _MAPS}
        for file, original in maps.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            picture = Image.open(original) if isinstance(original, Path) else original
            own = COMPACTION if path.stem == "edited" else REGULAR if path.parent.name == "regular" else side
            picture.crop((0, 0, min(own, picture.width), min(own, picture.height))).resize((own, own)).save(file)


def _original(path: Path) -> Path | Image.Image:
    """A picture that suits the name: a mask, holes, a control map, or bricks."""
    row, column = np.mgrid[:SIDE, :SIDE] / SIDE
    if "hole" in path.stem or path.stem == "spot":
        return _grey((row - 0.5) ** 2 + (column - 0.5) ** 2 < 0.02)
    if "mask" in path.stem:
        return _grey(row < 0.8)
    if path.stem.startswith(("target", "painted")):
        return _grey(column)
    if path.stem == "strokes":
        return _grey((row * 6) % 1 < 0.1)
    if "control" in path.stem or "metallic" in path.stem or path.stem == "wetness":
        return _grey(row)
    return _EXEMPLARS / "bricks.png"


def _grey(values: np.ndarray) -> Image.Image:
    """A picture of values from 0 to 1."""
    return Image.fromarray(np.uint8(np.asarray(values, np.float64) * 255))


def make_result(path: Path) -> None:
    """An EXR as texloom writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    codec.export(Pixels(np.zeros((8, 8, 1), np.float32), ("Y",)), Pixels, path, {})
