"""Recipes as flows: what runs, as a YAML file and as a command."""

from __future__ import annotations

import copy
import dataclasses
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from texloom.pipelines.api import for_texture
from texloom.pipelines.engine.destination import name_of_pictures
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.engine.run import Run
from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.command import command_of
from texloom.pipelines.flow.items import own_names
from texloom.pipelines.flow.model import Each, Flow, Overrides, Reference
from texloom.pipelines.flow.schema import FORMAT
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.media.array_sources import file_source, masked
from texloom.pipelines.media.material_set import holds_one_material
from texloom.pipelines.request import RunRequest, request
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Described, PlannedStep
from texloom.pipelines.studio.offers import WEIGHTS
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import size_value

_SHARED = (RunRequest.model_fields.keys() & Recipe.model_fields.keys()) - {"sources", "params"}
"""what a recipe gives as a request does; its pictures and documents have ids, not paths"""


def overrides_of(recipe: Recipe, library: Library) -> Overrides:
    """The recipe as the changes that the command line would make; `InputError` where it is not one of ours."""
    if recipe.flow not in shipped_flows():
        raise InputError(one_line(f"{recipe.flow}: no such flow"))
    if not recipe.sources:
        raise InputError("no picture is chosen")
    sources: dict[str, str | tuple[str, ...]] = {
        name: library.reference(given) if isinstance(given, str) else _several(name, given, library)
        for name, given in recipe.sources.items()
    }
    if recipe.mask is not None:
        first, exemplar = next(iter(sources.items()))
        if not isinstance(exemplar, str):
            raise InputError(f"sources.{first}: a mask is of one picture, not of several")
        mask = library.reference(recipe.mask)
        folder = library.roots.get("attached") or library.dropped()
        sources[first] = file_source(masked(exemplar, mask), folder)
    given = {name: getattr(recipe, name) or None for name in _SHARED} | {"seed": recipe.seed}
    params = {
        name: value if isinstance(value, tuple) else json.dumps(value)
        for name, value in _params(recipe, library)
        if name not in _SHARED
    }
    return request(**given, sources=sources, params=params, keep="all").overrides  # the next change takes them


def _several(name: str, pictures: tuple[str, ...], library: Library) -> tuple[str, ...]:
    """What a flow file calls pictures of one source; `InputError` also where one is there twice, or is none."""
    found = tuple(library.reference(picture) for picture in pictures)
    for number, one in enumerate(found):
        if one in found[:number]:
            raise InputError(one_line(f"sources.{name}: {Path(one).name} is chosen twice"))
        if Path(one).is_dir() and not holds_one_material(Path(one)):
            raise InputError(one_line(f"sources.{name}: {Path(one).name} is a folder of several; choose pictures"))
    return found


def _params(recipe: Recipe, library: Library) -> Iterable[tuple[str, Any]]:
    """The params that are given, by the names of the command line."""
    if recipe.size is not None:
        yield "size", recipe.size
    if recipe.tileable is not None:
        yield "tileable", recipe.tileable
    if recipe.preset is not None:
        yield "preset", recipe.preset
    yield from recipe.params.items()
    for name, numbers in recipe.lists.items():
        yield name, _weights(recipe, numbers, library) if name == WEIGHTS else list(numbers)
    for name, file in recipe.files.items():
        yield name, library.reference(file)


def _weights(recipe: Recipe, numbers: tuple[float, ...], library: Library) -> dict[str, float]:
    """One number for each of several pictures, by the names that the flow gives them."""
    source, pictures = next(iter(recipe.sources.items()))
    if isinstance(pictures, str) or len(pictures) != len(numbers):
        raise InputError(f"lists.{WEIGHTS}: one number for each picture of '{source}', got {len(numbers)}")
    names = own_names([library.reference(picture) for picture in pictures])
    return dict(zip(names.values(), numbers, strict=True))


def open_recipe(recipe: Recipe, library: Library, store: Store) -> Run:
    """The run of a recipe; the same as that of its command and of its flow file."""
    return open_run(recipe.flow, overrides_of(recipe, library), store)


def open_texture(
    recipe: Recipe, library: Library, store: Store, export: str | None = None, draft: Reference | None = None
) -> tuple[Run, Reference]:
    """As `open_recipe`, but only with the steps that one picture needs, without scores and exports; the picture.

    Parameters
    ----------
    export : what is wanted; none: the texture.
    draft : what stands for it, where that comes sooner.
    """
    run = open_recipe(recipe, library, store)
    flow, made = for_texture(run.flow, recipe.flow)
    if export is not None:
        flow, made = run.flow, run.flow.exports[export]
    if draft is not None:
        flow, made = run.flow, draft
    needed = upstream_of(flow, made.name)
    steps = {name: step for name, step in flow.steps.items() if name in needed}
    flow = dataclasses.replace(flow, steps=steps, exports={}, likes={}, surfaces={}, of_maps=())
    return Run(flow, store), made


def steps_alone(run: Run, names: set[str]) -> Run:
    """A run of some steps, without exports."""
    steps = {name: step for name, step in run.flow.steps.items() if name in names}
    return Run(dataclasses.replace(run.flow, steps=steps, exports={}, likes={}, of_maps=()), run.store)


def output_of(run: Run, step: str, output: str) -> Any:
    """What a step of a run has made."""
    kind = run.flow.steps[step].stage.result
    return run.store.load(run.shared.artifacts[step], kind, [output])[output]


def image_of(run: Run, made: Reference) -> Image:
    """An image that a run has made."""
    image: Image = output_of(run, made.name, str(made.output))
    return image


def upstream_of(flow: Flow, name: str) -> set[str]:
    """A step and all whose results it takes."""
    needed = {name}
    for step in reversed(list(flow.steps)):  # each comes after what it takes
        if step in needed:
            needed.update(flow.steps[step].needs)
    return needed


def described(recipe: Recipe, run: Run, library: Library) -> Described:
    """A recipe in all its forms."""
    file = f"{file_name(run)}.yaml"
    steps = [PlannedStep(name=one.name, state=one.state, reasons=one.reasons) for one in run.plan()]
    return Described(
        yaml=flow_file(recipe, run.flow, file, library), file=file, command=command_of(run.flow), steps=tuple(steps)
    )


def file_name(run: Run) -> str:
    """A name for the files of a result: that of the exemplar, or else of the first source, and the flow's."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", f"{name_of_pictures(run)}_{run.flow.name}").strip("_")


def _in_file(name: str, value: Any) -> Any:
    """A value as a flow file has it."""
    return size_value(value) if name == "size" else copy.copy(value)  # YAML has no anchors


def _source_in_file(source: str | Each) -> Any:
    """A source as a flow file has it."""
    if isinstance(source, str):
        return source
    return {"each": list(source.patterns)} | ({"ordered": True} if source.is_ordered else {})


def flow_file(recipe: Recipe, flow: Flow, file: str, library: Library) -> str:
    """The flow file of a recipe, called ``file``; its flow has the name of ours, which is in the provenance."""
    steps: dict[str, Any] = {}
    for name, value in _params(recipe, library):
        for target in flow.params.get(name, (name,)):
            step, _, param = target.partition(".")
            steps.setdefault(step, {"params": {}})["params"][param] = _in_file(name, value)
    document: dict[str, Any] = {"format": FORMAT, "flow": flow.name, "seed": recipe.seed, "include": recipe.flow}
    delivery = {"layout": recipe.layout, "udim": recipe.udim, "material": recipe.material}
    if any(delivery.values()):
        document["delivery"] = {name: value for name, value in delivery.items() if value}
    document["sources"] = {name: _source_in_file(flow.sources[name]) for name in recipe.sources}
    if steps:
        document["steps"] = steps
    head = f"# Made in the studio of texloom.\n#\n#   texloom run {file} --out {file.removesuffix('.yaml')}\n"
    return head + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True)
