"""Which channels of an EXR are its colour, and the names that they get."""

from __future__ import annotations

from collections.abc import Mapping

_WORDS = {"R": ("R", "RED"), "G": ("G", "GREEN"), "B": ("B", "BLUE"), "Y": ("Y",), "A": ("A", "ALPHA")}
_WHOLE = ("combined", "beauty", "rgba", "rgb", "composite")
"""names of the layer that is the whole picture, among several"""


def chosen(parts: list[list[str]], data: bool = False) -> tuple[int, dict[str, str], str]:
    """The index of the part to read, the image's channels by those of the file, in the image's order, and a note.

    Colour is the first plain ``R G B`` (also ``r g b`` and ``red green blue``) or ``Y``; where no part has it, that
    of the only layer (``layer.R`` ...), or of the one that is the whole picture (``ViewLayer.Combined.R`` ...); the
    only channel of a file is grey, whatever its name.

    Parameters
    ----------
    parts : the names of each part's channels.
    data : whether it is a map, of which channels that are no colour keep their names.

    Raises
    ------
    ValueError
        There is no colour, or several layers have it; in words.
    """
    for index, names in enumerate(parts):
        if color := _color("", names):
            return index, _renamed("", color, names), ""
    layers: dict[str, tuple[int, Mapping[str, str]]] = {}
    for index, names in enumerate(parts):
        for layer in dict.fromkeys(name[: name.rfind(".") + 1] for name in names):
            if color := _color(layer, names):
                layers.setdefault(layer, (index, color))
    whole = [layer for layer in layers if layer[:-1].rpartition(".")[2].lower() in _WHOLE]
    counting = whole if len(layers) > 1 and len(whole) == 1 else list(layers)
    if len(counting) > 1:
        raise ValueError(
            f"has colour in several layers: {_listed([layer[:-1] for layer in layers])}; save one as R, G, B"
        )
    if counting:
        index, color = layers[counting[0]]
        left = f"; {_listed([one[:-1] for one in layers if one != counting[0]])} are not colour here"
        note = f"its layer {counting[0][:-1]} is taken as colour{left}" if len(layers) > 1 else ""
        return index, _renamed(counting[0], color, parts[index]), note
    if len(parts) == 1 and len(parts[0]) == 1:
        return 0, {parts[0][0]: parts[0][0] if data else "Y"}, f"its only channel {parts[0][0]} is taken as grey"
    if data and len(parts) == 1:
        return 0, {name: name for name in parts[0]}, ""
    raise ValueError(f"has no colour: no channels R, G, B and no Y, but {_listed(parts[0])}")


def _listed(names: list[str]) -> str:
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")


def _color(layer: str, names: list[str]) -> Mapping[str, str]:
    """The channels of the file that are R, G and B, or Y, of a layer; none: it has no colour."""
    found = _found(layer, names)
    if all(name in found for name in "RGB"):
        return {found[name]: name for name in "RGB"}
    if "Y" not in found or layer + "X" in names:  # X, Y, Z are positions or normals
        return {}
    if layer + "RY" in names or layer + "BY" in names:
        raise ValueError("is stored as luminance and chroma, which is not read; save it as RGB")
    return {found["Y"]: "Y"}


def _found(layer: str, names: list[str]) -> dict[str, str]:
    """R, G, B, Y and A to the names in the file, those as they are before those in other spellings."""
    found: dict[str, str] = {}
    for short, words in _WORDS.items():
        matching = [n for n in names if n.startswith(layer) and n[len(layer) :].upper() in words]
        if matching:
            found[short] = layer + short if layer + short in matching else matching[0]
    return found


def _renamed(layer: str, color: Mapping[str, str], names: list[str]) -> dict[str, str]:
    renamed = dict(color)
    own, plain = _found(layer, names).get("A"), _found("", names).get("A")
    alpha = own or plain
    if alpha:
        renamed[alpha] = "A"
    renamed |= {name: name for name in names if name not in renamed}
    if len(set(renamed.values())) < len(renamed):
        raise ValueError(f"has both A and {layer}A; remove one")
    return renamed
