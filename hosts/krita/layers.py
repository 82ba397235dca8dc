"""Layers of Krita's documents: what is read of them, and what is added above them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from PyQt5.QtCore import QRect

from krita import Document, Krita, Node

from .channels import Format, to_bytes, to_pixels
from .texloom_client import Pixels, TexloomError

_PAINTED = ("paintlayer", "grouplayer", "clonelayer", "filelayer", "filllayer", "vectorlayer")


class Place(NamedTuple):
    """A layer and a part of it; it holds the layer's id, as undo may take the layer itself away."""

    document: Document
    layer: str
    area: QRect
    form: Format

    @property
    def size(self) -> tuple[int, int]:
        return self.area.width(), self.area.height()


class Shown(NamedTuple):
    """What a part of a layer shows."""

    place: Place
    pixels: Pixels
    name: str
    notes: tuple[str, ...]


def document() -> Document:
    """The picture that is open."""
    found = Krita.instance().activeDocument()
    if found is None:
        raise TexloomError("no picture is open")
    return found


def layers(of: Document) -> list[Node]:
    """All layers of a picture that show something, from the top on."""
    return [node for node in _below(of.rootNode()) if node.type() in _PAINTED]


def _below(node: Node) -> Iterator[Node]:
    for child in reversed(node.childNodes()):
        yield child
        yield from _below(child)


def active(of: Document) -> Node:
    """The layer that is chosen."""
    node = of.activeNode()
    if node is None or node.type() not in _PAINTED:
        raise TexloomError("choose a layer; masks and filters have no texture")
    return node


def selection(of: Document) -> QRect | None:
    """The rectangle around what is selected."""
    chosen = of.selection()
    return None if chosen is None else QRect(chosen.x(), chosen.y(), chosen.width(), chosen.height())


def read_area(of: Document, node: Node, part: QRect | None = None) -> QRect:
    """Where a layer shows something within the canvas, or within a part of it."""
    of.waitForDone()
    area = node.bounds().intersected(QRect(0, 0, of.width(), of.height()))
    if part is not None:
        area = area.intersected(part)
    if area.isEmpty():
        raise TexloomError(f"the layer {node.name()} shows nothing {'on the canvas' if part is None else 'there'}")
    return area


def read(of: Document, node: Node, part: QRect | None = None) -> Shown:
    """What a layer shows within the canvas, or within a part of it."""
    area = read_area(of, node, part)
    form = Format(node.colorModel(), node.colorDepth(), node.colorProfile())
    form.check()
    data = bytes(node.projectionPixelData(area.x(), area.y(), area.width(), area.height()))
    notes = [form.note] if form.note else []
    if node.animated():
        notes.append(f"{node.name()} is animated; its frame {of.currentTime()} is used")
    place = Place(of, node.uniqueId().toString(), area, form)
    return Shown(place, to_pixels(data, *place.size, form), node.name(), tuple(notes))


def selected(of: Document, area: QRect) -> bytes:
    """How much each pixel of a rectangle is selected, 0..255."""
    chosen = of.selection()
    levels = b"" if chosen is None else bytes(chosen.pixelData(area.x(), area.y(), area.width(), area.height()))
    if not any(levels):
        raise TexloomError("nothing of the layer is selected; select what is to be made anew")
    if all(levels):
        raise TexloomError("all of the layer is selected; leave some of it to be made from")
    return levels


def mask(levels: bytes, size: tuple[int, int]) -> Pixels:
    """The mask of what is selected at all, white."""
    return Pixels(levels.translate(bytes([0] + [255] * 255)), (size[1], size[0]), "uint8")


def add_above(place: Place, made: Pixels, name: str, shown: bytes | None = None) -> str:
    """A new layer above another, or above all where that has gone; its name. One step of undo.

    ``shown`` is its alpha, 0..255, for each pixel.
    """
    of = place.document
    if not any(of == one for one in Krita.instance().documents()):
        raise TexloomError("the picture was closed meanwhile")
    below = next((node for node in layers(of) if node.uniqueId().toString() == place.layer), None)
    names = {node.name() for node in layers(of)}
    taken = next(one for one in _numbered(name) if one not in names)
    node = of.createNode(taken, "paintlayer")
    node.setColorSpace(*place.form)
    height, width = made.shape[:2]
    node.setPixelData(to_bytes(made, place.form, shown), place.area.x(), place.area.y(), width, height)
    parent = of.rootNode() if below is None else below.parentNode()
    parent.addChildNode(node, below)
    of.refreshProjection()
    return taken


def _numbered(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        yield f"{name} {number}"
        number += 1


def open_new(place: Place, made: Pixels, name: str) -> str:
    """A new picture of the result; its name."""
    height, width = made.shape[:2]
    resolution = float(place.document.resolution())
    new = Krita.instance().createDocument(width, height, name, *place.form, resolution)
    new.topLevelNodes()[0].setPixelData(to_bytes(made, place.form), 0, 0, width, height)
    new.refreshProjection()
    Krita.instance().activeWindow().addView(new)
    return name
