"""Recipes as flows: what runs, as a YAML file and as a command."""

from __future__ import annotations

import copy
import dataclasses
import json
import re
from collections.abc import Iterable
from typing import Any, get_args

import yaml

from texloom.pipelines.api import for_texture
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.engine.run import Run
from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.command import command_of
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow, Overrides, Reference
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.media.arrays import file_source, masked
from texloom.pipelines.request import RunRequest, request
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.catalogue import Method, OtherPicture
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Described, PlannedStep
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import size_value

METHODS = {
    "self_tuning": "Most materials; structures stay connected",
    "materials": "All maps of a material, from one correspondence",
    "near_regular": "Tiles, grids and weaves",
    "quilting": "Large irregular pieces, in a second or two",
    "graph_cut": "Large irregular pieces, cut along the best seams",
    "patch_based": "Grain, soil and noise, quickly",
    "per_pixel": "Grain, soil and noise, pixel by pixel",
    "grow": "What ages or changes from place to place, its trend over all of the result",
    "restyle": "Another picture, made of the exemplar",
}
"""the flows of an exemplar that the page offers, and what each is for"""
_OTHERS = {
    "grow": {"target": "Trend of the result", "progression": "Trend of the exemplar"},
    "restyle": {"picture": "Picture that it is laid over"},
}
"""flow to the pictures that it takes besides the exemplar, and what the page calls them"""
_SIDES = (1024, 1024)  # px, of a result whose flow has no size of its own
_SHARED = (RunRequest.model_fields.keys() & Recipe.model_fields.keys()) - {"sources", "params"}
"""what a recipe gives as a request does; its pictures and documents have ids, not paths"""
_UNIFORMITY = "occurrence"


def methods() -> list[Method]:
    """What the page has to know of each of `METHODS`."""
    return [_method(name) for name in METHODS]


def _method(name: str) -> Method:
    flow = load_flow(shipped_flows()[name])
    size = _default(flow, "size")
    texture = flow.steps["texture"]
    has_uniformity = _UNIFORMITY in type(texture.params).model_fields
    return Method(
        flow=name,
        about=METHODS[name],
        size=size or _SIDES,
        can_tile="tileable" in flow.params,
        presets=_choices(flow, "preset"),
        uniformity=f"texture.{_UNIFORMITY}" if has_uniformity else "",
        default_uniformity=getattr(texture.params, _UNIFORMITY) if has_uniformity else 0.0,
        others=tuple(
            OtherPicture(source=source, about=about, is_required=source not in flow.optional)
            for source, about in _OTHERS.get(name, {}).items()
        ),
    )


def _default(flow: Flow, name: str) -> Any:
    step, _, param = flow.params[name][0].partition(".")
    return getattr(flow.steps[step].params, param)


def _choices(flow: Flow, name: str) -> tuple[str, ...]:
    """The values that a param can have, where they are words."""
    step, _, param = flow.params.get(name, ("",))[0].partition(".")
    return get_args(type(flow.steps[step].params).model_fields[param].annotation) if step else ()


def overrides_of(recipe: Recipe, library: Library) -> Overrides:
    """The recipe as the changes that the command line would make; `InputError` where it is not one of ours."""
    if recipe.flow not in shipped_flows():
        raise InputError(one_line(f"{recipe.flow}: no such flow"))
    if not recipe.sources:
        raise InputError("no picture is chosen")
    sources = {name: library.reference(picture) for name, picture in recipe.sources.items()}
    if recipe.mask is not None:
        first = next(iter(sources))
        mask = library.reference(recipe.mask)
        folder = library.roots.get("attached") or library.dropped()
        sources[first] = file_source(masked(sources[first], mask), folder)
    given = {name: getattr(recipe, name) or None for name in _SHARED} | {"seed": recipe.seed}
    params = {
        name: value if isinstance(value, tuple) else json.dumps(value)
        for name, value in _params(recipe, library)
        if name not in _SHARED
    }
    return request(**given, sources=sources, params=params).overrides


def _params(recipe: Recipe, library: Library) -> Iterable[tuple[str, Any]]:
    """The params that are given, by the names of the command line."""
    if recipe.size is not None:
        yield "size", recipe.size
    if recipe.tileable is not None:
        yield "tileable", recipe.tileable
    if recipe.preset is not None:
        yield "preset", recipe.preset
    yield from recipe.params.items()
    for name, file in recipe.files.items():
        yield name, library.reference(file)


def open_recipe(recipe: Recipe, library: Library, store: Store) -> Run:
    """The run of a recipe; the same as that of its command and of its flow file."""
    return open_run(recipe.flow, overrides_of(recipe, library), store)


def open_texture(recipe: Recipe, library: Library, store: Store) -> tuple[Run, Reference]:
    """As `open_recipe`, but only with the steps that the texture needs, without scores and exports; the texture."""
    run = open_recipe(recipe, library, store)
    flow, made = for_texture(run.flow, recipe.flow)
    steps = {name: step for name, step in flow.steps.items() if name in upstream_of(flow, made.name)}
    return Run(dataclasses.replace(flow, steps=steps), store), made


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
    source = "exemplar" if "exemplar" in run.flow.sources else next(iter(run.flow.sources))
    picture = run.shared.source(source).picture
    return re.sub(r"[^A-Za-z0-9_-]+", "_", f"{picture}_{run.flow.name}").strip("_")


def _in_file(name: str, value: Any) -> Any:
    """A value as a flow file has it."""
    return size_value(value) if name == "size" else copy.copy(value)  # YAML has no anchors


def flow_file(recipe: Recipe, flow: Flow, file: str, library: Library) -> str:
    """The flow file of a recipe, called ``file``; its flow has the name of ours, which is in the provenance."""
    steps: dict[str, Any] = {}
    for name, value in _params(recipe, library):
        for target in flow.params.get(name, (name,)):
            step, _, param = target.partition(".")
            steps.setdefault(step, {"params": {}})["params"][param] = _in_file(name, value)
    document: dict[str, Any] = {"flow": flow.name, "seed": recipe.seed, "include": recipe.flow}
    if recipe.layout:
        document["delivery"] = {"layout": recipe.layout}
    document["sources"] = {name: flow.sources[name] for name in recipe.sources}
    if steps:
        document["steps"] = steps
    head = f"# Made in the studio of texloom.\n#\n#   texloom run {file} --out {file.removesuffix('.yaml')}\n"
    return head + yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True)
