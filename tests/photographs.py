"""Photographs of known textures, and their whole analysis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from stages.analysis.appearance_stack import AppearanceStack, AppearanceStackParams, appearance_stack
from stages.analysis.feature_distance import FeatureDistanceParams, feature_distance
from stages.analysis.gaussian_stack import GaussianStack, GaussianStackParams, gaussian_stack
from stages.analysis.jacobian_field import JacobianField, JacobianFieldParams, jacobian_field
from stages.arrays import Image
from stages.synthesis.per_pixel import PerPixel, PerPixelParams, per_pixel


def surfaces(photo: Image, folder: Path, detail: float = 0.3, **content: Any) -> JacobianField:
    """How texture lies on the patches of a geometry file."""
    path = folder / "geometry.json"
    path.write_text(json.dumps(content))
    return jacobian_field(photo, JacobianFieldParams(geometry=path, detail=detail))


def analysed(
    photo: Image, surface: JacobianField, whole: float = 0.15, **features: Any
) -> tuple[GaussianStack, AppearanceStack]:
    """Levels and appearances as the flows make them; ``features`` are params of `feature_distance`."""
    levels = gaussian_stack(
        photo, surface.jacobian, surface.level, surface.region, GaussianStackParams(whole=whole)
    )
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


def made(
    levels: GaussianStack, look: AppearanceStack, seed: int = 1, inputs: Any = None, **params: Any
) -> PerPixel:
    """The texture, flat or as ``inputs`` has it."""
    return per_pixel(
        levels.image,
        look.appearance,
        look.basis,
        look.similar,
        look.toroidal,
        PerPixelParams(**params),
        np.random.default_rng(seed),
        jacobian=levels.jacobian,
        **(inputs or {}),
    )
