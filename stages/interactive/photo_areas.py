"""Areas of a photograph, which are painted."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, UInt8
from numpy.typing import ArrayLike

from texloom.stages.analysis.photographs.geometry import Area, pixels_inside
from texloom.stages.analysis.structure.dog_mask import DogMaskParams, dog_mask
from texloom.stages.interactive.photo_patches import PhotoPatches
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError

AREAS = ("region", "without", "hole")
FEATURES = "features."
"""before the name of a class of features"""


class PhotoAreas(PhotoPatches):
    """Areas of a photograph with patches: polygons, or pixels that were painted."""

    def __init__(self, photo: Image):
        super().__init__(photo)
        self._areas: dict[str, Area] = {}

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

    # -- private

    def _check_area(self, area: str) -> None:
        if area not in AREAS and not area.startswith(FEATURES):
            raise InputError(f"area '{area}': want one of {', '.join(AREAS)}, or {FEATURES}NAME")

    def _painted(self, area: str, erase: bool) -> UInt8[np.ndarray, "h w"]:
        """A copy of an area's pixels."""
        self._check_area(area)
        if area in self._areas:
            return pixels_inside(self._areas[area], self.shape).astype(np.uint8)
        if area == "region" and erase:
            return self._covered().astype(np.uint8)
        return np.zeros(self.shape, np.uint8)
