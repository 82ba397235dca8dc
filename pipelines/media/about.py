"""What is known of a picture file or the maps of a material: whether they wrap, bits, ranges, roles, green."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.errors import one_line
from texloom.pipelines.media import contradictions, locate, material_maps, material_set
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.map_names import recognised
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.media.plausibility import plausible_green, plausible_integrable_green, plausible_wraps
from texloom.pipelines.memory import check_memory
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Facts


def about_picture(path: Path) -> dict[str, Any]:
    """The facts of a picture, ready for JSON; `InputError` where it cannot be read as one.

    Returns
    -------
    as of `_known`, with ``bits``, of which 32 are floats, and the ``role`` of a map, by the file's name.
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
    return {**_known(image, seen.texel_size), "bits": seen.bits, **({} if role is None else {"role": role[0]})}


def about_material(reference: Path) -> dict[str, Any]:
    """The facts of a material, a folder or YAML file of maps, ready for JSON; `InputError` where it cannot be read.

    Returns
    -------
    as of `_known`, with ``files`` by role: file, ``bits``, ``channel``, ``inverted``, ``curve`` and ``green`` where
    they apply, ``wraps`` or ``plausible_wraps``, and ``plausible``: where green points, whether heights are depths,
    and ``see notes`` where content contradicts what is said; and ``notes`` on the other files, and on that.
    """
    try:
        opened, notes = material_set.open_set(str(reference))
        if problem := check_memory(material_maps.memory_of(opened)):
            raise Refusal(problem)
        opened, more = contradictions.checked(opened)
        image = material_maps.read(opened, opened[0].height, opened[0].width)
        texel_size = locate.inspect(opened[0].reference).texel_size
        notes = (*notes, *more)
    except Refusal as error:
        raise InputError(one_line(f"{reference}: {error}")) from None
    except OSError as error:
        raise InputError(f"{reference}: {error.strerror or error}") from None
    known = _known(image, texel_size)
    measured = known.get("plausible_green", {})
    plausible = {"normal": measured.get("green"), "height": measured.get("height")}
    files = {}
    for one in opened:
        files[one.role] = _about_map(one) | _wraps_of(one, image)
        is_told = any(note.startswith(f"{one.role}: ") for note in notes)
        if words := [*filter(None, [plausible.get(one.role)]), *(["see notes"] if is_told else [])]:
            files[one.role]["plausible"] = ", ".join(words)
    return {**known, "files": files, **({"notes": list(notes)} if notes else {})}


def _about_map(one: Map) -> dict[str, Any]:
    said = {"channel": one.plane, "inverted": one.inverted, "curve": one.curve, "green": one.facts.green}
    file = {"file": Path(one.reference).name, "bits": one.bits}
    return {**file, **{name: value for name, value in said.items() if value}}


def _wraps_of(one: Map, image: Image) -> dict[str, Any]:
    """Whether a map's file says that it wraps, or for ``x`` and ``y`` whether that is plausible."""
    said = Facts.of(locate.inspect(one.reference, one.role not in COLORS).facts).wraps
    if said:
        return {"wraps": str(said)}
    planes = image.pixels[..., [image.channels.index(name) for name in one.channels if name != "A"]]
    lowest, span = planes.min(), max(float(np.ptp(planes)), 1e-9)
    shown = Image((planes - lowest) / np.float32(span), ("R", "G", "B") if planes.shape[2] == 3 else ("Y",))
    return {"plausible_wraps": {axis: one["wraps"] for axis, one in plausible_wraps(shown).items()}}


def _known(image: Image, texel_size: float | None) -> dict[str, Any]:
    """What texloom has written into the file, names or YAML say of maps, and what is measured.

    ``wraps``: ``x``, ``y`` or ``both``, and where that is not said ``plausible_wraps``; ``maps``: green, unit and
    range of each, see `MapFacts`; of a material with normals ``plausible_green``, by heights if there are any;
    ``range`` of each channel; ``texel_size``, as ``0.5 mm``, where texloom has written it.
    """
    known: dict[str, Any] = {} if texel_size is None else {"texel_size": f"{1000 * texel_size:g} mm"}
    known |= image.facts.record()
    if not image.wraps:
        known["plausible_wraps"] = plausible_wraps(image)
    if (green := plausible_green(image) or plausible_integrable_green(image)) is not None:
        known["plausible_green"] = green
    planes = zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True)
    known["range"] = {name: [_short(plane.min()), _short(plane.max())] for name, plane in planes}
    return known


def _short(value: np.float32) -> float:
    return float(f"{value:.4g}")
