"""What is known of a picture file: whether it wraps, its bits, range and role."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media import locate
from texloom.pipelines.media.decode import Refusal
from texloom.pipelines.media.material_set import COLORS, recognised
from texloom.stages.common.grids.border_steps import border_steps
from texloom.stages.vocabulary.declare import InputError


def about_picture(path: Path) -> dict[str, Any]:
    """The facts of a picture, ready for JSON; `InputError` where it cannot be read as one.

    Returns
    -------
    ``wraps``: ``off``, ``x``, ``y`` or ``both``, where texloom has written it; elsewhere ``border_steps`` down and
    across, see `stages.common.grids.border_steps`, if they are finite. ``bits``, of which 32 are floats; ``range``
    of each channel; ``role`` of a map, by the file's name.
    """
    role = recognised(path.stem)
    is_data = role is not None and role[0] not in COLORS
    try:
        seen = locate.inspect(str(path), is_data)
        image = locate.decode(str(path), seen.digest, is_data)
    except Refusal as error:
        raise InputError(f"{path}: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    known: dict[str, Any] = dict(image.facts.record())
    if not known:
        steps = border_steps(image)
        axes = zip(("down", "across"), steps, strict=True)
        known["border_steps"] = {axis: round(step, 2) for axis, step in axes if np.isfinite(step)}
    known["bits"] = seen.bits
    planes = zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True)
    known["range"] = {name: [_short(plane.min()), _short(plane.max())] for name, plane in planes}
    return known | ({} if role is None else {"role": role[0]})


def _short(value: np.float32) -> float:
    return float(f"{value:.4g}")
