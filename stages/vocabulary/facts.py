"""What holds for a picture beside its pixels.

What becomes of the facts of a picture in an operation:

| operation | `wraps` | `maps` |
|---|---|---|
| other values at the same places: tone, fill, edit, colour space (`Image.with_pixels`) | kept | kept |
| maps of one material joined (`Facts.joined`) | what all of them have | those of all |
| a part (`Image.cropped`) | kept along a side that is whole, else dropped | kept |
| its values at other places: scaled, flipped, transposed, turned, copied (`Image.elsewhere`) | dropped | kept |
| a synthesis (`Image.elsewhere`, then `Image.wrapping`) | set by what was asked for, ``tileable`` | kept |
| anything else: an `Image` made of pixels and channels | dropped | dropped |

All of them enter digests of content. Which channels are excluded is no fact of its own but a channel, see
`texloom.stages.vocabulary.masks`. Bits, texel size and provenance belong to files: of sources
`texloom.pipelines.media.sources` knows them, and exports depend on them, but no stage does.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

_NAMES = {(False, False): "off", (False, True): "x", (True, False): "y", (True, True): "both"}
GREENS = ("up", "down")
"""where green points in normals: up in OpenGL, down in DirectX"""
UNITS = ("um", "mm", "cm", "m", "in")
"""of lengths"""
DISPLACEMENT = 0.05
"""how far a height of 1 lies above one of 0 where no unit is known, as a share of the picture's width: no map tells
it, so exported documents assume it"""


class Wraps(NamedTuple):
    """Whether a picture continues across its borders, by axis; compiled code takes it too."""

    down: bool = False
    """its first row follows its last one; ``y`` in texts"""
    across: bool = False
    """its first column follows its last one; ``x`` in texts"""

    @classmethod
    def of(cls, name: str) -> Wraps:
        """From ``off``, ``x``, ``y`` or ``both``; `KeyError` if it is none of them."""
        return cls(*{text: axes for axes, text in _NAMES.items()}[name])

    @property
    def both(self) -> bool:
        """Whether it is a torus."""
        return self.down and self.across

    def where_open(self, count: int) -> tuple[int, int]:
        """``count`` down and across, 0 along axes that wrap."""
        return (0 if self.down else count, 0 if self.across else count)

    def where_closed(self, count: int) -> tuple[int, int]:
        """``count`` down and across, 0 along axes that do not wrap."""
        return (count if self.down else 0, count if self.across else 0)

    def modes(self, open_mode: str) -> list[str]:
        """How filters and padding go on beyond the borders along each axis: ``wrap`` or ``open_mode``."""
        return ["wrap" if around else open_mode for around in self]

    def __bool__(self) -> bool:
        return self.down or self.across

    def __and__(self, other: Wraps) -> Wraps:
        return Wraps(self.down and other.down, self.across and other.across)

    def __or__(self, other: Wraps) -> Wraps:
        return Wraps(self.down or other.down, self.across or other.across)

    def __str__(self) -> str:
        return _NAMES[self.down, self.across]


TORUS = Wraps(True, True)
NOWHERE = Wraps()


@dataclasses.dataclass(frozen=True)
class MapFacts:
    """What holds for the file that a map of a material comes from; empty where nobody said so.

    In texloom, green points up in all normals, and values are as in the file, integers divided by the highest one.
    """

    green: str = ""
    """of normals, one of `GREENS`"""
    unit: str = ""
    """of heights, one of `UNITS`"""
    range: tuple[float, float] | None = None
    """lowest and highest value of floats; of integers, which are 0..1 else, the heights that 0 and 1 stand for"""

    @classmethod
    def of(cls, record: Any) -> MapFacts:
        """From what `record` has made; what is none of that is left out."""
        known = record if isinstance(record, Mapping) else {}
        green, unit = known.get("green"), known.get("unit")
        return cls(
            str(green) if green in GREENS else "",
            str(unit) if unit in UNITS else "",
            _range_of(known.get("range")),
        )

    def record(self) -> dict[str, Any]:
        """What is known, ready for JSON."""
        texts = {name: text for name, text in (("green", self.green), ("unit", self.unit)) if text}
        return texts if self.range is None else {**texts, "range": list(self.range)}


def _range_of(values: Any) -> tuple[float, float] | None:
    if not isinstance(values, list | tuple) or len(values) != 2:
        return None
    if not all(type(value) in (int, float) and math.isfinite(value) for value in values) or values[0] > values[1]:
        return None
    return float(values[0]), float(values[1])


@dataclasses.dataclass(frozen=True)
class Facts:
    """What holds for a picture; by default nothing is known."""

    wraps: Wraps = NOWHERE
    maps: Mapping[str, MapFacts] = dataclasses.field(default_factory=dict)
    """of each map of a material, by its role, which begins the names of its channels"""

    @classmethod
    def joined(cls, parts: Iterable[Facts]) -> Facts:
        """What holds for a picture whose channels are those of ``parts``, at least one."""
        listed = list(parts)
        maps = {role: known for one in listed for role, known in one.maps.items()}
        return cls(functools.reduce(Wraps.__and__, (one.wraps for one in listed)), maps)

    @classmethod
    def of(cls, record: Any) -> Facts:
        """From what `record` has made; what is none of that is left out."""
        known = record if isinstance(record, Mapping) else {}
        wraps, maps = known.get("wraps"), known.get("maps")
        return cls(
            Wraps.of(wraps) if isinstance(wraps, str) and wraps in _NAMES.values() else Wraps(),
            {role: MapFacts.of(one) for role, one in maps.items()} if isinstance(maps, Mapping) else {},
        )

    def record(self) -> dict[str, Any]:
        """What is known, for files and digests; ready for JSON."""
        maps = {role: known for role in sorted(self.maps) if (known := self.maps[role].record())}
        return {**({"wraps": str(self.wraps)} if self.wraps else {}), **({"maps": maps} if maps else {})}

    def of_map(self, role: str) -> MapFacts:
        """What is known of a map."""
        return self.maps.get(role, MapFacts())

    def within(self, channels: Collection[str]) -> Facts:
        """Without those of maps that these channels do not hold."""
        roles = {name.partition(".")[0] for name in channels}
        if roles.issuperset(self.maps):
            return self
        return dataclasses.replace(self, maps={role: one for role, one in self.maps.items() if role in roles})


UNKNOWN = Facts()
"""what holds for a picture of which nothing is known"""
