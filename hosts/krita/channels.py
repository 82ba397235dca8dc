"""Krita's pixels, as pictures of texloom, and back; without NumPy, which Krita's Python need not have.

Krita has blue, green, red and alpha of 8 and 16 bits, but red, green, blue and alpha of floats, and grey and alpha.
"""

from __future__ import annotations

import struct
from array import array
from typing import NamedTuple

from .texloom_client import Pixels, TexloomError

_CHANNELS = {"RGBA": 4, "GRAYA": 2}
_CODES = {"U8": "B", "U16": "H", "F16": "e", "F32": "f"}
_TYPES = {"B": "uint8", "H": "uint16", "f": "float32"}
_FULL = {"B": 255, "H": 65535, "e": 1.0, "f": 1.0}
_AT_ONCE = 2**16  # halves that are converted at once, as each is an object meanwhile


class Format(NamedTuple):
    """How a layer's pixels are stored, as Krita names it."""

    model: str
    depth: str
    profile: str

    @property
    def is_linear(self) -> bool:
        """Whether values are linear light, by the profile's name."""
        name = self.profile.lower()
        return "linear" in name or "-g10" in name

    def check(self) -> None:
        """`TexloomError` where texloom has no such pixels."""
        if self.model not in _CHANNELS or self.depth not in _CODES:
            raise TexloomError(
                f"the layer is {self.model} of {self.depth}; convert it to RGB or greyscale by Layer > Convert"
            )
        if self.depth.startswith("F") and not self.is_linear:
            raise TexloomError(
                f"the layer has floats in the profile {self.profile}; convert it to a linear one by Layer > Convert"
            )

    @property
    def note(self) -> str:
        """What is guessed about colours."""
        if self.is_linear or "srgb" in self.profile.lower():
            return ""
        return f"the profile {self.profile} is taken for sRGB while textures are compared; it stays"


def to_pixels(data: bytes, width: int, height: int, form: Format) -> Pixels:
    """The picture that Krita's pixels show; with alpha where some is not opaque.

    Integers of linear light become floats, which hold them exactly.
    """
    form.check()
    count, code = _CHANNELS[form.model], _CODES[form.depth]
    values = _values(data, code)
    if code in "BH" and form.is_linear:
        full, code = _FULL[code], "f"
        levels = [level / full for level in range(int(full) + 1)]
        values = array("f", map(levels.__getitem__, values))
    code = "f" if code == "e" else code
    alpha = values[count - 1 :: count]
    colors = [values[place::count] for place in _places(form)]
    if min(alpha) < _FULL[code]:
        planes, shape = [*(colors * 3)[:3], alpha], (height, width, 4)
    else:
        planes, shape = colors, (height, width, 3) if len(colors) == 3 else (height, width)
    return Pixels(_interleaved(planes).tobytes(), shape, _TYPES[code])


def to_bytes(made: Pixels, form: Format, selected: bytes | None = None) -> bytes:
    """Krita's pixels of a result; with ``selected``, 0..255 for each pixel, alpha is multiplied by it."""
    count = 1 if len(made.shape) == 2 else made.shape[2]
    code = {name: code for code, name in _TYPES.items()}[made.dtype]
    values = _values(made.data, code)
    full = _FULL[code]
    colors = [values[place::count] for place in range(min(count, 3))]
    pixels = made.shape[0] * made.shape[1]
    alpha = values[3::4] if count == 4 else array(code, [full]) * pixels
    if selected is not None:
        levels = [full * level / 255 for level in range(256)]
        if code != "f":
            levels = [round(level) for level in levels]
        shown = array(code, map(levels.__getitem__, selected))
        if count == 4:
            shown = array(
                code,
                (one * own / full if code == "f" else round(one * own / full) for one, own in zip(shown, alpha)),
            )
        alpha = shown
    planes = colors[:1] if form.model == "GRAYA" else (colors * 3)[:3]
    ordered = [planes[place] for place in _places(form)]
    return _stored(_interleaved([*ordered, alpha]), _CODES[form.depth])


def _places(form: Format) -> tuple[int, ...]:
    """Where red, green and blue are, or grey."""
    if form.model == "GRAYA":
        return (0,)
    return (2, 1, 0) if form.depth.startswith("U") else (0, 1, 2)


def _interleaved(planes: list[array[float]]) -> array[float]:
    joined = array(planes[0].typecode, bytes(planes[0].itemsize * len(planes[0]) * len(planes)))
    for place, plane in enumerate(planes):
        joined[place :: len(planes)] = plane
    return joined


def _values(data: bytes, code: str) -> array[float]:
    """The values of Krita's bytes; halves become floats."""
    if code != "e":
        values = array(code)
        values.frombytes(data)
        return values
    values = array("f")
    for begin in range(0, len(data), 2 * _AT_ONCE):
        part = data[begin : begin + 2 * _AT_ONCE]
        values.extend(struct.unpack(f"<{len(part) // 2}e", part))
    return values


def _stored(values: array[float], code: str) -> bytes:
    """The bytes of values in a depth of Krita; floats become integers where it has these."""
    if code == values.typecode:
        return values.tobytes()
    if code in "BH":
        full = _FULL[code]
        return array(code, (round(min(max(value, 0.0), 1.0) * full) for value in values)).tobytes()
    parts = [values[begin : begin + _AT_ONCE] for begin in range(0, len(values), _AT_ONCE)]
    return b"".join(struct.pack(f"<{len(part)}e", *part) for part in parts)
