"""Textures under a new control map, which turn with it or not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.pipelines.flows import Events
from tests.pipelines.media.test_material_set import save
from texloom.pipelines.engine.run_scores import choices_of
from texloom.pipelines.engine.scheduler import execute

SIDE = 96


def rings() -> tuple[np.ndarray, np.ndarray]:
    """A texture around a middle, and the distance to it, 8 bits."""
    rows, columns = np.indices((SIDE, SIDE)) - SIDE / 2
    radius = np.hypot(rows, columns)
    grey = np.rint(120 + 60 * np.sin(radius) + 0 * radius).astype(np.uint8)
    return np.stack([grey, grey // 2, 255 - grey], axis=2), np.rint(radius * 3).astype(np.uint8)


def test_it_takes_the_way_that_suits(opened: Any, tmp_path: Path) -> None:
    texture, control = rings()
    save(tmp_path / "rings.png", texture)
    save(tmp_path / "control.png", control)
    save(tmp_path / "target.png", np.tile(np.linspace(0, 200, SIDE).astype(np.uint8), (SIDE, 1)))
    sources = {name: tmp_path / f"{file}.png" for name, file in
               {"texture": "rings", "control": "control", "target": "target"}.items()}  # fmt: skip
    run = opened("resynthesise", sources)
    files = execute(run, Events(), tmp_path / "out")
    assert choices_of(run)["turning"]["chosen"] == ["turned"]
    assert "directions.png" in files
    notes = json.loads(files["notes.json"].read_text())
    assert notes[-1].startswith("The texture turns with its control map: ")
    plain = execute(opened("resynthesise", sources, way="plain", preset="fast"), Events(), tmp_path / "plain")
    assert "directions.png" not in plain
    assert json.loads(plain["notes.json"].read_text())[-1].startswith("The texture keeps its directions")
