"""Geometry files of the page for photographs that are reduced, for previews."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import yaml

_AREAS = ("region", "without", "hole")


def reduced_geometry(file: Path, folder: Path, scale: float) -> Path:
    """Write a geometry file, as the page keeps it, for a photograph that is reduced; its path.

    Parameters
    ----------
    file : its areas are pictures beside it.
    folder : for the file and its pictures, made if need be.
    scale : of a side.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = yaml.safe_load(file.read_bytes())
    content["patches"] = [_moved(patch, scale) for patch in content["patches"]]
    named = [content, *([content["features"]] if "features" in content else [])]
    for areas in named:
        for name, area in areas.items():
            if isinstance(area, str) and (areas is not content or name in _AREAS):
                _reduce_area(file.with_name(area), folder / area, scale)
    path = folder / file.name
    path.write_text(yaml.safe_dump(content))
    return path


def _moved(patch: dict[str, Any], scale: float) -> dict[str, Any]:
    points = {name: patch[name] for name in ("corners", "controls") if name in patch}
    moved = {name: ((np.array(at) + 0.5) * scale - 0.5).tolist() for name, at in points.items()}
    return patch | moved  # pixel centres are at integers


def _reduce_area(picture: Path, small: Path, scale: float) -> None:
    with PIL.Image.open(picture) as area:
        width, height = (max(2, round(side * scale)) for side in area.size)
        reduced = area.convert("L").resize((width, height), PIL.Image.Resampling.BOX)
    reduced.point(lambda code: 255 if code >= 128 else 0).save(small)
