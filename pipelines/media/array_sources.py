"""Arrays as sources, which are written as pictures; and as results, made of the images of a run."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.media import contradictions, locate, material_set
from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.media.map_names import recognised, recognised_plane
from texloom.pipelines.media.material_yaml import HEIGHT_UNIT
from texloom.pipelines.media.sources import Source
from texloom.pipelines.media.stack import ROLE
from texloom.pipelines.store.atomic import file_digest, write_atomically
from texloom.stages.vocabulary.arrays import Image, split_mask
from texloom.stages.vocabulary.declare import InputError

PathOrArray = str | os.PathLike[str] | np.ndarray | Image
"""a file or an array"""
Picture = PathOrArray | Mapping[str, PathOrArray]
"""a file, an array, or the maps of a material by name"""

_MAPS = "maps.yaml"


def file_source(given: Picture, folder: Path) -> str:
    """The reference of a source that may be an array; the array is written into ``folder``, made if need be.

    Arrays of equal content get the same file. Integers become PNG, floats and an `Image` EXR, without loss.

    Parameters
    ----------
    given : a path, which is returned as it is; an array, see `Image.of`; or the maps of a material by name, see
        `texloom.pipelines.media.material_set`.

    Raises
    ------
    InputError
        it is neither.
    """
    if isinstance(given, str | os.PathLike):
        return os.fspath(given)
    if isinstance(given, Mapping):
        return str(_file_maps(given, folder))
    if isinstance(given, np.ma.MaskedArray):
        values, usable = split_mask(given)
        return file_source(values if usable.all() else masked(values, usable), folder)
    suffix, content = _encoded(given)
    return str(_write(content, folder / f"{hashlib.sha256(content).hexdigest()}{suffix}"))


def _file_maps(maps: Mapping[str, PathOrArray], folder: Path) -> Path:
    """Write maps and a YAML file of them into a folder named by their digest."""
    if any(isinstance(given, np.ma.MaskedArray) for given in maps.values()):
        raise InputError("a map is a masked array; give its values, and the map 'mask' for all maps")
    files: dict[str, str] = {}
    contents: dict[str, bytes] = {}
    for name, given in maps.items():
        if name == HEIGHT_UNIT:
            files[name] = str(given)
            continue
        if isinstance(name, str) and (plane := recognised_plane(name)) is not None and plane[1]:
            raise InputError(f"{name}: give {plane[0]}, which is 1 minus it")
        if isinstance(given, str | os.PathLike):
            reference = os.fspath(given)
            files[name] = os.path.abspath(reference) if locate.is_path(reference) else reference  # noqa: PTH100 (keeps links)
            continue
        if not isinstance(name, str) or recognised(name) is None or not re.fullmatch(r"[\w. -]+", name):
            raise InputError(f"{name!r:.80} is not the name of a map, as albedo, normal, roughness, height are")
        try:
            suffix, content = _encoded(given)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        files[name] = f"{name}{suffix}"
        contents[files[name]] = content
    listing = json.dumps(files, indent=1).encode()  # JSON is YAML
    digest = hashlib.sha256(listing)
    for file, content in contents.items():
        digest.update(file.encode() + hashlib.sha256(content).digest())
    own = folder / digest.hexdigest()
    for file, content in contents.items():
        _write(content, own / file)
    return _write(listing, own / _MAPS)


def _encoded(given: Any) -> tuple[str, bytes]:
    """The suffix and content of a picture's file."""
    if not isinstance(given, np.ndarray | Image):
        raise InputError(
            f"a value of type {type(given).__name__} is not a picture; give a path or an array (h, w) or (h, w, 3)"
        )
    if isinstance(given, np.ndarray) and given.dtype in (np.uint8, np.uint16) and _is_picture(given.shape):
        from texloom.pipelines.store.png_file import png

        return ".png", png(given)
    image = Image.of(given) if isinstance(given, np.ndarray) else given
    if isinstance(given, np.ndarray) and given.shape[2:] >= (3,) and given.max() > 1 and not (given % 1).any():
        raise InputError(
            f"an array of {given.dtype} with whole numbers up to {given.max():.0f} holds levels, not linear light; "
            "convert it to uint8 or uint16, which are sRGB"
        )
    from texloom.pipelines.store import codec

    with tempfile.TemporaryDirectory() as folder:
        codec.export(image, Image, path := Path(folder) / "array.exr", {})
        return ".exr", path.read_bytes()


def _is_picture(shape: tuple[int, ...]) -> bool:
    """Whether `Image.of` takes such an array; it says what is wrong with another one."""
    return len(shape) >= 2 and shape[2:] in ((), (1,), (3,), (4,)) and 0 not in shape


def _write(content: bytes, path: Path) -> Path:
    """Write a file unless it exists with this content."""
    try:
        if file_digest(path) == hashlib.sha256(content).hexdigest():
            os.utime(path)  # pruning removes old files
            return path
    except OSError:
        pass
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, content)
    return path


def masked(image: Picture, mask: PathOrArray) -> dict[str, PathOrArray]:
    """The exemplar as material maps with a mask, whose false or black pixels are excluded."""
    if any(isinstance(one, np.ma.MaskedArray) for one in (image, mask)):
        raise InputError("mask: is given beside a masked array, or is one; give plain arrays")
    if isinstance(mask, np.ndarray):
        if mask.dtype != bool or mask.ndim != 2:
            raise InputError(
                f"mask: must be boolean, (h, w), true where the exemplar may be used; got {mask.dtype} of shape "
                f"{tuple(mask.shape)}"
            )
        mask = np.where(mask, np.uint8(255), np.uint8(0))
    if isinstance(image, Mapping):
        return {**image, "mask": mask}
    if isinstance(image, str | os.PathLike) and material_set.is_map_set(os.fspath(image)):
        try:
            maps, _ = contradictions.checked(material_set.open_set(os.fspath(image))[0])
        except (Refusal, OSError) as error:
            raise InputError(f"image: {image}: {error}") from None
        said = {"up": "normal_gl", "down": "normal_dx"}
        names = {one.role: said.get(one.facts.green, one.role) for one in maps}
        given: dict[str, PathOrArray] = {names[one.role]: one.reference for one in maps}
        unit = next((one.facts.unit for one in maps if one.role == "height"), "")
        return {**given, **({HEIGHT_UNIT: unit} if unit else {}), "mask": mask}
    return {"albedo": image, "mask": mask}


@dataclasses.dataclass(frozen=True)
class MapKind:
    """How a map of the exemplar was given, and so how that of the texture is returned."""

    name: str
    role: str
    dtype: np.dtype
    planes: int | None
    """of the last axis; none for an array (h, w)"""
    directx: bool = False
    unsigned: bool = False
    """whether normals are 0..1, as in a picture"""

    def array(self, image: Image) -> np.ndarray:
        """The map out of the texture's channels."""
        from texloom.pipelines.media.material_export import channels_of, codes_of

        names = channels_of(self.role, image.channels)
        if self.role == "albedo":
            names = names[: 1 if self.planes in (None, 1) and image.channels[0] == "Y" else self.planes]
        if self.dtype.kind == "u":
            values = codes_of(image, names, self.role, 8 * self.dtype.itemsize, self.directx)
        else:
            values = image.pixels[..., [image.channels.index(name) for name in names]].astype(self.dtype)
            if self.directx:
                values[..., 1] *= -1
            if self.unsigned:
                values = (values + 1) / 2
        if self.planes is None:
            return values[..., 0]
        return np.repeat(values, self.planes, axis=2) if values.shape[2] == 1 else values


def kinds_of(source: Source, given: Picture) -> list[MapKind]:
    """For every map of the exemplar how it was given; ``source`` is what ``given`` was opened as."""
    if not source.maps or source.maps[0].role == ROLE:
        return [_kind_of("albedo", "albedo", given, source)]
    known = {one.role: one for one in source.maps if one.role != "mask" or isinstance(given, Mapping)}
    names: Mapping[str, Any] = given if isinstance(given, Mapping) else dict.fromkeys(known, source)
    if not isinstance(given, Mapping) and len(known) == 1:
        names = {"albedo": given}  # a picture and its mask
    kinds = []
    for name, one in names.items():
        if name == HEIGHT_UNIT:
            continue
        role = (recognised(name) or (name, None))[0]
        role = "height" if role == "bump" and "bump" not in known else role
        kinds.append(dataclasses.replace(_kind_of(name, role, one, known[role]), directx=known[role].directx))
    return kinds


def _kind_of(name: str, role: str, given: Any, opened: Any) -> MapKind:
    """``opened``: the `Source` or `Map` of the picture."""
    if isinstance(given, np.ndarray):
        unsigned = role == "normal" and given.dtype.kind == "f" and bool(given.min() >= 0)
        return MapKind(name, role, given.dtype, None if given.ndim == 2 else given.shape[2], unsigned=unsigned)
    bits = getattr(opened, "bits", None) or locate.inspect(opened.reference).bits
    dtype = np.dtype({8: np.uint8, 16: np.uint16}.get(bits, np.float32))
    colors = [name for name in opened.channels if name in ("R", "G", "B", "Y", "A")]
    planes = len(opened.channels) if role != "albedo" else len(colors)
    return MapKind(name, role, dtype, None if planes == 1 else planes)
