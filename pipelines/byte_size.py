"""Sizes in bytes as text. kB, MB, GB and TB are powers of 1000; KiB, MiB, GiB and TiB are powers of 1024."""

from __future__ import annotations

import re

_PREFIXES = ("k", "m", "g", "t")
_SIZE = re.compile(r"(\d{1,15}(?:\.\d{1,6})?) ?(?:([kmgt])(i?))?b?", re.IGNORECASE)


def parse_byte_size(text: str) -> int:
    """Bytes of ``4GB``, ``512 MiB`` or ``1000000``; the case does not matter, and the B may be left out.

    Raises
    ------
    ValueError : ``text`` is none of those.
    """
    parts = _SIZE.fullmatch(text.strip())
    if parts is None:
        from texloom.pipelines.errors import shown  # not at the top, as help does not need it

        raise ValueError(f"must be a size such as 20GB, 500MB or 4GiB, got {shown(text)}")
    number, prefix, binary = parts.groups()
    power = _PREFIXES.index(prefix.lower()) + 1 if prefix else 0
    return int(float(number) * (1024 if binary else 1000) ** power)


def format_byte_size(count: float) -> str:
    """A number of bytes with its largest decimal unit, as ``1.5 GB``."""
    from rich.filesize import decimal

    return decimal(int(count))
