"""The lattice of an exemplar, which follows a hand. In a worker, which keeps the exemplar."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.studio.messages.answers import LatticePicture
from texloom.pipelines.studio.messages.requests import LatticeRequest, LatticeVertices
from texloom.pipelines.studio.work import Places, library_of
from texloom.stages.interactive.lattice_session import LatticeSession

_SIDE = 384  # px of the straightened picture, the longer one


class Lattices:
    """A session, and the picture it is of."""

    def __init__(self, places: Places):
        self.library = library_of(places)
        self._picture = ""
        self._session: LatticeSession | None = None

    def follow(self, work: LatticeRequest, send: Callable[..., None]) -> None:
        """Send the lattice through the placed vertices, or a detected one, and the straightened picture."""
        session = self._opened(work.picture)
        if work.lattice is None:
            session.detect()
        else:
            session.restore(work.lattice.model_dump())
        known = LatticeVertices.model_validate(session.content())
        problem = session.validity()
        if problem is not None:
            send(LatticePicture(number=work.number, lattice=known, problem=problem))
            return
        lattice, small = session.lattice(), session.preview(_SIDE)
        pixels = np.full((*small.shape[:2], 4), 255, np.uint8)
        pixels[..., :3] = small
        rows = zip(lattice.steps.tolist(), lattice.vertices.tolist(), strict=True)
        vertices = tuple((i, j, row, column) for (i, j), (row, column) in rows)
        told = LatticePicture(
            number=work.number, lattice=known, vertices=vertices, height=small.shape[0], width=small.shape[1]
        )
        send(told, pixels.tobytes())

    def _opened(self, picture: str) -> LatticeSession:
        if self._session is None or self._picture != picture:
            image = open_source("picture", self.library.reference(picture)).read()
            self._picture, self._session = picture, LatticeSession(image)
        return self._session
