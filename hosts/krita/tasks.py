"""What each action asks of texloom, and what it adds to the picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from . import layers, requests
from .controller import Request
from .texloom_client import RunResult, TexloomError


class Task(NamedTuple):
    """One action."""

    title: str
    requests: Sequence[Request]
    apply: Callable[[list[RunResult]], str]
    """adds the result, and tells what it has made in one line"""
    notes: tuple[str, ...]


def make_tileable(axes: str, keep_size: bool, preset: str, seed: int) -> Task:
    """A layer that repeats, of the active one, or of the rectangle around what is selected."""
    of = layers.document()
    shown = layers.read(of, layers.active(of), layers.selection(of))
    asked = requests.make_tileable(shown.pixels, axes, keep_size, preset, seed)
    return Task("Make Tileable", asked, _layer(shown, "tileable"), shown.notes)


def larger(
    width: int, height: int, tileable: str, method: str, preset: str, seed: int, new_picture: bool = False
) -> Task:
    """A larger texture like the active layer, or like the rectangle around what is selected."""
    of = layers.document()
    shown = layers.read(of, layers.active(of), layers.selection(of))
    asked = requests.larger(shown.pixels, width, height, tileable, method, preset, seed)
    if not new_picture:
        return Task("Larger Texture", asked, _layer(shown, "larger"), shown.notes)

    def apply(results: list[RunResult]) -> str:
        made = results[0].maps["albedo"]
        return _told(layers.open_new(shown.place, made, f"{shown.name} larger"), made)

    return Task("Larger Texture", asked, apply, shown.notes)


def fill(preset: str, seed: int) -> Task:
    """What is selected, from the rest of the active layer."""
    of = layers.document()
    shown = layers.read(of, layers.active(of))
    levels = layers.selected(of, shown.place.area)
    asked = requests.fill(shown.pixels, layers.mask(levels, shown.place.size), preset, seed)
    return Task("Fill Selection", asked, _layer(shown, "filled", levels), shown.notes)


def revise(exemplar: str, tileable: str, preset: str, seed: int) -> Task:
    """What is selected, made anew like another layer, whose id ``exemplar`` is."""
    of = layers.document()
    shown = layers.read(of, layers.active(of))
    levels = layers.selected(of, shown.place.area)
    chosen = next((node for node in layers.layers(of) if node.uniqueId().toString() == exemplar), None)
    if chosen is None:
        raise TexloomError("exemplar: choose the layer that the selection is to look like")
    like = layers.read(of, chosen)
    if like.place.form != shown.place.form:
        raise TexloomError(
            f"exemplar: {like.name} has other colours than {shown.name}; convert it by Layer > Convert"
        )
    asked = requests.revise(
        shown.pixels, like.pixels, layers.mask(levels, shown.place.size), tileable, preset, seed
    )
    return Task("Revise Selection", asked, _layer(shown, "revised", levels), (*shown.notes, *like.notes))


def _layer(shown: layers.Shown, suffix: str, levels: bytes | None = None) -> Callable[[list[RunResult]], str]:
    def apply(results: list[RunResult]) -> str:
        made: Any = results[0].maps["albedo"]
        name = layers.add_above(shown.place, made, f"{shown.name} {suffix}", levels)
        canvas = (shown.place.document.height(), shown.place.document.width())
        beyond = any(side > most for side, most in zip(made.shape, canvas))
        return _told(name, made) + ("; Image > Trim to Current Layer shows all of it" if beyond else "")

    return apply


def _told(name: str, made: Any) -> str:
    return f"{name}, {made.shape[1]}x{made.shape[0]} px"
