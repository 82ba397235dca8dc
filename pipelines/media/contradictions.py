"""Conventions of a material's maps that its content contradicts, as one line each with the option that corrects it.

Content decides where green of normals points if nothing but the names of other maps says it, and heights clearly
do, or that slopes are those of a surface; all else is read as it is said. Normals without a third channel, which
are rebuilt, are told too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import known_files, locate, material_maps
from texloom.pipelines.media.conventions import COLORS, CONVENTION_OF
from texloom.pipelines.media.curves import CURVES, curves_of, told_of_curve
from texloom.pipelines.media.material_maps import Map
from texloom.pipelines.media.plausibility import decisive_green, plausible_green, plausible_integrable_green
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import HALF
from texloom.stages.vocabulary.normals import NORMAL, rebuilt

_VERSION = "6"  # raised when other lines are told of the same files
_EMPTY = 2 / 255  # largest difference in a channel that holds nothing
_OFF = 0.1  # of unit length
_MANY = 0.1  # share of pixels
_FAR = 0.25  # of unit length; lossy files of normals have up to 0.13
_AGREES = 0.6  # correlation
_COMPARED = ({"normal", "height"}, {"roughness", "specular"})
"""roles of maps that contradict each other"""


def checked(maps: Sequence[Map]) -> tuple[tuple[Map, ...], tuple[str, ...]]:
    """The maps of a material, with green of normals as their content has it, and what is told; decodes some."""
    known = known_files.current()
    digest = _VERSION + material_maps.digest_of(maps) + "".join(str(one.implied) for one in maps)
    found = None if known is None else known.told(digest)
    if found is None:
        green, measure = _decided(maps)
        found = (green, measure, *_found(_with_green(maps, green)), *_excluded(maps[0]), *_ignored(maps))
        if known is not None:
            known.tell(digest, found)
    green, measure, *told = found
    lines = [_told_of_green(one, green, measure) for one in maps if one.implied is not None]
    return _with_green(maps, green), (*filter(None, lines), *told)


def told_of_alpha(seen: known_files.Inspected, reference: str) -> str:
    """How many pixels the alpha of a picture excludes, if it does; decodes it the first time."""
    if "A" not in seen.channels:
        return ""
    known, digest = known_files.current(), f"alpha {_VERSION}{seen.digest}"
    found = None if known is None else known.told(digest)
    if found is None:
        share = float((locate.decode(reference, seen.digest).pixels[..., seen.channels.index("A")] < HALF).mean())
        found = (
            (f"alpha is below a half in {100 * share:.2g} % of the pixels, which are never copied",)
            if share
            else ()
        )
        if known is not None:
            known.tell(digest, found)
    return "".join(found)


def _with_green(maps: Sequence[Map], green: str) -> tuple[Map, ...]:
    """The maps, with green of normals where content has decided it."""
    return tuple(
        dataclasses.replace(one, facts=dataclasses.replace(one.facts, green=green))
        if one.implied is not None and green
        else one
        for one in maps
    )


def _told_of_green(normal: Map, green: str, measure: str) -> str:
    """What names imply of green, and what content has decided; empty if names say nothing and it is up."""
    implied, name = normal.facts.green, Path(normal.reference).name
    option = f"'normal_convention: {CONVENTION_OF[implied or 'up']}' in a YAML file of maps"
    if not green and not implied:
        other = f"'normal_convention: {CONVENTION_OF['down']}' in a YAML file of maps"
        return f"{name}: green of normals is assumed to point up, as nothing says it; {other} changes it"
    named = f"points {implied} in names as of {normal.implied}" if implied else ""
    if green and green != (implied or "up"):
        measured = f"points {green} {measure}, and is read so; {option} undoes it"
        named = f"{named}, but clearly {measured}" if named else measured
    return f"{name}: green of normals {named}" if named else ""


def _decided(maps: Sequence[Map]) -> tuple[str, str]:
    """Where green points by content, and by what, if that is clear and nothing but names says it; else empty."""
    by_role = {one.role: one for one in maps}
    if "normal" not in by_role or by_role["normal"].implied is None:
        return "", ""
    measured = tuple(by_role[role] for role in ("normal", "height") if role in by_role)
    image = material_maps.read(measured, maps[0].height, maps[0].width)
    if np.ptp(image.pixels[..., image.channels.index(NORMAL[1])]) <= _EMPTY:
        return by_role["normal"].facts.green or "up", ""  # of flat ones it does not matter
    return decisive_green(image)


def _found(maps: Sequence[Map]) -> tuple[str, ...]:
    by_role = {one.role: one for one in maps}
    together = [pair for pair in _COMPARED if pair <= set(by_role)]
    normal = by_role.get("normal")
    roles = set().union(*together, [] if normal is None else ["normal"])
    codes = dict(_codes(maps))

    def told_of(found: Iterable[tuple[str, str, str]]) -> tuple[str, ...]:
        return tuple(told_of_curve(role, _entry(by_role[role]), curve, measure) for role, curve, measure in found)

    if not roles:
        return told_of(curves_of(codes))
    measured = tuple(one for one in maps if one.role in roles)  # the others need not be decoded
    image = material_maps.read(measured, maps[0].height, maps[0].width)
    is_depth = "height" in by_role and by_role["height"].inverted
    curves = told_of(curves_of(codes, image, is_depth))
    if normal is None:
        return (*contradictions(image, None), *curves)
    pixels = locate.decode(normal.reference, normal.digest, data=True).pixels
    raw, has_x_in_alpha = material_maps.stored_vectors(normal, pixels), material_maps.has_x_in_alpha(pixels)
    if not has_x_in_alpha:
        return (*contradictions(image, raw, is_depth), *curves)
    told = "normal: x is read from alpha, y from green (DXT5nm), and z was rebuilt from them"
    return (told, *contradictions(image, None, is_depth), *curves)


def _entry(one: Map) -> str:
    """What a YAML file says of a map's file, without the braces."""
    channel = f", channel: {one.plane}" if one.plane else ""
    return f"file: {Path(one.reference).name}{channel}{', invert: true' * one.inverted}"


def _codes(maps: Sequence[Map]) -> Iterator[tuple[str, np.ndarray]]:
    """Roles and values of files that hold data, one value a pixel, as they are stored: integers, or floats."""
    for one in maps:
        if one.channels == (one.role,) and one.facts.range is None and not one.curve:
            values = material_maps.read((one,), one.height, one.width).pixels[..., 0].astype(np.float64)
            values = 1 - values if one.inverted else values
            if one.bits == 32:
                yield one.role, values
            else:
                dtype = np.uint8 if one.bits == 8 else np.uint16
                yield one.role, np.rint((2**one.bits - 1) * values).astype(dtype)


def _excluded(albedo: Map) -> Iterator[str]:
    """How many pixels the alpha of the albedo excludes; it may be another map, such as gloss."""
    if "A" not in albedo.channels:
        return
    alpha = locate.decode(albedo.reference, albedo.digest).pixels[..., -1]
    if share := float((alpha < HALF).mean()):
        name = Path(albedo.reference).name
        yield (
            f"{name}: alpha is below a half in {100 * share:.2g} % of the pixels, which are never used; "
            f"if it is a map, a YAML file of maps says which, as 'opacity: {{file: {name}, channel: A}}'"
        )


def _ignored(maps: Sequence[Map]) -> Iterator[str]:
    """The channels of files that hold something and are not read, each file's in one line."""
    files: dict[str, list[Map]] = {}
    for one in maps:
        files.setdefault(one.reference, []).append(one)
    for reference, held in files.items():
        used = {plane for one in held for plane in (one.plane or "RGBY")}
        used |= {twin.plane for one in maps for twin in one.twins if twin.reference == reference}
        used |= {"A"} if any(one.role == "albedo" for one in held) else set()
        left = [name for name in held[0].file_channels if name not in used]
        if len(held[0].file_channels) == 1 and not held[0].plane:  # one of any name is the map
            continue
        if not left:
            continue
        pixels = locate.decode(reference, held[0].digest, data=held[0].role not in COLORS).pixels
        if held[0].role == "normal" and material_maps.has_x_in_alpha(pixels):
            continue
        planes = dict(zip(held[0].file_channels, np.moveaxis(pixels, 2, 0), strict=False))
        others = [planes[name] for name in used if name in planes]
        full = [
            name
            for name in left
            if np.ptp(planes[name]) > _EMPTY
            and not any(np.abs(planes[name] - other).max() <= _EMPTY for other in others)
        ]
        if full:
            yield (
                f"{Path(reference).name}: {', '.join(full)} not read; in a YAML file of maps, as 'roughness: "
                f"{{file: {Path(reference).name}, channel: {full[0]}}}', it is"
            )


def contradictions(image: Image, raw: Float32[np.ndarray, "h w 3"] | None, is_depth: bool = False) -> Iterator[str]:
    """What is told of a material.

    Parameters
    ----------
    image : as it is read.
    raw : vectors of the file of normals, -1..1, before they are normalised; None without such a file.
    is_depth : whether the heights were read as 1 minus what the file has.
    """
    if raw is not None:
        yield from _of_vectors(raw)
    yield from _of_green(image, is_depth)
    yield from _of_roughness(image)


def _of_vectors(raw: Float32[np.ndarray, "h w 3"]) -> Iterator[str]:
    vectors, is_rebuilt = rebuilt(raw)
    if is_rebuilt:
        yield "normal: the third channel is empty; z was rebuilt from x and y, sqrt(1 - x2 - y2)"
        return
    error = _length_error(vectors)
    if error > _OFF:
        codes = (vectors.astype(np.float64) + 1) / 2
        for name, (_, undone) in CURVES.items():
            values = np.asarray(undone(codes))
            if _length_error(values * 2 - 1) < min(error / 2, _OFF) and np.median(values[..., 2]) > 0.5:
                yield told_of_curve(
                    "normal",
                    "file: NAME",
                    name,
                    f"lengths of vectors are wrong by {error:.2f}, and right without it",
                )
                return
    if error > _FAR:
        yield f"normal: the vectors' lengths, 1 in a normal map, are wrong by {error:.2f}; is this file one?"
    if (below := float((vectors[..., 2] <= 0).mean())) > _MANY:
        yield f"normal: z is not positive in {100 * below:.0f} % of the pixels; save it in tangent space, blue up"


def _length_error(vectors: np.ndarray) -> float:
    return float(np.median(np.abs(np.linalg.norm(vectors, axis=2) - 1)))


def _of_green(image: Image, is_depth: bool) -> Iterator[str]:
    read = image.facts.of_map("normal").green or "up"
    found, alone = plausible_green(image), plausible_integrable_green(image)
    if found is not None and found["green"] in CONVENTION_OF:
        across, down = found["correlation"]
        if found["green"] != read:
            measure = f"correlation with the slopes of height {across:.2f} across, {down:.2f} down"
            yield _wrong_green(found["green"], measure)
        if found["height"] == "depth":
            yield (
                f"height: seems to be inverted, high where the surface is low (correlation {across:.2f} with the "
                f"normals); in a YAML file of maps 'height: {{file: NAME, invert: {str(not is_depth).lower()}}}' "
                "corrects it"
            )
    elif alone is not None and alone["green"] != read:
        yield _wrong_green(alone["green"], f"the curl of its slopes is {alone['curl']:g} times as large otherwise")


def _wrong_green(green: str, measure: str) -> str:
    end = "gl" if green == "up" else "dx"
    return (
        f"normal: green seems to point {green} ({measure}), but is read the other way; a name that ends in {end}, "
        f"or 'normal_convention: {CONVENTION_OF[green]}' in a YAML file of maps, corrects it"
    )


def _of_roughness(image: Image) -> Iterator[str]:
    """Smooth parts reflect more in a specular map; gloss rises with it."""
    if not {"roughness", "specular"} <= set(image.channels):
        return
    rough, specular = (image.pixels[..., image.channels.index(name)] for name in ("roughness", "specular"))
    if min(rough.std(), specular.std()) < 1e-3:
        return
    agreement = float(np.corrcoef(rough.ravel(), specular.ravel())[0, 1])
    if agreement > _AGREES:
        yield (
            f"roughness: seems to be gloss, white where the surface is smooth (correlation {agreement:.2f} with "
            "specular); in a YAML file of maps 'roughness: {file: NAME, invert: true}' corrects it"
        )
