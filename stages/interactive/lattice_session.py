"""Interactive description of the lattice of a near-regular exemplar, with a straightened preview."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from texloom.stages.analysis.regularity.deformed_lattice import (
    DeformedLattice,
    DeformedLatticeParams,
    check_lattice,
    deformed_lattice,
    lattice_through,
)
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.straighten import straighten
from texloom.stages.analysis.regularity.vertices import Vertices
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.interactive.flow_file import flow_text
from texloom.stages.vocabulary.arrays import Image, Vectors
from texloom.stages.vocabulary.declare import InputError, NoParams

Step = tuple[int, int]
"""of a vertex, along the two vectors"""
Point = tuple[float, float]
"""row and column, px"""


class LatticeSession:
    """The lattice of an exemplar, spanned by two vectors, whose vertices can be moved one by one.

    Vertices that were moved keep their positions; the others follow smoothly. A session must be used by one thread
    at a time.

    Parameters
    ----------
    image : the exemplar; an image, or an array as `Image.of` takes it.
    vertices : the content of a file of vertices to begin with, see `deformed_lattice`.
    stiffness : see `deformed_lattice`.
    coarse_side : longer side of the reduced exemplar that previews are made from, px.

    Examples
    --------
    >>> import skimage.data
    >>> session = LatticeSession(skimage.data.brick()[:128, :128])
    >>> session.span((10, 12), (32, 0), (0, 24))
    >>> session.move((1, 2), (44, 61))
    >>> session.lattice().deviation > 0
    True
    >>> session.preview(64).shape
    (64, 64, 3)
    """

    def __init__(
        self,
        image: Image | np.ndarray,
        vertices: Mapping[str, Any] | None = None,
        *,
        stiffness: float = 0.01,
        coarse_side: int = 384,
    ):
        self.image = Image.of(image) if isinstance(image, np.ndarray) else image
        self.shape = (self.image.height, self.image.width)
        self.stiffness = stiffness
        self._coarse = reduced(self.image.color, coarse_side)
        self._vectors: Vectors | None = None
        self._placed: dict[Step, Point] = {}
        if vertices is not None:
            self.restore(vertices)

    def _place(self, known: Vertices) -> None:
        steps, places = known.steps.tolist(), known.places.tolist()
        self._placed = {(i, j): (row, column) for (i, j), (row, column) in zip(steps, places, strict=True)}

    # -- changes

    def span(self, origin: Point, first: Point, second: Point) -> None:
        """Begin again with the regular lattice that two vectors span; all points are rows and columns, px.

        Parameters
        ----------
        origin : the vertex (0, 0).
        first, second : the vectors.
        """
        self._vectors = np.array([first, second], np.float64)
        self._placed = {(0, 0): (float(origin[0]), float(origin[1]))}

    def restore(self, content: Mapping[str, Any]) -> None:
        """Begin again with what `content` has returned, or with the content of a file of vertices."""
        known = Vertices.of(content)
        self._place(known)
        self._vectors = known.generators

    def detect(self) -> None:
        """Begin again with the lattice that the stages detect; takes a second or more.

        Raises
        ------
        InputError
            none is detected, or only courses.
        """
        density = offset_statistics(self.image, OffsetStatisticsParams()).density
        generators = lattice_selection(self.image, density, LatticeSelectionParams(courses=False)).generators
        params = DeformedLatticeParams(stiffness=self.stiffness)
        lattice = deformed_lattice(self.image, params, generators)
        inside = ((lattice.vertices >= 0) & (lattice.vertices <= np.array(self.shape) - 1)).all(axis=1)
        self._vectors = lattice.generators.astype(np.float64)
        self._place(
            Vertices(lattice.steps[inside].astype(np.int64), lattice.vertices[inside].astype(np.float64), None)
        )

    def move(self, step: Step, to: Point) -> None:
        """Move a vertex, which then keeps its position.

        Parameters
        ----------
        step : the vertex, by its steps along the first vector and along the second.
        to : its new row and column, px.
        """
        self._placed[int(step[0]), int(step[1])] = (float(to[0]), float(to[1]))

    def release(self, step: Step) -> None:
        """Let the vertex of ``step`` that was moved follow the others again, see `move`."""
        self._placed.pop(step, None)

    # -- results

    def validity(self) -> str | None:
        """What is wrong with the lattice, in a line; None where it is valid."""
        try:
            self._known()
        except InputError as error:
            return str(error)
        return None

    def lattice(self) -> DeformedLattice:
        """The lattice, bit-identical to that of `deformed_lattice`.

        Raises
        ------
        InputError
            there is none, or it is invalid.
        """
        return lattice_through(self.image, self._known(), self.stiffness)

    def preview(self, side: int | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """The exemplar with its lattice straightened, sRGB; black where it maps outside.

        Parameters
        ----------
        side : longer side, px; None or more than ``coarse_side``: that of the reduced exemplar.
        """
        small = self._coarse if side is None else reduced(self._coarse, side)
        lattice = self.lattice()
        factor = np.array(small.shape[:2]) / self.shape
        vertices, regular = (
            np.asarray((points + 0.5) * factor - 0.5, np.float32) for points in (lattice.vertices, lattice.regular)
        )
        straight = straighten(Image(small, ("R", "G", "B")), vertices, regular, NoParams()).image
        return straight.srgb

    def content(self) -> dict[str, Any]:
        """The content of a file of vertices: those that were moved or detected."""
        content: dict[str, Any] = {"vertices": [[*step, *place] for step, place in self._placed.items()]}
        if self._vectors is not None:
            content["generators"] = self._vectors.tolist()
        return content

    def save(
        self,
        file: str | os.PathLike[str],
        exemplar: str | None = None,
        *,
        flow: str = "near_regular",
        step: str = "vertices",
        source: str = "exemplar",
    ) -> Path:
        """Write a flow that has this lattice: ``texloom run FILE``, or ``texloom.run(session.save(...))``.

        The vertices stand beside it in NAME_vertices.json.

        Parameters
        ----------
        file : the flow's YAML file.
        exemplar : the exemplar as the flow refers to it: a path from the flow's folder, or ``skimage:NAME``. None:
            the flow must be given one.
        flow, step, source : the flow that is included, its step that reads the vertices, and its source.

        Returns
        -------
        the flow's file.

        Raises
        ------
        InputError
            there is no lattice, or it is invalid.
        """
        path = Path(file)
        self._known()
        vertices = path.with_name(f"{path.stem}_vertices.json")
        vertices.write_text(json.dumps(self.content()), encoding="utf-8")
        params = {"vertices": vertices.name, "stiffness": float(self.stiffness)}
        text = flow_text(path, flow, {source: exemplar or "required"}, {step: params})
        path.write_text(text, encoding="utf-8")
        return path

    def _known(self) -> Vertices:
        if not self._placed:
            raise InputError("vertices: there is no lattice; span or detect one")
        known = Vertices.of(self.content())
        check_lattice(known, self.shape)
        return known
