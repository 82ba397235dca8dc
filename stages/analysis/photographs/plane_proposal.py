"""Plane proposal: the corners of rectangles on the planes of a photograph, from its vanishing points."""

import dataclasses
import logging
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.analysis.photographs.depth_cues import depth_cues
from texloom.stages.analysis.photographs.other_plane import other_plane
from texloom.stages.analysis.photographs.plane_candidates import Cells, plane_candidates
from texloom.stages.analysis.photographs.plane_extent import extended
from texloom.stages.analysis.photographs.plane_ranking import RankedPlane, as_frontal, measured, ranked
from texloom.stages.analysis.photographs.vanishing import vanishing_points
from texloom.stages.common.features.line_segments import Frame, line_segments
from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.vocabulary.arrays import Image, Quads
from texloom.stages.vocabulary.declare import Document, InputError, Params, stage
from texloom.stages.vocabulary.progress import Progress, part, report

_LOG = logging.getLogger(__name__)

_FAMILIES = 6  # vanishing points
_MOST = 8  # planes that are numbered
_SAME = 0.5  # shared area, as a share of that of both planes: they are one
_SHOWN_SIDE = 2048  # px of the picture, at most
_AS_EVEN = 0.95  # of the evenness of a rectangle, that it must have when it is extended,
_REPEATS = 0.85  # unless it repeats so clearly: of large tiles, some parts have joints and others none
_COLORS = ((1.0, 0.1, 0.1), (0.1, 1.0, 0.1))  # of segments down and across
_CHOSEN, _OTHER = (1.0, 0.8, 0.0), (0.3, 0.6, 1.0)  # of rectangles


class PlaneProposalParams(Params):
    """When planes are proposed, and which is taken."""

    plane: int | None = Field(None, ge=0, le=_MOST)
    """the plane to take, by its number in the picture, the best is 1; 0: none, the photograph counts as frontal;
    null: the best where it holds"""
    support: float = Field(0.03, gt=0, le=1)
    """minimum share of the length of all line segments that has to run in each direction of a plane"""
    extend: bool = True
    """extend the plane that is taken beyond its outermost lines, as far as its texture goes on"""
    geometry: Document | None = None
    """a file that says where the surfaces lie, see `jacobian_field`: no planes are proposed"""


@dataclasses.dataclass(frozen=True)
class PlaneProposal:
    """The proposed planes."""

    corners: Quads
    """a rectangle on the plane that is taken, around its line segments and what goes on beyond them; none where the
    photograph counts as frontal"""
    picture: Image
    """the photograph, at up to 2048 px, with the rectangles, numbered from the best on; that taken is yellow, with
    its segments, red down and green across"""
    table: dict[str, Any]
    """``taken``: number, 0 for none; ``unasked``: the photograph counts as frontal though nobody
    says so; ``why``: a sentence; ``doubt``: why it may be no flat surface, else empty; ``extended``:
    how many times as large as the rectangle around its lines the one that is taken is, from the front; ``planes``:
    ``confidence``, ``repetition``, ``evenness``, ``straightness``, each 0..1, and ``area``, a share of the
    photograph, of each"""


@stage(version=4)
def plane_proposal(image: Image, params: PlaneProposalParams) -> PlaneProposal:
    """Propose rectangles on the planes of a photograph: walls of bricks, tiles, windows.

    Line segments that point to the same vanishing point are parallel in space. Where segments of two such families
    meet, they lie on a plane, and the homography of the plane follows from both vanishing points but for the
    aspect ratio. The rectangle encloses the segments of both; it may reach beyond the photograph. That of the plane
    that is taken is extended to where its texture ends, see `extended`, unless it is less even then and does not
    repeat clearly.

    Planes are ranked by what they look like from the front: how well they repeat, how even they are, and how many
    of their lines are straight. Confidence is the geometric mean of the three; a plane holds from .45 on, and
    from a twentieth of the photograph. Without one, a photograph counts as frontal, unless lines that converge,
    texture that becomes finer, or parts that differ say that it is not.

    Parameters
    ----------
    image : the photograph.

    Raises
    ------
    InputError
        no plane holds though perspective, a curved surface or several surfaces are evident; or there is no plane
        of this number.

    References
    ----------
    [Gioi2010]_ the segments. [LiebowitzZisserman1998]_ rectification by vanishing points. Where planes lie, and
    their ranking, are ours.
    """
    if params.geometry is not None:
        table = {
            "taken": 0,
            "unasked": False,
            "why": "the geometry file says where surfaces lie",
            "extended": 1.0,
            "doubt": "",
            "planes": [],
        }
        return PlaneProposal(np.empty((0, 4, 2), np.float32), _drawn(image, [], 0), table)
    with part(0.0, 0.8):
        found = find_planes(image, params.support)
    planes, taken = found.planes, found.best if params.plane is None else params.plane
    if taken > len(planes):
        raise InputError(f"plane: there is no plane {taken}; {len(planes)} are proposed")
    if params.plane is None and found.doubt:
        raise InputError(f"image: {found.doubt}, and no plane is evident: {_advice(planes)}")
    share = 1.0
    if taken and params.extend:
        further, share = _extended(image, planes[taken - 1])
        planes = [*planes[: taken - 1], further, *planes[taken:]]
    why = _described(planes, taken) if taken else "the photograph counts as frontal"
    if share > 1:
        why += (
            f"; extended beyond its outermost lines, to {share:.1f} times that size (--set plane.extend=false "
            "keeps to the lines)"
        )
    if not taken and params.plane is None:
        held = bool(planes) and planes[0].holds
        why += ": its lines are as straight" if held else ": no plane is evident from its lines"
    hint = found.hint if params.plane is None and not taken else ""
    if hint:
        why += f"; {hint}: control points (--set geometry=my.yaml) tell how, --set plane=0 says that it is flat"
    other = other_plane({"taken": taken, "planes": planes})
    why += f"; another: {other}, see planes.png" if other else ""
    _LOG.warning("%s", why)
    table = {
        "taken": taken,
        "unasked": not taken and params.plane is None,
        "why": why,
        "extended": round(share, 3),
        "doubt": hint,
        "planes": [_measures(plane) for plane in planes],
    }
    cells = Cells((image.height, image.width))
    corners = [cells.pixels(plane.candidate.corners) for plane in planes[taken - 1 : taken] if taken]
    return PlaneProposal(np.array(corners, np.float32).reshape(-1, 4, 2), _drawn(image, planes, taken), table)


@dataclasses.dataclass(frozen=True)
class FoundPlanes:
    """The planes of a photograph."""

    planes: list[RankedPlane]
    """different ones, the best first"""
    best: int
    """number of the one to take; 0 where the photograph has more merit as a frontal plane, or none holds"""
    doubt: str
    """why it can be no frontal plane, where none holds; else empty"""
    hint: str = ""
    """why it may be none, where it counts as one; else empty"""

    def corners(self, most: int) -> Quads:
        """Of up to ``most`` planes that hold and do not overlap, half diagonals from the photograph's middle."""
        kept: list[RankedPlane] = []
        for plane in self.planes:
            overlaps = any((plane.candidate.area & other.candidate.area).any() for other in kept)
            if plane.holds and len(kept) < most and not overlaps:
                kept.append(plane)
        return np.array([plane.candidate.corners for plane in kept], np.float32).reshape(-1, 4, 2)


def find_planes(image: Image, support: float = PlaneProposalParams().support) -> FoundPlanes:
    """Find the planes of a photograph and rank them, see `plane_proposal`."""
    cells, segments = Cells((image.height, image.width)), line_segments(image)
    points = vanishing_points(segments, _FAMILIES, support)
    report(Progress(0.1))
    planes: list[RankedPlane] = []
    with part(0.1, 0.9):
        by_merit = ranked(image, plane_candidates(segments, points, cells), segments, cells)
    for plane in by_merit:
        if len(planes) < _MOST and not any(_are_same(plane, other) for other in planes):
            planes.append(plane)
    frontal = as_frontal(image, segments)
    report(Progress(1.0))
    holds = bool(planes) and planes[0].holds
    if holds and (frontal is None or not frontal.is_surface or frontal.merit[1] <= planes[0].merit[1]):
        return FoundPlanes(planes, 1, "")
    cues = depth_cues(image, segments, points)
    doubt, hint = cues.reason, cues.hint
    if not doubt and frontal is not None:
        if not frontal.is_surface:
            doubt = "its parts differ as several surfaces do"
        elif not frontal.is_clear:
            parts = f"its parts differ (evenness {frontal.evenness:.2f})"
            doubt = f"{hint}, and {parts}" if hint else ""  # two weak signs are one that counts
            hint = f"{parts}, so that it may be curved, or show several surfaces"
    return FoundPlanes(planes, 1, "") if holds and doubt else FoundPlanes(planes, 0, doubt, hint)


def _extended(image: Image, plane: RankedPlane) -> tuple[RankedPlane, float]:
    """A plane with what goes on beyond its lines, and how many times as large it is then."""
    cells = Cells((image.height, image.width))
    corners = cells.pixels(plane.candidate.corners)
    segments = line_segments(image)
    further = extended(image, corners, segments)
    candidate = dataclasses.replace(plane.candidate, corners=cells.places(further.corners))
    after = measured(image, candidate, segments, cells) if further.share > 1 else None
    if after is None or (after.evenness < _AS_EVEN * plane.evenness and after.repetition < _REPEATS):
        return plane, 1.0
    return dataclasses.replace(plane, candidate=candidate), further.share


def _are_same(one: RankedPlane, other: RankedPlane) -> bool:
    first, second = one.candidate.area, other.candidate.area
    return bool(np.count_nonzero(first & second) > _SAME * np.count_nonzero(first | second))


def _advice(planes: list[RankedPlane]) -> str:
    taken = (
        f"; take a plane that is proposed (--set plane=1 to {len(planes)}; planes.png shows them then)"
        if planes
        else ""
    )
    return (
        "give the corners or control points of the surface (--set geometry=my.yaml, see docs/photographs.md)"
        f"{taken}; or crop the photograph to one surface, and take it as it is (--set plane=0)"
    )


def _measures(plane: RankedPlane) -> dict[str, float]:
    names = ("confidence", "repetition", "evenness", "straightness", "area")
    return {name: round(getattr(plane, name), 3) for name in names}


def _described(planes: list[RankedPlane], taken: int) -> str:
    measures = _measures(planes[taken - 1])
    return (
        f"plane {taken} of {len(planes)} is taken, with a confidence of {measures['confidence']:.2f} (repetition "
        f"{measures['repetition']:.2f}, evenness {measures['evenness']:.2f}, straight lines "
        f"{measures['straightness']:.2f}; {measures['area']:.0%} of the photograph)"
    )


def _drawn(image: Image, planes: list[RankedPlane], taken: int) -> Image:
    import cv2

    shown = reduced(image.color, _SHOWN_SIDE)
    canvas = np.ascontiguousarray(0.6 * np.clip(shown, 0, 1), np.float32)
    thickness = max(1, round(min(canvas.shape[:2]) / 384))
    cells, frame = Cells((image.height, image.width)), Frame((canvas.shape[0], canvas.shape[1]))

    def draw(places: np.ndarray, closed: bool, color: tuple[float, float, float]) -> None:
        fixed = np.rint(np.clip(frame.pixels(places)[..., ::-1], -1e5, 1e5) * 16).astype(np.int32)
        cv2.polylines(canvas, list(fixed), closed, color, thickness, cv2.LINE_AA, 4)

    # the best last, over the others
    for number in range(len(planes), 0, -1):
        candidate = planes[number - 1].candidate
        outline = _CHOSEN if number == taken else _OTHER
        if number == taken:
            for family, color in zip(candidate.families, _COLORS, strict=True):
                draw(family.ends, False, color)
        draw(candidate.corners[None], True, outline)
        row, column = frame.pixels(cells.centres()[candidate.area].mean(axis=0)).round().astype(int).tolist()
        for width, shade in ((6 * thickness, (0.0, 0.0, 0.0)), (2 * thickness, outline)):
            ink = np.zeros(canvas.shape[:2], np.uint8)  # text is drawn in 8 bits alone
            cv2.putText(ink, str(number), (column, row), cv2.FONT_HERSHEY_SIMPLEX, thickness, 255, width)
            canvas[ink > 0] = shade
    return Image(canvas, ("R", "G", "B"))
