"""How another of the planes that were proposed is taken."""

from collections.abc import Mapping
from typing import Any


def other_plane(table: Mapping[str, Any] | None) -> str:
    """The option that takes the best plane beside the one that is taken; empty where none is proposed.

    Parameters
    ----------
    table : of `plane_proposal`; none without one.

    Examples
    --------
    >>> other_plane({"taken": 1, "planes": [{}, {}]})
    '--set plane=2'
    >>> other_plane({"taken": 1, "planes": [{}]})
    ''
    """
    if table is None:
        return ""
    others = [number for number in range(1, len(table["planes"]) + 1) if number != table["taken"]]
    return f"--set plane={others[0]}" if others else ""
