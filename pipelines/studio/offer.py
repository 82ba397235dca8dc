"""How the page offers a flow, and the parts of which an offer consists."""

from __future__ import annotations

import dataclasses
from typing import Any

from texloom.pipelines.flow.model import Reference
from texloom.pipelines.studio.messages.catalogue import (
    Card,
    Control,
    LayerName,
    Picker,
    ResultPicture,
    Setting,
    SeveralPictures,
)


@dataclasses.dataclass(frozen=True)
class Offer:
    """What is written here of a method; `methods` adds what its flow says."""

    about: str
    several: SeveralPictures | None = None
    others: dict[str, str] = dataclasses.field(default_factory=dict)
    """the pictures that it takes besides, and what the page calls them"""
    painted: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    """those of them that can be painted, and what black and white mean"""
    choices: tuple[Picker, ...] = ()
    controls: tuple[Control, ...] = ()
    views: tuple[ResultPicture, ...] = ()
    """what is shown of a result, the preview first; none: the texture"""
    is_texture: bool = True
    """whether it makes one texture that looks as its exemplar"""
    ways: dict[str, str] = dataclasses.field(default_factory=dict)
    """what its step `WAY` may choose, to the export that is shown then; none: it has no such step"""
    surface: str = ""
    """of photographs, the step that shows the surface from the front, from which previews are made"""
    draft: Reference | None = None
    """what stands for the result in the first picture of a preview, as it comes sooner; none: the result"""
    layer: LayerName = ""
    """as of a `Method`"""
    lengths: dict[str, int] = dataclasses.field(default_factory=dict)
    """params that are px, which are smaller in previews, to the least that they may be"""


_WAYS = {
    "left to right": 0.0,
    "top to bottom": 90.0,
    "right to left": 180.0,
    "bottom to top": 270.0,
    "corner to corner": 45.0,
}


def angles(param: str) -> tuple[Setting, ...]:
    """Directions, the first of them included."""
    return tuple(setting(name, **{param: angle}) for name, angle in _WAYS.items())


def setting(name: str, udim: str = "", /, **params: Any) -> Setting:
    """Values of params under a name."""
    return Setting(name=name, params=params, lists={}, udim=udim)


def tiles(*sides: int) -> Picker:
    """Sides of tiles, px."""
    return Picker(
        label="Tile", settings=(setting("as fits"), *(setting(f"{side} px", tile=side) for side in sides))
    )


def curve(name: str, *curve: float) -> Setting:
    """A trend, as shares of the exemplar's own."""
    return Setting(name=name, params={}, lists={"curve": curve} if curve else {})


def number(
    param: str,
    label: str,
    least: float,
    most: float,
    default: float,
    ends: tuple[str, str],
    card: Card = "make",
) -> Control:
    """A slider."""
    return Control(param=param, label=label, least=least, most=most, default=default, ends=ends, card=card)


def switch(param: str, label: str, default: bool) -> Control:
    """A param that is on or off."""
    return Control(param=param, label=label, least=0, most=1, default=float(default), ends=("", ""), is_switch=True)
