"""What holds for a picture beside its pixels.

What becomes of the facts of a picture in an operation:

| operation | `wraps` |
|---|---|
| other values at the same places: tone, fill, edit, join, colour space (`Image.with_pixels`) | kept |
| maps of one material joined (`Facts.joined`) | what all of them have |
| a part (`Image.cropped`) | kept along a side that is whole, else dropped |
| a synthesis (`Image.wrapping`) | set by what was asked for, ``tileable`` |
| anything else: an `Image` made of pixels and channels | dropped |
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

_NAMES = {(False, False): "off", (False, True): "x", (True, False): "y", (True, True): "both"}


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
class Facts:
    """What holds for a picture; by default nothing is known."""

    wraps: Wraps = NOWHERE

    @classmethod
    def joined(cls, parts: Iterable[Facts]) -> Facts:
        """What holds for a picture whose channels are those of ``parts``, at least one."""
        return cls(functools.reduce(Wraps.__and__, (one.wraps for one in parts)))

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Facts:
        """From what `record` has made; what it does not know is left out."""
        try:
            return cls(Wraps.of(record["wraps"]))
        except (KeyError, TypeError):
            return cls()

    def record(self) -> dict[str, str]:
        """What is known, for files and digests; ready for JSON."""
        return {"wraps": str(self.wraps)} if self.wraps else {}


UNKNOWN = Facts()
"""what holds for a picture of which nothing is known"""
