"""Surfaces in photographs: the session of each, whose previews follow the page. In a worker, which keeps it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.studio.library import GEOMETRY, Library
from texloom.pipelines.studio.messages.answers import (
    PhotoArea,
    PhotoLines,
    PhotoPatch,
    PhotoPreview,
    PhotoProposal,
    PhotoState,
)
from texloom.pipelines.studio.messages.recipes import BrushRecipe, KeptPhoto, PhotoRecipe
from texloom.pipelines.studio.messages.requests import PhotoRequest
from texloom.pipelines.studio.work import KeepPhotoWork, Places, library_of
from texloom.stages.analysis.photographs.plane_proposal import find_planes
from texloom.stages.analysis.structure.dog_mask import DogMaskParams
from texloom.stages.common.features.line_segments import Frame
from texloom.stages.interactive.photo_session import PhotoSession

_SESSIONS = 2
"""photographs that are kept open"""
_PLANES = 4
"""that are proposed, at most"""
_AREA_SIDE = 1024  # px of the longer side of an area's picture


class OpenPhoto:
    """A photograph, and what the page has made of it."""

    def __init__(self, library: Library, photo: str):
        self.session = PhotoSession(open_source("photo", library.reference(photo)).read())
        self._edits: dict[str, tuple[BrushRecipe, ...]] = {}
        self._patches: tuple[Any, ...] = ()

    def place(self, recipe: PhotoRecipe) -> bool:
        """Place the patches of the recipe; whether they are others than before."""
        has_moved = recipe.patches != self._patches
        self._patches = recipe.patches
        self.session.replace(patch.model_dump(mode="json", exclude_none=True) for patch in recipe.patches)
        return has_moved

    def paint(self, recipe: PhotoRecipe, has_moved: bool) -> set[str]:
        """Paint the areas of the recipe; those that have changed."""
        changed = set()
        for name in {*recipe.areas, *self._edits}:
            before, now = self._edits.get(name, ()), recipe.areas.get(name, ())
            # A region that is first erased from begins with the outlines of the patches.
            follows = has_moved and name == "region" and bool(now) and now[0].erase
            if before == now and not follows:
                continue
            changed.add(name)
            self._edits.pop(name, None)
            if follows or now[: len(before)] != before:
                before = ()
            if not before:
                self.session.clear(name)
            for edit in now[len(before) :]:
                self._edit(name, edit)
            self._edits[name] = now
        return changed

    def _edit(self, area: str, edit: BrushRecipe) -> None:
        erase = edit.erase
        if edit.tool == "stroke":
            self.session.stroke(area, edit.points, edit.radius, erase=erase)
        elif edit.tool == "outline":
            self.session.outline(area, edit.points, erase=erase)
        elif edit.tool == "fill":
            self.session.fill(area, edit.points[0], edit.tolerance, erase=erase)
        else:
            # The finest joints are about a quarter as wide as the widest.
            inner = min(max(edit.radius / 4, 0.5), 64)
            params = DogMaskParams(
                inner=inner, outer=max(edit.radius, 2 * inner), threshold=edit.tolerance, features=edit.features
            )
            self.session.mark(area, params, erase=erase)


class Photographer:
    """The photographs that a page has open."""

    def __init__(self, places: Places):
        self.library = library_of(places)
        self._open: dict[str, OpenPhoto] = {}

    def answer(self, work: PhotoRequest, check: Callable[[], None], send: Callable[..., None]) -> None:
        """Send what follows from the patches and areas of a photograph, the fastest first."""
        photo = self._opened(work.recipe.photo)
        session = photo.session
        if work.propose:
            corners = Frame(session.shape).pixels(find_planes(session.photo).corners(_PLANES))
            send(
                PhotoProposal(
                    number=work.number, planes=tuple(quad.tolist() for quad in corners.astype(np.float64))
                )
            )
            return
        has_moved = photo.place(work.recipe)
        problems = session.validity()
        is_valid = bool(problems) and not any(problems.values())
        patches = tuple(_described(session, name, problem, is_valid) for name, problem in problems.items())
        send(PhotoState(number=work.number, patches=patches))
        if work.patch in problems and is_valid:
            picture = session.preview(work.patch, work.side)
            told = PhotoPreview(number=work.number, height=picture.shape[0], width=picture.shape[1])
            send(told, picture.tobytes())
        for name in sorted(photo.paint(work.recipe, has_moved)):
            area = _small(session.pixels(name)) if work.recipe.areas.get(name) else np.zeros((0, 0), np.uint8)
            told_area = PhotoArea(number=work.number, name=name, height=area.shape[0], width=area.shape[1])
            send(told_area, area.tobytes())
        check()
        if work.streamlines and is_valid:
            lines = np.ascontiguousarray(session.streamlines(), np.float32)
            send(PhotoLines(number=work.number, lines=lines.shape[1], points=lines.shape[2]), lines.tobytes())

    def keep(self, work: KeepPhotoWork, send: Callable[..., None]) -> None:
        """Write the geometry file of a photograph, with pictures of its areas, into the library."""
        photo = self._opened(work.recipe.photo)
        photo.paint(work.recipe, photo.place(work.recipe))
        folder = self.library.new_folder()
        try:
            photo.session.save_geometry(folder / GEOMETRY)
            send(KeptPhoto(geometry=self.library.take(folder, GEOMETRY)))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _opened(self, photo: str) -> OpenPhoto:
        opened = self._open.pop(photo, None) or OpenPhoto(self.library, photo)
        self._open[photo] = opened
        while len(self._open) > _SESSIONS:
            del self._open[next(iter(self._open))]
        return opened


def _described(session: PhotoSession, name: str, problem: str | None, is_valid: bool) -> PhotoPatch:
    rows, columns = session.grid_parameters(name) if is_valid else ((), ())
    return PhotoPatch(name=name, problem=problem or "", rows=tuple(rows), columns=tuple(columns))


def _small(area: np.ndarray) -> np.ndarray:
    """The picture of an area: 255 inside."""
    import cv2

    factor = min(1.0, _AREA_SIDE / max(area.shape))
    height, width = (max(1, round(side * factor)) for side in area.shape)
    return np.asarray(
        cv2.resize(area.astype(np.uint8) * np.uint8(255), (width, height), interpolation=cv2.INTER_AREA)
    )
