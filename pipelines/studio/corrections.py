"""For corrections of a result: where it is bad, where its pixels come from, and other versions of a spot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages.answers import AlternativePicture
from texloom.pipelines.studio.messages.requests import AlternativesRequest
from texloom.pipelines.studio.messages.runs import BadPlace, Insight
from texloom.pipelines.studio.offers import OFFERS
from texloom.pipelines.studio.page_images import rgba
from texloom.pipelines.studio.recipe_flows import image_of, open_recipe, open_texture
from texloom.pipelines.studio.work import InsightWork, Places, library_of
from texloom.stages.common.source_maps.places import worst_places
from texloom.stages.synthesis.edits.revise import marked_pixels
from texloom.stages.vocabulary.arrays import Image

_COUNT = 8
_SEPARATION = 0.04  # of the longer side, between bad places
_MOST_PIXELS = 2**24  # of a result whose sources are sent
_MARGIN = 24  # px around a region, of the picture that is shown


def insight(work: InsightWork, places: Places, send: Callable[..., None]) -> None:
    """Send the worst places of a result, and row and column of the exemplar's pixel of each pixel, 16-bit integers.

    They are those of the exemplar before it was scaled. Whatever the result does not tell is left out, and so are
    places in several exemplars.
    """
    run = open_recipe(work.recipe, library_of(places), Store(Path(places.store)))
    run.plan()
    match, joints = _output(run, "texture", "match"), _output(run, "scores", "joints")
    size = (0, 0) if match is None else match.shape[:2]
    found = []
    if joints is not None and joints.shape == size:
        worst = worst_places(joints, _COUNT, round(_SEPARATION * max(size)))
        found = [BadPlace(row=one.row, column=one.column, value=one.value) for one in worst]
    offer = OFFERS.get(work.recipe.flow)
    is_straightened = offer is not None and bool(offer.surface)  # what is shown of a photograph lies otherwise
    is_one = not run.items and not is_straightened
    is_known = match is not None and is_one and match.shape[0] * match.shape[1] <= _MOST_PIXELS
    payload = b""
    if is_known:
        scaled = _output(run, "scaled", "table")
        is_scaled = scaled is not None and bool(scaled["why"])
        origins = match / np.array(scaled["scale"]) if is_scaled else match
        payload = np.minimum(origins, 65535).astype("<u2").tobytes()
    send(Insight(height=size[0], width=size[1], places=tuple(found)), payload)


def _output(run: Run, step: str, output: str) -> Any:
    """An output that is in the store; none where the flow or the store has none."""
    artifact = run.shared.artifacts.get(step)
    if artifact is None or output not in artifact.outputs:
        return None
    return run.store.load(artifact, run.flow.steps[step].stage.result, [output])[output]


def alternatives(
    work: AlternativesRequest, places: Places, check: Callable[[], None], send: Callable[..., None]
) -> None:
    """Send what each seed makes of a region, in the user's store: what is accepted is there already."""
    library, store = library_of(places), Store(Path(places.store))
    for seed in work.seeds:
        run, made = open_texture(work.recipe.model_copy(update={"seed": seed}), library, store)
        execute(run, lambda _: check(), store.root / "runs")
        region = run.shared.source("region").read()
        _send_part(run, made, region, work.number, seed, send)


def _send_part(run: Run, made: Reference, region: Image, number: int, seed: int, send: Callable[..., None]) -> None:
    image = image_of(run, made)
    marked = np.argwhere(marked_pixels(region))
    top, left = np.maximum(0, marked.min(axis=0) - _MARGIN)
    bottom, right = np.minimum((image.height, image.width), marked.max(axis=0) + 1 + _MARGIN)
    part = Image(np.ascontiguousarray(image.pixels[top:bottom, left:right]), image.channels)
    told = AlternativePicture(
        number=number, seed=seed, top=int(top), left=int(left), height=part.height, width=part.width
    )
    send(told, rgba(part))
