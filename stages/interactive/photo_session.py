"""Interactive description of the surfaces in a photograph: patches and regions are changed, and pictures follow."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy.typing import ArrayLike

from texloom.stages.analysis.photographs import bezier
from texloom.stages.analysis.photographs.field import Coverage, Distortion, coverage, distortion
from texloom.stages.analysis.photographs.geometry import Area, Geometry, Patch, parsed_geometry, pixels_inside
from texloom.stages.analysis.photographs.grid import grid_lines, grid_parameters, outlined
from texloom.stages.analysis.photographs.line_segments import Frame
from texloom.stages.analysis.photographs.plane_proposal import find_planes
from texloom.stages.analysis.structure.dog_mask import DogMaskParams, dog_mask
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.interactive.flow_file import flow_text, yaml_value
from texloom.stages.interactive.photo_texture import flat_texture
from texloom.stages.interactive.streamlines import streamlets
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear, srgb_from_linear
from texloom.stages.vocabulary.declare import Document, InputError
from texloom.stages.vocabulary.sizes import size_value

_PREVIEW_SIDE = 1024  # px of the longer side of the photograph that previews are sampled from
_AREAS = ("region", "without", "hole")
_FEATURES = "features."


class PhotoSession:
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
        self.photo = Image.of(photo) if isinstance(photo, np.ndarray) else photo
        self.detail = detail
        self.shape = (self.photo.height, self.photo.width)
        self.coarse_photo = Image(reduced(self.photo.color, coarse_side), ("R", "G", "B"))
        shown = srgb_from_linear(reduced(self.photo.color, _PREVIEW_SIDE))
        self._shown = np.rint(np.dstack([shown, np.ones(shown.shape[:2])]) * 255).astype(np.uint8)
        self._entries: dict[str, dict[str, Any]] = {}
        self._areas: dict[str, Area] = {}
        self._parts: dict[tuple[bool, str], tuple[bytes, Coverage]] = {}
        if geometry is not None:
            self._load(geometry if isinstance(geometry, Document) else _document(geometry))

    def _load(self, document: Document) -> None:
        read = parsed_geometry(document.content, self.shape, document.pictures)
        for number, entry in enumerate(document.content["patches"]):
            self._entries[entry.get("name") or f"patch_{number + 1}"] = dict(entry)
        areas = {name: getattr(read, name) for name in _AREAS} | {
            f"{_FEATURES}{name}": area for name, area in read.features.items()
        }
        self._areas = {
            name: pixels_inside(area, self.shape) if isinstance(area, Path) else area
            for name, area in areas.items()
            if area is not None and len(area if isinstance(area, list) else [area])
        }

    # -- patches

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the patches, in their order."""
        return tuple(self._entries)

    def place(
        self,
        name: str,
        corners: ArrayLike,
        *,
        size: tuple[float, float] | None = None,
        edge: float | None = None,
        beyond: float = 0.0,
    ) -> None:
        """Add a plane, or replace the patch of this name by one.

        Parameters
        ----------
        corners : four points, clockwise from the texture's origin.
        size : (height, width) in reality, in any unit; without it the aspect ratio follows from perspective.
        edge, beyond : see docs/photographs.md.
        """
        entry: dict[str, Any] = {"name": name, "corners": _points(corners, (4, 2))}
        if size is not None:
            entry["size"] = size_value(size)
        if edge is not None:
            entry["edge"] = float(edge)
        if beyond:
            entry["beyond"] = float(beyond)
        self._entries[name] = entry

    def replace(self, patches: Iterable[Mapping[str, Any]]) -> None:
        """Replace all patches by entries of a geometry file, each with a name; unchecked, as all changes are."""
        self._entries = {entry["name"]: dict(entry) for entry in patches}

    def propose(self, most: int = 4) -> tuple[str, ...]:
        """Add the planes that `plane_proposal` detects, up to so many; their names, ``plane_1`` and so on."""
        corners = Frame(self.shape).pixels(find_planes(self.photo).corners(most))
        names = tuple(f"plane_{number + 1}" for number in range(len(corners)))
        for name, quad in zip(names, corners, strict=True):
            self.place(name, quad)
        return names

    def remove(self, name: str) -> None:
        """Remove a patch."""
        self._entry(name)
        del self._entries[name]

    def move(self, name: str, offset: tuple[float, float]) -> None:
        """Move all points of a patch by ``offset``, rows and columns, px."""
        entry = self._entry(name)
        kind = "corners" if "corners" in entry else "controls"
        entry[kind] = (np.array(entry[kind]) + np.array(offset, np.float64)).tolist()

    def move_corner(self, name: str, number: int, to: tuple[float, float]) -> None:
        """Move one corner of a plane, 0 to 3 clockwise, or of a curved patch, whose other points follow.

        The control points of a curved patch are moved by the plane's bilinear share of the corner's displacement.
        """
        entry = self._entry(name)
        if "corners" in entry:
            entry["corners"] = [list(point) for point in entry["corners"]]
            entry["corners"][number] = [float(to[0]), float(to[1])]
            return
        i, j = ((0, 0), (0, 3), (3, 3), (3, 0))[number]
        controls = np.array(entry["controls"])
        down, across = (np.abs(np.arange(4) - (3 - end)) / 3 for end in (i, j))
        entry["controls"] = (controls + np.outer(down, across)[..., None] * (to - controls[i, j])).tolist()

    def move_control(
        self, name: str, at: tuple[int, int], to: tuple[float, float], weight: float | None = None
    ) -> None:
        """Move one of the 4x4 control points of a patch; a plane becomes a curved patch first.

        Parameters
        ----------
        at : row and column of the control point, 0 to 3, in the direction of the texture.
        to : its new row and column in the photograph, px.
        weight : its weight; None keeps it.

        Raises
        ------
        InputError
            the patch is an invalid plane.
        """
        entry = self._entry(name)
        if "corners" in entry:
            entry = self._entries[name] = self._curved(name)
        entry["controls"] = [[list(point) for point in row] for row in entry["controls"]]
        entry["controls"][at[0]][at[1]] = [float(to[0]), float(to[1])]
        if weight is not None:
            entry.setdefault("weights", np.ones((4, 4)).tolist())
            entry["weights"] = [list(row) for row in entry["weights"]]
            entry["weights"][at[0]][at[1]] = float(weight)

    def controls(self, name: str) -> tuple[Float64[np.ndarray, "4 4 2"], Float64[np.ndarray, "4 4"]]:
        """The control points of a patch and their weights, also of a plane."""
        controls = self._patch(name).controls
        return controls[..., :2] / controls[..., 2:], controls[..., 2]

    def grid(self, name: str) -> list[Float64[np.ndarray, "n 2"]]:
        """Lines that cut a patch into cells which are square in the texture."""
        return [line for lines in grid_lines(self._patch(name)) for line in lines]

    def grid_parameters(self, name: str) -> tuple[Float64[np.ndarray, "*rows"], Float64[np.ndarray, "*columns"]]:
        """The parameters of the patch, 0..1 down and across, at which the lines of `grid` run."""
        return grid_parameters(self._patch(name))

    def validity(self) -> dict[str, str | None]:
        """For each patch what is wrong with it, in a line; None where it is valid."""
        return {name: self._problem(name) for name in self._entries}

    # -- areas

    def stroke(self, area: str, points: ArrayLike, radius: float, *, erase: bool = False) -> None:
        """Draw a round brush along points.

        Parameters
        ----------
        area : ``region``, ``without``, ``hole``, or ``features.NAME``. Erasing from a region that is not painted
            begins with all that patches cover.
        points : rows and columns, px, which the brush passes in this order.
        radius : of the brush, px.
        erase : take away instead.
        """
        import cv2

        pixels = self._painted(area, erase)
        line = np.rint(np.array(points, np.float64).reshape(-1, 1, 2)[..., ::-1]).astype(np.int32)
        cv2.polylines(pixels, [line], False, int(not erase), max(1, round(2 * radius)), cv2.LINE_8)
        for centre in line[:, 0]:
            cv2.circle(pixels, centre.tolist(), round(radius), int(not erase), cv2.FILLED)
        self._areas[area] = pixels.astype(np.bool_)

    def outline(self, area: str, points: ArrayLike, *, erase: bool = False) -> None:
        """Fill the polygon of ``points``, rows and columns, px; see `stroke`."""
        pixels = self._painted(area, erase).astype(np.bool_)
        pixels[pixels_inside([np.array(points, np.float64)], self.shape)] = not erase
        self._areas[area] = pixels

    def fill(self, area: str, at: tuple[float, float], tolerance: float, *, erase: bool = False) -> None:
        """Fill the pixels that are connected to one and look like it; see `stroke`.

        Parameters
        ----------
        at : row and column of the pixel; one outside the photograph fills nothing.
        tolerance : largest difference in each of lightness, a and b, units of CIELAB.
        """
        import cv2

        row, column = (round(place) for place in at)
        pixels = self._painted(area, erase)
        if 0 <= row < self.shape[0] and 0 <= column < self.shape[1]:
            lab = np.ascontiguousarray(lab_from_linear(self.photo.color), np.float32)
            reached = np.zeros((self.shape[0] + 2, self.shape[1] + 2), np.uint8)
            flags = 4 | cv2.FLOODFILL_MASK_ONLY | cv2.FLOODFILL_FIXED_RANGE
            cv2.floodFill(lab, reached, (column, row), 0, (tolerance,) * 3, (tolerance,) * 3, flags)
            pixels[reached[1:-1, 1:-1] > 0] = not erase
        self._areas[area] = pixels.astype(np.bool_)

    def mark(self, area: str, params: DogMaskParams, *, erase: bool = False) -> None:
        """Paint all that `dog_mask` marks, such as joints; see `stroke`."""
        pixels = self._painted(area, erase).astype(np.bool_)
        pixels[dog_mask(self.photo, params).structure] = not erase
        self._areas[area] = pixels

    def clear(self, area: str) -> None:
        """Remove an area; the region is then all that patches cover."""
        self._check_area(area)
        self._areas.pop(area, None)

    def pixels(self, area: str) -> Bool[np.ndarray, "h w"]:
        """A copy of the pixels of an area; of a region that is not painted all inside the patches' outlines."""
        return self._painted(area, True).astype(np.bool_)

    # -- results

    def coarse(self) -> Distortion:
        """The distortion in the reduced photograph, ``coarse_photo``."""
        return self._distortion(coarse=True)

    def distortion(self) -> Distortion:
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
        return np.rint(srgb_from_linear(made.color) * 255).astype(np.uint8)

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
        areas: dict[str, Any] = {name: self._areas[name] for name in _AREAS if name in self._areas}
        features = {
            name.removeprefix(_FEATURES): area for name, area in self._areas.items() if name.startswith(_FEATURES)
        }
        return dataclasses.replace(known, **areas, features=features)

    # -- private

    def _entry(self, name: str) -> dict[str, Any]:
        if name not in self._entries:
            raise InputError(f"patch '{name}': there is none of this name")
        return self._entries[name]

    def _patch(self, name: str) -> Patch:
        self._entry(name)
        return self.geometry().patches[list(self._entries).index(name)]

    def _problem(self, name: str) -> str | None:
        try:
            alone = parsed_geometry({"patches": [self._entries[name]]}, self.shape, {})
            outlined(alone.patches, self.shape)
        except InputError as error:
            return str(error)
        return None

    def _curved(self, name: str) -> dict[str, Any]:
        """A plane as a curved patch."""
        entry = self._entry(name)
        alone = parsed_geometry({"patches": [entry]}, self.shape, {}).patches[0]
        points, weights = alone.controls[..., :2] / alone.controls[..., 2:], alone.controls[..., 2]
        curved = {"name": name, "controls": points.tolist(), "weights": weights.tolist()}
        if "size" in entry:
            curved["size"] = size_value(alone.size)
        elif "edge" in entry:  # the nearest edge is now that of the extended plane
            curved["edge"] = entry["edge"] * (1 + 2 * entry.get("beyond", 0.0))
        else:
            curved["size"] = size_value(self._patch(name).size)
        return curved

    def _check_area(self, area: str) -> None:
        if area not in _AREAS and not area.startswith(_FEATURES):
            raise InputError(f"area '{area}': want one of {', '.join(_AREAS)}, or {_FEATURES}NAME")

    def _painted(self, area: str, erase: bool) -> UInt8[np.ndarray, "h w"]:
        """A copy of an area's pixels."""
        self._check_area(area)
        if area in self._areas:
            return pixels_inside(self._areas[area], self.shape).astype(np.uint8)
        if area == "region" and erase:
            return outlined(self.geometry().patches, self.shape).astype(np.uint8)
        return np.zeros(self.shape, np.uint8)

    def _enter(self, content: dict[str, Any], name: str, value: Any) -> None:
        """Put an area into the content of a geometry file."""
        if name.startswith(_FEATURES):
            content.setdefault("features", {})[name.removeprefix(_FEATURES)] = value
        else:
            content[name] = value

    def _distortion(self, coarse: bool) -> Distortion:
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


def _points(points: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    array = np.array(points, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"corners: want {shape[0]} points (row, column), got {array.tolist()!r:.80}")
    return list(array.tolist())


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
        geometry, patches=[moved(patch) for patch in geometry.patches], **areas(_AREAS), features=features
    )


def _resized(area: Mask, shape: tuple[int, int]) -> Mask:
    import cv2

    small = cv2.resize(area.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small >= 0.5)
