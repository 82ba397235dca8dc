"""Parameters of the self-tuning optimisation, and their presets."""

import dataclasses
from typing import Any, ClassVar, Literal

from pydantic import Field

from texloom.stages.synthesis.optimisation.coarse_to_fine import CoarseToFineParams, PatchScale, Schedule
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable

PRESETS: dict[str, dict[str, Any]] = {
    "kaspar2015": {
        "patch_size": 10,
        "coarsest": 35,
        "first_iterations": 30,
        "last_iterations": 5,
        "tolerance": 0.0,
        "occurrence_coarse": 10.0,
        "regularity": 0.0,
        "starts": 1,
        "border": False,
        "whole_cells": False,
        "relaxed_seams": False,
        "even_joints": False,
        "most_use": None,
    },
    "default": {},
    "fast": {
        "patch_size": 10,
        "coarsest": 35,
        "ratio": 1.6,
        "first_iterations": 10,
        "last_iterations": 2,
        "tolerance": 0.01,
        "starts": 1,
    },
}
"""values that differ from the fields' defaults"""

_OURS = Schedule(4, 3, 8, 12, 0.5, distance_per_try=0.5, narrow=True, fewer_iterations=2.3)


class OptimiseParams(CoarseToFineParams):
    """Parameters of the optimisation. A preset replaces some defaults; explicit values override it."""

    presets: ClassVar = PRESETS
    schedules: ClassVar = {
        "kaspar2015": Schedule(10, 7, 10, 0, 0.4, fewer_iterations=3.0, final_sigma=None),
        "default": _OURS,
        "fast": dataclasses.replace(_OURS, fine_sweeps=2, fewer_iterations=2.0),
    }

    preset: Literal["kaspar2015", "default", "fast"] = "default"
    """`kaspar2015`: the paper, and its authors' code for what the paper does not state, of this stage alone (the
    flow `kaspar2015` has its lattice and start too); `default`: random search at every scale, lattices enforced,
    strong uniformity at coarse scales, sharper last vote, early stop, patches of 12 px, the best of several starts;
    `fast`: the same with patches of 10 px, one start, and fewer scales and iterations"""
    patch_size: int = Field(12, ge=3, le=32)
    tileable: Tileable | None = None
    """the result continues across its borders: x left to right, y top to bottom, both, off; null: as a picture does
    of which pixels are kept, else off"""
    coarsest: int = Field(40, ge=8)
    last_iterations: int = Field(3, ge=1, le=200)
    occurrence: float = Field(10.0, ge=0, le=1e4)
    """weight of spatial uniformity: occurrence penalty of an exemplar patch of average use, squared CIELAB
    units per pixel; 0 lets smooth patches repeat, 100 prevents repetition at the cost of similarity"""
    occurrence_coarse: float = Field(30.0, ge=0, le=1e4)
    """the same weight at the coarsest scale, interpolated logarithmically between; no effect if `occurrence` is
    0"""
    most_use: float | None = Field(1.2, ge=1, le=100)
    """use of a region of a twelfth of the exemplar's side, relative to its fair share, above which its patches
    become dearer, so that what is easily recognised does not return everywhere, in a lattice relative to those of
    the same phase; null: no such limit; no effect where there are several exemplars, or `occurrence` is 0"""
    histogram_share: float = Field(0.5, ge=0, le=1)
    """share of the scales, coarsest first, at which votes also match the exemplar's histograms"""
    regularity: float = Field(64.0, ge=0, le=100)
    """weight of the lattice phase, CIELAB units: a phase error of half a cell counts as twice this difference; of
    half the period of straight lines at uneven distances, as once"""
    period: Size | None = None
    """size of the parts of a tileable result that each contain whole cells of the lattice, as the tiles
    of an atlas do, px; null: all of it"""
    starts: int = Field(3, ge=1, le=16)
    """results that are begun at the coarsest scales; the one of least repetition, distance of colours to the
    exemplar's, energy and occurrence penalty is continued"""
    border: bool = True
    """the exemplar is continued by half a patch, mirrored, so that its outermost pixels are used like all others"""
    whole_cells: bool = True
    """at the end, whole cells of the exemplar, such as bricks or stones, replace those that show parts of several;
    where contours or a lattice show cells, and nothing is kept or guided, or guides tell which of several exemplars
    lies where; also objects apart on a plain ground, such as flowers on paper, for fused, cut or mixed ones"""
    relaxed_seams: bool = True
    """at the end, seams between pieces of the exemplar move to where they are seen least, or, where a lattice is
    enforced, pieces move onto it if that makes seams cheaper; where there is one exemplar, and nothing is kept, or
    guided without `guided_seams`"""
    even_joints: bool = True
    """at the end, steps of tone that are seen at seams are spread over the pieces beside them, see `EvenJoints`;
    where there is one exemplar, and nothing is kept, or guided without `guided_seams`"""
    guided_seams: bool = False
    """whether `relaxed_seams` and `even_joints` also hold under a guide: one that changes slowly, so that seams may
    move, or that tells which of several exemplars lies where, unless one of these consists of cells"""

    def occurrence_at(self, scale: PatchScale) -> float:
        """Weight of spatial uniformity at a scale."""
        if self.occurrence > 0 and self.occurrence_coarse > 0:
            return float(self.occurrence_coarse * (self.occurrence / self.occurrence_coarse) ** scale.progress)
        return self.occurrence
