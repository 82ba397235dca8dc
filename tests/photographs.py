"""Photographs of known textures, and their whole analysis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from texloom.stages.analysis.photographs.feature_distance import FeatureDistanceParams, feature_distance
from texloom.stages.analysis.photographs.gaussian_stack import GaussianStack, GaussianStackParams, gaussian_stack
from texloom.stages.analysis.photographs.jacobian_field import JacobianField, JacobianFieldParams, jacobian_field
from texloom.stages.analysis.photographs.unroll import UnrollParams, unroll
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.repetition import RepetitionParams, repetition
from texloom.stages.analysis.similarity.appearance_stack import (
    AppearanceStack,
    AppearanceStackParams,
    appearance_stack,
)
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixel, PerPixelParams, per_pixel
from texloom.stages.vocabulary.arrays import Image


def surfaces(photo: Image, folder: Path, detail: float = 0.3, **content: Any) -> JacobianField:
    """The distortion of texture on the patches of a geometry file."""
    path = folder / "geometry.json"
    path.write_text(json.dumps(content))
    return jacobian_field(photo, JacobianFieldParams(geometry=path, detail=detail))


def homography(corners: Any) -> np.ndarray:
    """From (u, v, 1) of the unit square to (row * w, column * w, w); corners clockwise from (0, 0)."""
    import cv2

    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(square, np.array(corners, np.float32)))


def unit_square(corners: Any, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Where pixels are in a plane in perspective, (..., 2): 0..1 down and across between its corners."""
    back = np.stack([rows, columns, np.ones_like(rows)], axis=-1) @ np.linalg.inv(homography(corners)).T
    return np.asarray(back[..., :2] / back[..., 2:])


def analysed(
    photo: Image,
    surface: JacobianField,
    whole: float = 0.15,
    even: float = 0,
    distant: bool = False,
    **features: Any,
) -> tuple[GaussianStack, AppearanceStack]:
    """Levels and appearances as the flows make them; ``features`` are params of `feature_distance`."""
    params = GaussianStackParams(min_whole=whole, even=even, distant=distant)
    levels = gaussian_stack(photo, surface.jacobian, surface.level, surface.region, params)
    stack = feature_distance(
        photo,
        surface.jacobian,
        surface.region,
        FeatureDistanceParams(**features),
        classes=surface.features,
        stack=levels.stack,
        corner=levels.corner,
    ).stack
    look = appearance_stack(
        levels.image,
        AppearanceStackParams(),
        jacobian=levels.jacobian,
        stack=stack,
        valid=levels.valid,
        known=levels.known,
    )
    return levels, look


def repeating(levels: GaussianStack) -> dict[str, Any]:
    """By what the texture repeats, as `made` takes it."""
    laid = unroll(levels.image, levels.jacobian, levels.valid, UnrollParams())
    offsets = offset_statistics(laid.image, OffsetStatisticsParams())
    lattice = lattice_selection(laid.image, offsets.density, LatticeSelectionParams(stripes=True))
    fitted = repetition(laid.image, lattice.generators, RepetitionParams())
    return {"chart": laid.chart, "generators": fitted.generators}


def made(
    levels: GaussianStack, look: AppearanceStack, seed: int = 1, inputs: Any = None, **params: Any
) -> PerPixel:
    """The texture, flat or as ``inputs`` has it."""
    return per_pixel(
        levels.image,
        look.appearance,
        look.basis,
        look.candidates,
        look.toroidal,
        PerPixelParams(**params),
        np.random.default_rng(seed),
        jacobian=levels.jacobian,
        **(inputs or {}),
    )


def reduced(color: np.ndarray, factor: int) -> np.ndarray:
    """Means of squares of pixels."""
    height, width = (side // factor for side in color.shape[:2])
    return np.asarray(color.reshape(height, factor, width, factor, -1).mean(axis=(1, 3)))


def psnr(made: np.ndarray, wanted: np.ndarray) -> float:
    """Peak signal-to-noise ratio, dB, for values in 0..1."""
    return float(-10 * np.log10(np.square(made - wanted, dtype=np.float64).mean()))
