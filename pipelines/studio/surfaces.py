"""Meshes as the page shows them, in a worker: with the texture coordinates in which textures are made for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.recipe_flows import open_recipe, output_of, steps_alone, upstream_of
from texloom.pipelines.studio.work import Meshed, MeshWork, Places, library_of

FLOW = "on_mesh"
_CHARTS = "charts"  # the step of the flow that gives texture coordinates


def mesh(work: MeshWork, places: Places, check: Callable[[], None], send: Callable[..., None]) -> None:
    """Send position, normal and texture coordinates of all corners of a mesh, as float32."""
    recipe = Recipe(flow=FLOW, sources={"mesh": work.mesh}, size=(work.side, work.side))
    store = Store(Path(places.store))
    run = open_recipe(recipe, library_of(places), store)
    run = steps_alone(run, upstream_of(run.flow, _CHARTS))
    execute(run, lambda _: check(), store.root / "runs")
    corners = np.ascontiguousarray(output_of(run, _CHARTS, "mesh")[:, :8], np.float32)
    send(Meshed(corners=len(corners)), corners.tobytes())
