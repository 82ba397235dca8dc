"""How much memory the pictures that a run reads may take: a limit that is checked before anything is decoded."""

from __future__ import annotations

import os
import re
from pathlib import Path

from texloom.pipelines.errors import shown
from texloom.stages.declare import InputError

VARIABLE = "TEXLOOM_MEMORY"
_UNITS = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_SHARE = 0.5  # of the machine's memory
_UNKNOWN = 4 * 10**9  # bytes, where the machine does not tell
_CONTROL_GROUP = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def memory_limit() -> int:
    """Bytes that decoded pictures may take: ``TEXLOOM_MEMORY``, or half of what this process can have."""
    given = os.environ.get(VARIABLE)
    return parse_memory(given, VARIABLE) if given else int(_SHARE * _machine_memory())


def parse_memory(text: str, where: str) -> int:
    """Bytes of ``4GB``, ``512 MB`` or ``1000000``; `InputError` where it is none of those."""
    parts = re.fullmatch(r"(\d{1,12}(?:\.\d{1,6})?) *([kMGT]?)i?B?", text.strip(), re.IGNORECASE)
    if parts is None or float(parts[1]) == 0:
        raise InputError(f"{where}: must be a size such as 4GB or 512MB, got {shown(text)}")
    unit = parts[2].lower() if parts[2] in "kK" else parts[2].upper()
    return int(float(parts[1]) * _UNITS[unit])


def check_memory(needed: int) -> str:
    """Why ``needed`` bytes are too many; empty if they are not."""
    limit = memory_limit()
    if needed <= limit:
        return ""
    return (
        f"takes up to {_gigabytes(needed)} of memory to decode, the limit is {_gigabytes(limit)}; "
        f"make it smaller, or raise the limit by --memory or {VARIABLE}"
    )


def _gigabytes(count: int) -> str:
    return f"{count / 1e9:.2g} GB" if count < 1e10 else f"{count / 1e9:.0f} GB"


def _machine_memory() -> int:
    """Bytes of the machine, or of the control group that this process is confined to."""
    try:
        sizes = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    except (AttributeError, OSError, ValueError):  # not on Windows
        return _UNKNOWN
    for path in _CONTROL_GROUP:
        try:
            sizes.append(int(path.read_text()))
        except (OSError, ValueError):  # not there, or "max"
            continue
    return min(sizes)
