"""A flat texture from the surface of a photograph, by the stages and parameters of the flow photo_to_texture."""

from __future__ import annotations

import numpy as np

from texloom.stages.analysis.photographs.feature_distance import FeatureDistanceParams, feature_distance
from texloom.stages.analysis.photographs.field import PhotoDistortion
from texloom.stages.analysis.photographs.gaussian_stack import GaussianStackParams, gaussian_stack
from texloom.stages.analysis.photographs.unroll import UnrollParams, unroll
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.regularity.repetition import RepetitionParams, repetition
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixelParams, per_pixel
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.tileable import parse_tileable

_EVEN = 0.8  # share of the slowly varying illumination that is removed


def flat_texture(
    photo: Image, surface: PhotoDistortion, size: tuple[int, int], tileable: bool | str, rng: np.random.Generator
) -> Image:
    """The texture.

    Parameters
    ----------
    photo : the photograph, of the size of ``surface``.
    size : height and width of the texture, px.

    Raises
    ------
    InputError
        the region is too small, or a tileable texture cannot have this size.
    """
    levels = gaussian_stack(photo, surface.jacobian, surface.level, surface.region, GaussianStackParams(even=_EVEN))
    guided = feature_distance(
        photo,
        surface.jacobian,
        surface.region,
        FeatureDistanceParams(),
        classes=surface.features,
        stack=levels.stack,
        corner=levels.corner,
    )
    look = appearance_stack(
        levels.image,
        AppearanceStackParams(),
        jacobian=levels.jacobian,
        stack=guided.stack,
        valid=levels.valid,
        known=levels.known,
    )
    flat = unroll(levels.image, levels.jacobian, levels.valid, UnrollParams())
    offsets = offset_statistics(flat.image, OffsetStatisticsParams())
    lattice = lattice_selection(flat.image, offsets.density, LatticeSelectionParams(stripes=True))
    repeats = repetition(flat.image, lattice.generators, RepetitionParams())
    return per_pixel(
        levels.sharp,
        look.appearance,
        look.basis,
        look.candidates,
        look.toroidal,
        PerPixelParams(size=size, tileable=parse_tileable(tileable)),
        rng,
        jacobian=levels.jacobian,
        generators=repeats.generators,
        chart=flat.chart,
    ).image
