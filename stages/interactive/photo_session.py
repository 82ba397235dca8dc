"""Interactive description of the surfaces in a photograph: patches and regions are changed, and pictures follow."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.field import Coverage, PhotoDistortion, coverage, distortion
from texloom.stages.analysis.photographs.geometry import Area, Geometry, Patch, parsed_geometry, pixels_inside
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.interactive.flow_file import flow_text, yaml_value
from texloom.stages.interactive.photo_areas import AREAS, FEATURES, PhotoAreas
from texloom.stages.interactive.photo_texture import flat_texture
from texloom.stages.interactive.streamlines import streamlets
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import srgb_from_linear
from texloom.stages.vocabulary.declare import Document, InputError

_PREVIEW_SIDE = 1024  # px of the longer side of the photograph that previews are sampled from


class PhotoSession(PhotoAreas):
    """Patches and areas of a photograph, with previews that take fractions of a second.

    A session holds what a geometry file does, see docs/photographs.md: patches by name, and the areas ``region``,
    ``without`` and ``hole`` and, for each class of features, ``features.NAME``. Points are (row, column) in px of
    the photograph. Changes are not checked: an invalid patch stays until it is moved on, `validity` says what is
    wrong, and everything that needs it raises `InputError`. A session must be used by one thread at a time.

    Parameters
    ----------
    photo : the photograph; an image, or an array as `Image.of` takes it.
    geometry : the content of a geometry file to begin with, whose areas are polygons; or the file, read as a
        `Document`, whose areas may be pictures.
    detail : see `jacobian_field`.
    coarse_side : longer side of the reduced photograph, px.

    Raises
    ------
    InputError
        ``geometry`` is invalid.

    Examples
    --------
    >>> import skimage.data
    >>> session = PhotoSession(skimage.data.brick())
    >>> session.place("wall", [[500, 7], [10, 70], [10, 365], [500, 427]])
    >>> session.move_corner("wall", 0, (505, 6))
    >>> session.validity()
    {'wall': None}
    >>> session.preview("wall", 64).shape
    (36, 64, 4)
    """

    def __init__(
        self,
        photo: Image | np.ndarray,
        geometry: Mapping[str, Any] | Document | None = None,
        *,
        detail: float = 0.3,
        coarse_side: int = 192,
    ):
        super().__init__(Image.of(photo) if isinstance(photo, np.ndarray) else photo)
        self.detail = detail
        self.coarse_photo = Image(reduced(self.photo.color, coarse_side), ("R", "G", "B"))
        shown = srgb_from_linear(reduced(self.photo.color, _PREVIEW_SIDE))
        self._shown = np.rint(np.dstack([shown, np.ones(shown.shape[:2])]) * 255).astype(np.uint8)
        self._parts: dict[tuple[bool, str], tuple[bytes, Coverage]] = {}
        if geometry is not None:
            self._load(geometry if isinstance(geometry, Document) else _document(geometry))

    def _load(self, document: Document) -> None:
        read = parsed_geometry(document.content, self.shape, document.pictures)
        for number, entry in enumerate(document.content["patches"]):
            self._entries[entry.get("name") or f"patch_{number + 1}"] = dict(entry)
        areas = {name: getattr(read, name) for name in AREAS} | {
            f"{FEATURES}{name}": area for name, area in read.features.items()
        }
        self._areas = {
            name: pixels_inside(area, self.shape) if isinstance(area, Path) else area
            for name, area in areas.items()
            if area is not None and len(area if isinstance(area, list) else [area])
        }

    # -- results

    def coarse(self) -> PhotoDistortion:
        """The distortion in the reduced photograph, ``coarse_photo``."""
        return self._distortion(coarse=True)

    def distortion(self) -> PhotoDistortion:
        """The distortion in the photograph, bit-identical to that of `jacobian_field`."""
        return self._distortion(coarse=False)

    def streamlines(self, across: int = 20) -> Float64[np.ndarray, "2 lines points 2"]:
        """Short lines along both directions of the texture, down and across, inside the region, px.

        Parameters
        ----------
        across : lines along the photograph's longer side.
        """
        field = self.coarse()
        factor = self.shape[0] / field.region.shape[0]
        return (streamlets(field.jacobian, field.region, across) + 0.5) * factor - 0.5

    def preview(self, name: str, side: int = 256) -> UInt8[np.ndarray, "h w 4"]:
        """A patch as seen from the front, sRGB and alpha, which is 0 outside the photograph.

        It shows the patch alone, at even steps along its middle lines; `unroll` makes the exact picture.

        Parameters
        ----------
        side : longer side, px.
        """
        import cv2

        patch = self._patch(name)
        sizes = np.array(patch.size)
        height, width = (max(1, round(side * share)) for share in sizes / sizes.max())
        places = bezier.even_points(patch.controls, patch.space, (height, width))
        scale = np.array(self._shown.shape[:2]) / self.shape
        at = np.asarray((places + 0.5) * scale - 0.5, np.float32)
        return np.asarray(cv2.remap(self._shown, at[..., 1], at[..., 0], cv2.INTER_LINEAR))

    def texture(
        self, size: tuple[int, int] = (128, 128), *, tileable: bool | str = False, seed: int = 7
    ) -> UInt8[np.ndarray, "H W 3"]:
        """A preview of the texture, sRGB, from the reduced photograph.

        Parameters
        ----------
        size : height and width, px.
        tileable : whether it repeats without seams, or along which axis, ``x`` or ``y``.
        seed : equal seeds give equal previews.
        """
        made = flat_texture(self.coarse_photo, self.coarse(), size, tileable, np.random.default_rng(seed))
        return made.srgb

    def content(self) -> dict[str, Any]:
        """The content of a geometry file: patches, and areas that are polygons.

        Areas that were painted are missing; `pixels` has them, and `save` writes them as pictures.
        """
        content: dict[str, Any] = {"patches": [dict(entry) for entry in self._entries.values()]}
        for name, area in self._areas.items():
            if isinstance(area, list):
                self._enter(content, name, [polygon.tolist() for polygon in area])
        return content

    def save(
        self,
        file: str | os.PathLike[str],
        photo: str | None = None,
        *,
        flow: str = "photo_to_texture",
        step: str = "surface",
        source: str = "photo",
    ) -> Path:
        """Write a flow that has these surfaces: ``texloom run FILE``, or ``texloom.run(session.save(...))``.

        The geometry stands beside it in NAME_geometry.yaml, areas that were painted in NAME_AREA.png.

        Parameters
        ----------
        file : the flow's YAML file.
        photo : the photograph as the flow refers to it: a path from the flow's folder, or ``skimage:NAME``. None:
            the flow must be given one.
        flow, step, source : the flow that is included, its step that reads the geometry, and its source.

        Returns
        -------
        the flow's file.

        Raises
        ------
        InputError
            a patch or area is invalid.
        """
        path = Path(file)
        geometry = self.save_geometry(path.with_name(f"{path.stem}_geometry.yaml"))
        params = {"geometry": geometry.name, "detail": float(self.detail)}
        text = flow_text(path, flow, {source: photo or "required"}, {step: params})
        path.write_text(text, encoding="utf-8")
        return path

    def save_geometry(self, file: str | os.PathLike[str]) -> Path:
        """Write a geometry file, and areas that were painted beside it, see `save`."""
        from PIL import Image as Pillow

        path = Path(file)
        self.geometry()
        content = self.content()
        for name, area in self._areas.items():
            if isinstance(area, np.ndarray):
                label = f"{path.stem.removesuffix('_geometry')}_{name}"
                picture = path.with_name(re.sub(r"\W+", "_", label) + ".png")
                Pillow.fromarray(np.where(area, 255, 0).astype(np.uint8)).save(picture)
                self._enter(content, name, picture.name)
        patches = "".join(f"  - {yaml_value(entry)}\n" for entry in content.pop("patches"))
        rest = "".join(f"{name}: {yaml_value(area)}\n" for name, area in content.items())
        path.write_text(f"patches:\n{patches}{rest}", encoding="utf-8")
        return path

    def geometry(self) -> Geometry:
        """All patches and areas, checked.

        Raises
        ------
        InputError
            there is no patch, or one is invalid.
        """
        if not self._entries:
            raise InputError("patches: there is none; place one")
        known = parsed_geometry({"patches": list(self._entries.values())}, self.shape, {})
        areas: dict[str, Any] = {name: self._areas[name] for name in AREAS if name in self._areas}
        features = {
            name.removeprefix(FEATURES): area for name, area in self._areas.items() if name.startswith(FEATURES)
        }
        return dataclasses.replace(known, **areas, features=features)

    # -- private

    def _enter(self, content: dict[str, Any], name: str, value: Any) -> None:
        """Put an area into the content of a geometry file."""
        if name.startswith(FEATURES):
            content.setdefault("features", {})[name.removeprefix(FEATURES)] = value
        else:
            content[name] = value

    def _distortion(self, coarse: bool) -> PhotoDistortion:
        geometry, shape = self.geometry(), self.shape
        if coarse:
            shape = (self.coarse_photo.height, self.coarse_photo.width)
            geometry = _scaled(geometry, self.shape, shape)
        names = list(self._entries)
        parts = [
            self._part((coarse, name), patch, shape) for name, patch in zip(names, geometry.patches, strict=True)
        ]
        self._parts = {key: part for key, part in self._parts.items() if key[1] in self._entries}
        return distortion(geometry, parts, shape, self.detail)

    def _part(self, key: tuple[bool, str], patch: Patch, shape: tuple[int, int]) -> Coverage:
        """The Jacobians of a patch, kept until it changes."""
        state = b"".join(part.tobytes() for part in (patch.controls, patch.space, patch.unit))
        if key not in self._parts or self._parts[key][0] != state:
            self._parts[key] = state, coverage(patch, shape)
        return self._parts[key][1]


def _document(content: Mapping[str, Any]) -> Document:
    return Document.model_construct(file=Path("geometry"), content=dict(content), pictures={})


def _scaled(geometry: Geometry, old: tuple[int, int], new: tuple[int, int]) -> Geometry:
    """The same surfaces in the photograph at another size."""
    factor = np.array(new) / old
    shift = 0.5 * factor - 0.5  # pixel centres are at integers

    def moved(patch: Patch) -> Patch:
        controls = patch.controls.copy()
        controls[..., :2] = controls[..., :2] * factor + controls[..., 2:] * shift
        return dataclasses.replace(patch, controls=controls)

    def resized(area: Area | None) -> Area | None:
        if isinstance(area, np.ndarray):
            return _resized(area, new)
        return area if area is None or isinstance(area, Path) else [polygon * factor + shift for polygon in area]

    def areas(names: Iterable[str]) -> dict[str, Any]:
        return {name: resized(getattr(geometry, name)) for name in names}

    features = {name: resized(area) for name, area in geometry.features.items()}
    return dataclasses.replace(
        geometry, patches=[moved(patch) for patch in geometry.patches], **areas(AREAS), features=features
    )


def _resized(area: Mask, shape: tuple[int, int]) -> Mask:
    import cv2

    small = cv2.resize(area.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small >= 0.5)
