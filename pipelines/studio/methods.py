"""The flows that the page offers, and how: their pictures, controls and views of what they make."""

from __future__ import annotations

import dataclasses
from typing import Any, get_args

from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.studio.messages.catalogue import (
    Choice,
    Control,
    Method,
    OtherPicture,
    ResultPicture,
    Setting,
    SeveralPictures,
)
from texloom.stages.synthesis.endless.triangle_grid import SHARE

WEIGHTS = "sheet.weights"
"""the param of which a recipe has a number for each of several pictures"""
WAY = ("suits", "way")
"""a step that chooses how a flow goes on, or refuses, and the param that decides instead"""
_SIDES = (1024, 1024)  # px, of a result whose flow has no size of its own
_UNIFORMITY = "occurrence"


@dataclasses.dataclass(frozen=True)
class Offer:
    """What is written here of a method; `methods` adds what its flow says."""

    about: str
    several: SeveralPictures | None = None
    others: dict[str, str] = dataclasses.field(default_factory=dict)
    """the pictures that it takes besides, and what the page calls them"""
    painted: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    """those of them that can be painted, and what black and white mean"""
    choices: tuple[Choice, ...] = ()
    controls: tuple[Control, ...] = ()
    views: tuple[ResultPicture, ...] = ()
    """what is shown of a result, the preview first; none: the texture"""
    is_texture: bool = True
    """whether it makes one texture that looks as its exemplar"""
    ways: dict[str, str] = dataclasses.field(default_factory=dict)
    """what its step `WAY` may choose, to the export that is shown then; none: it has no such step"""
    lengths: dict[str, int] = dataclasses.field(default_factory=dict)
    """params that are px, which are smaller in previews, to the least that they may be"""


_TEXTURE = ResultPicture(file="texture.png", name="Texture")
_WAYS = {
    "left to right": 0.0,
    "top to bottom": 90.0,
    "right to left": 180.0,
    "bottom to top": 270.0,
    "corner to corner": 45.0,
}


def _angles(param: str) -> tuple[Setting, ...]:
    return tuple(_set(name, **{param: angle}) for name, angle in _WAYS.items())


def _set(name: str, udim: str = "", /, **params: Any) -> Setting:
    return Setting(name=name, params=params, lists={}, udim=udim)


def _tiles(*sides: int) -> Choice:
    return Choice(label="Tile", settings=(_set("as fits"), *(_set(f"{side} px", tile=side) for side in sides)))


def _curve(name: str, *curve: float) -> Setting:
    return Setting(name=name, params={}, lists={"curve": curve} if curve else {})


def _number(param: str, label: str, least: float, most: float, default: float, ends: tuple[str, str]) -> Control:
    return Control(param=param, label=label, least=least, most=most, default=default, ends=ends)


def _switch(param: str, label: str, default: bool) -> Control:
    return Control(param=param, label=label, least=0, most=1, default=float(default), ends=("", ""), is_switch=True)


OFFERS = {
    "self_tuning": Offer("Most materials; structures stay connected"),
    "materials": Offer("All maps of a material, from one correspondence"),
    "near_regular": Offer("Tiles, grids and weaves"),
    "quilting": Offer("Large irregular pieces, in a second or two"),
    "graph_cut": Offer("Large irregular pieces, cut along the best seams"),
    "patch_based": Offer("Grain, soil and noise, quickly"),
    "per_pixel": Offer("Grain, soil and noise, pixel by pixel"),
    "remix": Offer(
        "One texture of several pictures",
        several=SeveralPictures(source="exemplars", least=2, is_ordered=False, ends=("", ""), weights=WEIGHTS),
        controls=(_number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),),
        views=(_TEXTURE, ResultPicture(file="origin.png", name="Which picture")),
    ),
    "mix": Offer(
        "From one picture to the next, in patches of whole elements",
        several=SeveralPictures(source="exemplars", least=2, ends=("where it begins", "where it ends")),
        others={"map": "Map"},
        painted={"map": ("the first", "the last")},
        choices=(
            Choice(
                label="Border",
                settings=(
                    _set("patches of either"),
                    _set("one clear line", patchiness=0.0, gradual=False),
                    _set("patches everywhere", patchiness=1.0),
                    _set("small islands", patchiness=1.0, **{"mixture.patch": 24}),
                ),
            ),
            Choice(
                label="Direction",
                settings=(_set("left to right"), *_angles("mixture.angle")[1:]),
                without="map",
            ),
        ),
        controls=(
            _number("patchiness", "Patches", 0, 1, 0.6, ("one border", "wherever they mix")),
            _switch("gradual", "Colours change gradually", True),
            _number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),
            _number("weight", "Hold to the map", 0.3, 3, 1.0, ("freely", "closely")),
        ),
        views=(_TEXTURE, ResultPicture(file="origin.png", name="Which picture")),
        lengths={"mixture.patch": 4},
    ),
    "grow": Offer(
        "What ages or changes from place to place, its trend over all of the result",
        others={"target": "Trend of the result", "progression": "Trend of the exemplar"},
        painted={"target": ("as it begins", "as it ends")},
        choices=(
            Choice(
                label="Trend",
                settings=(
                    _curve("as it is"),
                    _curve("reversed", 1.0, 0.0),
                    _curve("there and back", 0.0, 1.0, 0.0),
                    _curve("only the later half", 0.5, 1.0),
                    _curve("only the earlier half", 0.0, 0.5),
                    _curve("late, then all at once", 0.0, 0.1, 0.3, 1.0),
                    _curve("soon, then for long", 0.0, 0.7, 0.9, 1.0),
                ),
            ),
            Choice(label="Direction", settings=(_set("the picture's own"), *_angles("angle")), without="target"),
        ),
        controls=(
            _number("weight", "Hold to the trend", 0.3, 3, 1.0, ("freely", "closely")),
            _number("direction", "Hold to directions", 0, 3, 1.0, ("freely", "closely")),
        ),
        views=(
            _TEXTURE,
            ResultPicture(file="progression.png", name="Trend found"),
            ResultPicture(file="target.png", name="Trend laid over"),
        ),
    ),
    "restyle": Offer(
        "Another picture, made of the exemplar",
        others={"picture": "Picture that it is laid over"},
        choices=(
            Choice(
                label="Style",
                settings=(
                    _set("as the picture"),
                    _set("more texture", weight=0.3, detail=4.0),
                    _set("fine drawing", weight=1.3, detail=1.0),
                    _set("flat signs and letters", weight=1.3, detail=0.0),
                ),
            ),
        ),
        controls=(
            _number("weight", "Follow the picture", 0.3, 3, 1.0, ("freely", "closely")),
            _number("detail", "Coarseness", 0, 16, 2.0, ("fine", "coarse")),
        ),
    ),
    "vary": Offer(
        "Versions as tiles that fit in any order",
        choices=(
            Choice(
                label="Versions",
                settings=(
                    _set("8"),
                    _set("2", "2x1", variants="2x1"),
                    _set("4", "2x2", variants="2x2"),
                    _set("6", "3x2", variants="3x2"),
                    _set("10", "5x2", variants="5x2"),
                    _set("16", "4x4", variants="4x4"),
                ),
            ),
            _tiles(64, 128, 256, 512, 1024),
        ),
        controls=(_number("strength", "Difference", 0, 1, 1.0, ("other details", "all new")),),
        views=(
            ResultPicture(file="preview.png", name="Laid at random"),
            ResultPicture(file="texture.png", name="Versions"),
        ),
        is_texture=False,
        lengths={"tile": 48},
    ),
    "transition_tiles": Offer(
        "Terrain tiles between two or three materials, for Godot, Unity and Tiled",
        several=SeveralPictures(source="exemplars", least=2, most=3, ends=("the ground", "on top")),
        choices=(
            _tiles(64, 128, 256, 512),
            Choice(
                label="Versions",
                settings=(
                    _set("1 of each"),
                    _set("2 of each", variants="2x1"),
                    _set("4 of each", variants="2x2"),
                ),
            ),
            Choice(label="Sets", settings=(_set("corners and paths"), _set("corners, sooner", sets="corners"))),
        ),
        controls=(
            _number("waves", "Borders", 0, 0.5, 0.3, ("straight", "wandering")),
            _number("match_tone", "Match tones", 0, 1, 0.0, ("as they are", "all alike")),
        ),
        views=(
            ResultPicture(file="preview.png", name="Map"),
            ResultPicture(file="corners.png", name="Corners"),
            ResultPicture(file="blob.png", name="Blob"),
            ResultPicture(file="edges_preview.png", name="Paths"),
            ResultPicture(file="edges.png", name="Path tiles"),
        ),
        is_texture=False,
        lengths={"tile": 48},
    ),
    "endless": Offer(
        "A plane without end for engines: textures and shaders; of noise, or of the cells of bricks and tiles",
        choices=(
            Choice(
                label="Way",
                settings=(_set("as suits"), _set("blended", way="noise"), _set("cells", way="cells")),
            ),
            Choice(
                label="Look",
                settings=(
                    _set("as published"),
                    _set("crisp", sharpness=4.0),
                    _set("large features", tile=0.5, sharpness=4.0),
                    _set("well mixed", tile=0.2),
                ),
            ),
        ),
        controls=(
            _number("tile", "Size of pieces", 0.05, 1, round(SHARE, 3), ("mixed", "whole features")),
            _number("sharpness", "Sharpness", 1, 16, 2.0, ("soft", "crisp")),
            _number("rotation", "Turn hexagons", 0, 180, 0.0, ("not", "any way")),
            _switch("accept", "Also if it has structure", False),
        ),
        views=(
            ResultPicture(file="preview.png", name="Plane"),
            ResultPicture(file="cells_preview.png", name="Plane of cells"),
            ResultPicture(file="cells.png", name="Cells"),
            ResultPicture(file="texture.png", name="Tile"),
            ResultPicture(file="hex.png", name="Hexagons"),
        ),
        is_texture=False,
        ways={"noise": "preview.png", "cells": "cells_preview.png"},
    ),
}  # fmt: skip
"""the flows that the page offers"""


def methods() -> list[Method]:
    """What the page has to know of each of `OFFERS`."""
    return [_method(name, offer) for name, offer in OFFERS.items()]


def _method(name: str, offer: Offer) -> Method:
    flow = load_flow(shipped_flows()[name])
    texture = flow.steps.get("texture")
    has_uniformity = texture is not None and _UNIFORMITY in type(texture.params).model_fields
    return Method(
        flow=name,
        about=offer.about,
        size=(_default(flow, "size") or _SIDES) if "size" in flow.params else None,
        can_tile=offer.is_texture and "tileable" in flow.params,
        presets=_words(flow, "preset"),
        uniformity=f"texture.{_UNIFORMITY}" if has_uniformity else "",
        default_uniformity=getattr(texture.params, _UNIFORMITY) if texture is not None and has_uniformity else 0.0,
        others=tuple(
            OtherPicture(
                source=source,
                about=about,
                is_required=source not in flow.optional,
                painted=offer.painted.get(source),
            )
            for source, about in offer.others.items()
        ),
        several=offer.several,
        choices=offer.choices,
        controls=offer.controls,
        views=offer.views,
        is_texture=offer.is_texture,
        can_correct=offer.is_texture and offer.several is None,
    )


def _default(flow: Flow, name: str) -> Any:
    step, _, param = flow.params[name][0].partition(".")
    return getattr(flow.steps[step].params, param)


def _words(flow: Flow, name: str) -> tuple[str, ...]:
    """The values that a param can have, where they are words."""
    step, _, param = flow.params.get(name, ("",))[0].partition(".")
    return get_args(type(flow.steps[step].params).model_fields[param].annotation) if step else ()
