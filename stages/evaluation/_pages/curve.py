"""Small energy curves, drawn without a plotting library, so that a page may hold hundreds."""

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

_WIDTH, _HEIGHT, _EDGE = 220, 110, 6  # px


def energy_curve(rounds: Sequence[Mapping[str, Any]]) -> str:
    """Energy against the round as SVG, one line a level, on a logarithmic scale.

    Parameters
    ----------
    rounds : ``level`` and ``energy`` of each, see `compact`.

    Returns
    -------
    SVG; empty where no energy is known.
    """
    known = [
        (number, entry.get("level"), float(entry["energy"]))
        for number, entry in enumerate(rounds)
        if isinstance(entry.get("energy"), int | float) and math.isfinite(entry["energy"])
    ]
    if not known:
        return ""
    least = 1e-3 * max(energy for *_, energy in known) or 1.0
    heights = [math.log(max(energy, least)) for *_, energy in known]
    low, high = min(heights), max(heights)
    across = (_WIDTH - 2 * _EDGE) / max(1, len(rounds) - 1)
    down = (_HEIGHT - 2 * _EDGE) / max(high - low, 0.05)
    points = [
        (level, f"{_EDGE + across * number:.1f} {_EDGE + down * (high - height):.1f}")
        for (number, level, _), height in zip(known, heights, strict=True)
    ]
    lines = []
    for _, part in groupby(points, key=lambda point: point[0]):
        places = [place for _, place in part]
        path = "M" + "L".join(places if len(places) > 1 else places * 2)
        lines.append(f'<path d="{path}"/>')
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="energy by round">'
        f'<g fill="none" stroke="currentColor" stroke-width="1.6" stroke-linecap="round">{"".join(lines)}</g></svg>'
    )
