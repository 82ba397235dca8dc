"""Features of the patches of texture optimisation: colour, guidance, maps, guides, and lattice phase."""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int16

from texloom.stages.common.features.maps import map_features
from texloom.stages.common.grids.pyramid import MAX_ROW_VALUES
from texloom.stages.common.grids.working_size import Halvings, reduction, square_means
from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point
from texloom.stages.synthesis.optimisation.guides import Guides
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.optimisation.scale import Scale
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import FilledExemplar
from texloom.stages.vocabulary.scratch import bands, empty

_LOWS = (0.0, -80.0, -80.0)  # of histograms: L, a, b
_HIGHS = (100.0, 80.0, 80.0)
_FARTHEST = 100.0  # of guidance
_GUIDE_RANGE = 300.0
_COMPONENTS = 5  # of maps besides colour; nine tenths of their variance take four or five
_OTHERS = 8  # maximum number of channels besides maps and guides: colour, guidance, phases


FeaturesOfScale: TypeAlias = tuple[
    Int16[np.ndarray, "h wc"], Int16[np.ndarray, "H W k"] | None, Bool[np.ndarray, "H W k"] | None
]
"""see `PatchFeatures.at`"""


class PatchFeatures:
    """The planes of an exemplar by which its patches are compared with the target's, [Kaspar2015]_ section 3.1.

    A grey exemplar has lightness alone as colour: two planes that are 0 everywhere change no distance.

    Parameters
    ----------
    exemplar : with its excluded pixels filled.
    guidance : distance to features, 0..100, with the factor ``weight``; none without guidance.
    weights : of maps besides colour, see `map_features`.
    guides : planes that are given for the target; none without.
    phase : the exemplar's lattice, with the factor ``regularity``, CIELAB units; none if it is not enforced.
    given : an image with the same channels, whose colour and maps are described too; see `of_given`.
    """

    def __init__(
        self,
        exemplar: FilledExemplar,
        guidance: ScalarMap | None,
        weight: float,
        weights: Mapping[str, float],
        guides: Guides | None,
        phase: LatticePhase | None,
        regularity: float,
        patch_size: int,
        given: Image | None = None,
    ):
        image, usable = exemplar.image, exemplar.valid
        self.guided = guidance is not None
        self.planes = _planes(image, guidance)
        step = reduction(image.height, image.width) ** 2  # double precision takes twice the memory
        pixels = image.height * image.width
        counted = np.arange(0, pixels, step) if usable is None else np.flatnonzero(usable)[::step]
        sampled = np.ascontiguousarray(self.planes[counted // image.width, counted % image.width, :3])
        spread = float(np.sqrt(sampled.var(axis=0, dtype=np.float64).sum()))
        self.colors = 3
        """planes of colour, which are the first"""
        if _is_grey(self.planes) and (given is None or _is_grey(lab_from_linear(given.color))):
            self.planes = np.delete(self.planes, (1, 2), axis=2)
            self.colors = 1
        others = _OTHERS + (0 if guides is None else guides.exemplar.shape[2])
        components = min(_COMPONENTS, MAX_ROW_VALUES // patch_size - others)
        if given is None:
            self.maps = map_features(image, spread, weights, usable, components)
        else:
            self.maps, self.given_maps = _maps_of_both(image, given, spread, weights, usable, components)
        self.factors = np.ones(self.colors, np.float32)
        if self.guided:
            self.factors = np.append(self.factors, np.float32(weight))
        if self.maps.shape[2]:
            self.planes = np.concatenate([self.planes, self.maps], axis=2)
            self.factors = np.concatenate([self.factors, np.ones(self.maps.shape[2], np.float32)])
        self._sizes = Halvings(self.planes)
        self.guides = guides
        self.phase = phase
        self.regularity = regularity
        self.patch_size = patch_size

    def at(self, scale: Scale, phased: bool, margin: tuple[int, int]) -> FeaturesOfScale:
        """Fixed-point features of the exemplar, and those of the target that are given, which are the last ones.

        The third array is true where they are given; none if they are everywhere.

        Parameters
        ----------
        phased : whether the lattice is enforced at the scale.
        margin : px of the target at full size above and left of the result.
        """
        planes = self._sizes.resized(*scale.exemplar)
        if self.guided:
            distance, factor = planes[..., self.colors], self.factors[self.colors]
            nearest, farthest = distance.min() * factor, distance.max() * factor
            span = max(float(farthest - nearest), 1e-6)
        sides = (scale.patches[0] + self.patch_size - 1, scale.patches[1] + self.patch_size - 1)
        phase, radius = self.phase if phased else None, np.float32(self.regularity)
        here = None
        there: Float32[np.ndarray, "H W k"] = np.zeros((*sides, 0), np.float32)
        if self.guides is not None:
            here, there = self.guides.at(scale, sides, margin)
        count = (0 if here is None else here.shape[2]) + (0 if phase is None else 2 * len(phase.origin))
        height, width = scale.exemplar
        exemplar = np.empty((height, width * (planes.shape[2] + count)), np.int16)
        for band in bands(height, planes):  # features of a large exemplar in single precision take twice the memory
            own = [planes[band] * self.factors]
            if self.guided:  # distance fills its range at every scale
                own[0][..., self.colors] = (own[0][..., self.colors] - nearest) * (_FARTHEST * factor / span)
            if here is not None:
                own.append(here[band])
            if phase is not None:
                own.append(radius * phase.of_exemplar(height, width, scale.factor, band))
            exemplar[band] = fixed_point(own[0] if len(own) == 1 else np.concatenate(own, axis=2))
        if not count:
            return exemplar, None, None
        given = empty((*sides, count), np.int16)
        asked = empty(given.shape, np.bool_)
        for band in bands(sides[0], given, asked):
            wanted = [there[band]]
            if phase is not None:
                wanted.append(radius * phase.of_target(range(sides[0])[band], sides[1], scale.factor, margin))
            values = np.concatenate(wanted, axis=2)
            asked[band] = ~np.isnan(values)
            given[band] = fixed_point(np.where(asked[band], values, np.float32(0))).reshape(values.shape)
        return exemplar, given, None if asked.all() else asked

    def halved(self) -> Float32[np.ndarray, "p q c"]:
        """Colours and maps of the exemplar at half its size, CIELAB units."""
        planes = square_means(self.planes, 2) * self.factors
        return np.ascontiguousarray(np.delete(planes, self.colors, axis=2)) if self.guided else planes

    def release(self) -> None:
        """Free the planes of a large exemplar, after the last call of `at`: they take the memory of the votes."""
        if reduction(*self.planes.shape[:2]) > 1:
            self.planes = np.empty((0, 0, self.planes.shape[2]), np.float32)
            del self._sizes

    def of_given(self, given: Image, channels: int) -> tuple[Float32[np.ndarray, "H W c"], Bool[np.ndarray, "c"]]:  # type: ignore[name-defined]
        """Features of the image that was given, 0 where it has none, and which of ``channels`` it has.

        Distance to features and lattice phase are unknown.
        """
        planes = np.zeros((given.height, given.width, channels), np.float32)
        known = np.zeros(channels, bool)
        maps = self.colors + self.guided
        known[: self.colors] = known[maps : maps + self.maps.shape[2]] = True
        planes[..., : self.colors] = lab_from_linear(given.color)[..., : self.colors]
        planes[..., maps : maps + self.maps.shape[2]] = self.given_maps
        return planes, known

    def ranges(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Lows and highs of the histograms of the first ``channels`` features, CIELAB units."""
        lows, highs = np.array(_LOWS[: self.colors]), np.array(_HIGHS[: self.colors])
        if self.guided:
            lows, highs = np.append(lows, 0.0), np.append(highs, _FARTHEST * self.factors[self.colors])
        if self.maps.shape[2]:
            lows = np.concatenate([lows, self.maps.min(axis=(0, 1))])
            highs = np.concatenate([highs, self.maps.max(axis=(0, 1))])
        if self.guides is not None:
            few = np.full(self.guides.exemplar.shape[2], _GUIDE_RANGE)
            lows, highs = np.concatenate([lows, -few]), np.concatenate([highs, few])
        circles = np.full(channels - lows.size, self.regularity)
        lows, highs = np.concatenate([lows, -circles]), np.concatenate([highs, circles])
        return lows.astype(np.float32), highs.astype(np.float32)


def _is_grey(lab: Float32[np.ndarray, "h w c"]) -> bool:
    """Whether a and b are 0 in fixed point."""
    return bool(max(lab[..., 1:3].max(), -lab[..., 1:3].min()) * UNIT < 0.5)


def _planes(image: Image, guidance: ScalarMap | None) -> Float32[np.ndarray, "h w c"]:
    """CIELAB of an image, and ``guidance`` behind it: plane by plane in memory, as they are resampled."""
    count = 3 if guidance is None else 4
    planes = np.moveaxis(np.empty((count, image.height, image.width), np.float32), 0, 2)
    for band in bands(image.height, image.pixels):
        planes[band, :, :3] = lab_from_linear(image.elsewhere(image.pixels[band]).color)
        if guidance is not None:
            planes[band, :, 3] = guidance[band]
    return planes


def _maps_of_both(
    image: Image, given: Image, spread: float, weights: Mapping[str, float], usable: Mask | None, components: int
) -> tuple[Float32[np.ndarray, "h w k"], Float32[np.ndarray, "H W k"]]:
    """`map_features` of an image, and those of another one by the same components."""
    width = max(image.width, given.width)
    both = np.zeros((image.height + given.height, width, len(image.channels)), np.float32)
    valid = np.zeros(both.shape[:2], bool)
    both[: image.height, : image.width] = image.pixels
    both[image.height :, : given.width] = given.pixels
    valid[: image.height, : image.width] = True if usable is None else usable
    maps = map_features(image.elsewhere(both), spread, weights, valid, components)
    return (
        np.ascontiguousarray(maps[: image.height, : image.width]),
        np.ascontiguousarray(maps[image.height :, : given.width]),
    )
