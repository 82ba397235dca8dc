"""Patches on the surfaces of a photograph, which are placed and moved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from texloom.stages.analysis.photographs.geometry import Patch, parsed_geometry
from texloom.stages.analysis.photographs.grid import grid_lines, grid_parameters, outlined
from texloom.stages.analysis.photographs.plane_proposal import find_planes
from texloom.stages.common.features.line_segments import Frame
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import size_value


class PhotoPatches:
    """Patches of a photograph by name, as a geometry file has them. Changes are not checked."""

    def __init__(self, photo: Image):
        self.photo = photo
        self.shape = (photo.height, photo.width)
        self._entries: dict[str, dict[str, Any]] = {}

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

    # -- private

    def _entry(self, name: str) -> dict[str, Any]:
        if name not in self._entries:
            raise InputError(f"patch '{name}': there is none of this name")
        return self._entries[name]

    def _patch(self, name: str) -> Patch:
        self._entry(name)
        return self._parsed()[list(self._entries).index(name)]

    def _parsed(self) -> list[Patch]:
        """All patches, checked; `InputError` where there is none, or one is invalid."""
        if not self._entries:
            raise InputError("patches: there is none; place one")
        return list(parsed_geometry({"patches": list(self._entries.values())}, self.shape, {}).patches)

    def _covered(self) -> Mask:
        """All that the patches cover."""
        return outlined(self._parsed(), self.shape)

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


def _points(points: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    array = np.array(points, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"corners: want {shape[0]} points (row, column), got {array.tolist()!r:.80}")
    return list(array.tolist())
