"""Solvers of one scale of a controlled texture: by patches, by pixels, by pixels of an oriented texture."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32, Int32, UInt32

from texloom.stages.common.features.control import ControlScale
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.regularity.phase_planes import phase_planes
from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide
from texloom.stages.synthesis.control_maps.comparable_control import comparable
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.match_search import Effort, Search
from texloom.stages.synthesis.optimisation.scale import Rounds, Scale
from texloom.stages.synthesis.optimisation.vote import copy_vote, mean_vote, vote_pixels, window
from texloom.stages.synthesis.reconstruction.discrete_synthesis import (
    LARGEST,
    DiscreteSolver,
    OrientedDiscreteSolver,
    ScaledExemplar,
    Sources,
)
from texloom.stages.synthesis.reconstruction.expected_use import expected_use
from texloom.stages.synthesis.reconstruction.local_variance import local_variance
from texloom.stages.synthesis.reconstruction.oriented_places import Frames, at_scale, clipped, interpolated_along
from texloom.stages.synthesis.reconstruction.reseed import reseeded
from texloom.stages.vocabulary.arrays import Correspondence, Image, Jacobian, Vectors
from texloom.stages.vocabulary.facts import Wraps

_TRIES = 32  # positions tried for each block of the start
_MARGIN = 4  # of a toroidal exemplar: its shorter side by this
_OVERUSE = 2.0  # use, in multiples of the average, above which random search rejects a patch
_REACH = 1  # px to every side that the last vote compares
_SIGMA = 1.0  # px, of the votes' weights about a patch's centre, in a last vote by means

Match: TypeAlias = Int32[np.ndarray, "2 _ _"] | Float32[np.ndarray, "2 _ _"]
"""where in the exemplar each patch or pixel of the result comes from: a patch or pixel, or between pixels"""


class ControlledRepetition(NamedTuple):
    """The repetition of a regular texture under control; see `phase_planes`."""

    generators: Vectors
    source: UInt32[np.ndarray, "h w 2"] | None
    wrap: Wraps


class ColorGuides(NamedTuple):
    """Colours that a result is to have in the mean, CIELAB, beside what control asks for."""

    exemplar: Guide
    """of each pixel of the exemplar"""
    target: TargetGuide
    """of the result, at any size"""


@dataclass(frozen=True)
class SolverInputs:
    """An exemplar, its control, and the control that the result is to have: planes in CIELAB units, full size."""

    image: Image
    texture: Float32[np.ndarray, "h w c"]
    control: Float32[np.ndarray, "h w k"]
    target: Float32[np.ndarray, "H W k"]
    use: Float32[np.ndarray, "h w"] | None = None
    """how often each pixel of the exemplar is to be used, relative to others of its control; none: evenly"""
    rare: float = 0.0
    """share of the target whose control is replaced; see `comparable`"""
    blurred: bool = False
    """control is blurred, since the target is smooth"""
    margin: int = 0
    """px of its other end that follow each border of a toroidal exemplar; 0 of any other"""
    regular: bool = False
    """the texture repeats by generators"""

    @classmethod
    def of(
        cls,
        image: Image,
        control: Image | None,
        target: Image | None,
        scale: ControlScale,
        size: tuple[int, int],
        use: Float32[np.ndarray, "h w"] | None = None,
        toroidal: bool = False,
        repetition: ControlledRepetition | None = None,
        guides: ColorGuides | None = None,
    ) -> "SolverInputs":
        """The planes for a result of height and width ``size``; no planes of control where there is none."""

        def planes(control: Image | None, size: tuple[int, int]) -> np.ndarray:
            return np.zeros((*size, 0), np.float32) if control is None else scale.of_control(control, *size)

        own = planes(control, (image.height, image.width))
        wanted = planes(target, size)
        # Colours tell places of one value of control apart, as often as the original has them.
        supply = use if guides is not None else None
        own, blurred, wanted, rare = comparable(own, wanted, scale.strength, toroidal, supply)
        phases = None if repetition is None else phase_planes(*repetition[:2], own, wanted, repetition.wrap)
        if phases is not None:
            own, wanted = phases.after(own, wanted)
        if guides is not None:
            own = np.concatenate([own, guides.exemplar], axis=2)
            wanted = np.concatenate([wanted, resize(guides.target, *size, bilinear=True)], axis=2)
        margin = min(image.height, image.width) // _MARGIN if toroidal else 0

        def padded(planes: np.ndarray) -> np.ndarray:
            sides = ((margin, margin),) * 2 + ((0, 0),) * (planes.ndim - 2)
            return np.ascontiguousarray(np.pad(planes, sides, mode="wrap"))

        texture, own = padded(scale.of_texture(image)), padded(own)
        use = None if use is None else padded(use)
        image = image.elsewhere(padded(image.pixels))
        return cls(image, texture, own, wanted, use, rare, blurred, margin, repetition is not None)

    def pixels(self, scale: Scale) -> Image:
        """The exemplar at a scale, all channels, linear."""
        return self.image.elsewhere(resize(self.image.pixels, *scale.exemplar))

    def period(self, scale: Scale) -> tuple[int, int] | None:
        """Height and width of a toroidal exemplar at a scale, without its margins."""
        if not self.margin:
            return None
        rows, columns = (round((side - 2 * self.margin) * scale.factor) for side in self.texture.shape[:2])
        return rows, columns

    def wanted(self, scale: Scale) -> Float32[np.ndarray, "scale_H scale_W k"]:
        """The result's control at a scale."""
        return resize(self.target, *scale.target)

    def use_at(self, scale: Scale) -> Float32[np.ndarray, "scale_h scale_w"] | None:
        """``use`` at a scale."""
        return None if self.use is None else resize(self.use[..., None], *scale.exemplar)[..., 0]

    def expected(self, scale: Scale, window: int) -> Float32[np.ndarray, "scale_h scale_w"]:
        """Use of each exemplar pixel that control asks for, relative to even use; mean over ``window`` px."""
        own, wanted = resize(self.control, *scale.exemplar), self.wanted(scale)
        even = wanted.shape[0] * wanted.shape[1] / (own.shape[0] * own.shape[1])
        return expected_use(own, wanted, window, self.use_at(scale)) / np.float32(even)


@dataclass
class Solver:
    """Representation of the result between scales, and its improvement at one."""

    inputs: SolverInputs
    patch_size: int
    """side of a patch, px; with single pixels, of the blocks that the result begins with"""
    wrap: Wraps
    """where the result continues across its borders"""
    occurrence: float
    """occurrence penalty, relative to the exemplar's `local_variance`"""

    def from_pixels(self, start: Correspondence, scale: Scale) -> Match:
        """A correspondence of full size at a scale."""
        full = start.shape[0], start.shape[1]
        side = scale.exemplar[0] - scale.places[0] + 1  # of a patch or pixel
        return correspondence.from_pixels(start, full, scale.patches, scale.places, side, scale.factor)

    def from_blocks(self, scale: Scale, random: np.random.Generator) -> Match:
        """Blocks of the exemplar, each the one of most similar control among some random ones."""
        own = resize(self.inputs.control, *scale.exemplar)
        wanted = self.inputs.wanted(scale)
        side = min(self.patch_size, *scale.exemplar)
        corner = np.empty((2, *scale.patches), np.int64)
        for top in range(0, scale.patches[0], side):
            for left in range(0, scale.patches[1], side):
                block = wanted[top : top + side, left : left + side]
                rows = random.integers(0, scale.exemplar[0] - side + 1, _TRIES)
                columns = random.integers(0, scale.exemplar[1] - side + 1, _TRIES)
                errors = [
                    float(((own[r : r + block.shape[0], c : c + block.shape[1]] - block) ** 2).sum())
                    for r, c in zip(rows, columns, strict=True)
                ]
                best = int(np.argmin(errors))
                corner[0, top : top + side, left : left + side] = rows[best]
                corner[1, top : top + side, left : left + side] = columns[best]
        return self._laid(corner, np.indices(scale.patches) % side, side, scale)

    def _laid(self, corner: np.ndarray, offset: np.ndarray, side: int, scale: Scale) -> Match:  # noqa: ARG002
        """Places at ``offset`` from the ``corner`` of a block of ``side`` px; all (2, p, q)."""
        return clipped(corner + offset, scale.places).astype(np.int32)

    def finer(self, match: Match, scale: Scale, growth: float) -> Match:
        """The match of the scale before, ``growth`` times coarser, at this scale."""
        return correspondence.rescale(match, scale.patches, scale.places, growth)

    def rounds(self, match: Match, scale: Scale, random: np.random.Generator) -> Rounds:
        """Improve ``match`` in place, round by round."""
        raise NotImplementedError

    def picture(self, match: Match, scale: Scale) -> tuple[Image, Correspondence]:
        """The result at a scale, all channels, linear; and where its pixels come from."""
        raise NotImplementedError


def nearest(match: Match) -> Correspondence:
    """The patches or pixels that are nearest, one a row and column."""
    return np.ascontiguousarray(np.moveaxis(np.rint(match), 0, 2).astype(np.uint32))


@dataclass
class PatchSolver(Solver):
    """Alternating patch search and voting, [Kwatra2005]_; the control of the result is always the target's."""

    effort: Effort
    last_vote: str
    """``copy``: each pixel is one of those that the patches over it propose; ``mean``: their average"""

    def __post_init__(self) -> None:
        self.channels = self.inputs.texture.shape[2] + self.inputs.control.shape[2]

    def rounds(self, match: Match, scale: Scale, random: np.random.Generator) -> Rounds:
        """Improve ``match`` in place, round by round."""
        exemplar, control = self._exemplar(scale), self._control(scale)
        variance = local_variance(resize(self.inputs.texture, *scale.exemplar))
        search = Search(
            exemplar, self.channels, self.patch_size, scale.places, scale.patches, self.wrap,
            self.occurrence * variance, _OVERUSE, expected=self._expected(scale),
        )  # fmt: skip
        while True:
            yield search.step(self._vote(match, exemplar, control), match, self.effort, random)

    def _expected(self, scale: Scale) -> Float32[np.ndarray, "p q"]:
        """Use of each exemplar patch that control asks for."""
        middle = tuple(slice(self.patch_size // 2, self.patch_size // 2 + count) for count in scale.places)
        return self.inputs.expected(scale, self.patch_size)[middle]

    def picture(self, match: Match, scale: Scale) -> tuple[Image, Correspondence]:
        """The result at a scale, all channels, linear; and where its pixels come from."""
        size, wrap, small = self.patch_size, self.wrap, self.inputs.pixels(scale)
        if self.last_vote == "mean":
            pixels = vote_pixels(match, small.pixels, window(size, _SIGMA), wrap)
            return small.elsewhere(pixels), correspondence.to_pixels(match, size, wrap)
        exemplar = self._exemplar(scale)
        target = self._vote(match, exemplar, self._control(scale))
        source = copy_vote(match, target, exemplar, self.channels, size, _REACH, wrap)
        return small.elsewhere(small.pixels[source[..., 0], source[..., 1]]), source.astype(np.uint32)

    def _exemplar(self, scale: Scale) -> np.ndarray:
        """Fixed-point features of texture and control, (h, w * channels)."""
        planes = np.concatenate([self.inputs.texture, self.inputs.control], axis=2)
        return np.asarray(fixed_point(resize(planes, *scale.exemplar)))

    def _control(self, scale: Scale) -> np.ndarray:
        """Fixed-point features of the target's control, (H, W, k), padded by a patch less one where it wraps."""
        planes = self.inputs.wanted(scale)
        if self.wrap:
            beyond = [(0, extra) for extra in self.wrap.where_closed(self.patch_size - 1)]
            planes = np.pad(planes, [*beyond, (0, 0)], mode="wrap")
        return np.asarray(fixed_point(planes).reshape(planes.shape))

    def _vote(self, match: Patches, exemplar: np.ndarray, control: np.ndarray) -> np.ndarray:
        """The mean vote, with the control of the target."""
        target: np.ndarray = mean_vote(match, exemplar, self.channels, self.patch_size, self.wrap)
        target.reshape(len(control), -1, self.channels)[..., self.inputs.texture.shape[2] :] = control
        return target


@dataclass
class PixelSolver(Solver):
    """Single pixels are chosen to continue their neighbours; see `DiscreteSolver`."""

    tries: int
    """random places that a pixel tries, but at the last scale"""
    scales: Sequence[Scale]
    """all of the run"""
    neighbourhoods: dict[int, ScaledExemplar] = field(default_factory=dict, init=False)
    """the exemplar at the current scale"""

    def rounds(self, match: Match, scale: Scale, random: np.random.Generator) -> Rounds:
        """Improve ``match`` in place, round by round."""
        solver = self._solver(scale)
        last = scale.level == len(self.scales)
        source = self._begun(np.ascontiguousarray(np.moveaxis(match, 0, 2)), scale, random)
        for number in itertools.count():
            progress = solver(source, 0 if last else self.tries, last or number % 2 == 1, random)
            match[:] = np.moveaxis(source, 2, 0)
            yield progress

    def _begun(self, source: Sources, scale: Scale, random: np.random.Generator) -> Sources:
        """The sources that a scale begins with; a smooth target has no lines that the one before may have lost."""
        if scale.level == 1 or self.inputs.blurred:
            return source
        exemplar = self._neighbourhoods(scale)
        return reseeded(source, exemplar.texture, exemplar.control, self.inputs.wanted(scale), random)

    def _solver(self, scale: Scale) -> DiscreteSolver:
        exemplar, control = self._neighbourhoods(scale), self.inputs.wanted(scale)
        use, period = self.inputs.use_at(scale), self.inputs.period(scale)
        return DiscreteSolver(exemplar, control, self.occurrence, self.wrap, use, period)

    def _neighbourhoods(self, scale: Scale) -> ScaledExemplar:
        """The exemplar at a scale, cached for the next one."""
        if scale.level not in self.neighbourhoods:
            coarser = None
            if scale.level > 1 and scale.exemplar[0] * scale.exemplar[1] > LARGEST:
                coarser = self._neighbourhoods(self.scales[scale.level - 2])
            texture, control = (resize(p, *scale.exemplar) for p in (self.inputs.texture, self.inputs.control))
            self.neighbourhoods = {scale.level: ScaledExemplar.of(texture, control, coarser)}
        return self.neighbourhoods[scale.level]

    def picture(self, match: Match, scale: Scale) -> tuple[Image, Correspondence]:
        """The result at a scale, all channels, linear; and where its pixels come from."""
        small = self.inputs.pixels(scale)
        return small.elsewhere(small.pixels[match[0], match[1]]), nearest(match)


@dataclass
class OrientedSolver(PixelSolver):
    """Pixels of an oriented texture, from places between the exemplar's pixels."""

    jacobian: Jacobian
    """of the texture in the result; see `Frames`"""

    def _frames(self, scale: Scale) -> Frames:
        return Frames.of(self.jacobian, *scale.target)

    def from_pixels(self, start: Correspondence, scale: Scale) -> Match:
        """A correspondence of full size at a scale."""
        return at_scale(start, scale.factor, scale.patches, scale.places)

    def _begun(self, source: Sources, scale: Scale, random: np.random.Generator) -> Sources:  # noqa: ARG002
        """The sources that a scale begins with: as they are, since rotated pieces are not laid."""
        return source

    def _laid(self, corner: np.ndarray, offset: np.ndarray, side: int, scale: Scale) -> Match:
        """Places at ``offset`` from the ``corner`` of a block that is rotated about its centre."""
        middle = side // 2
        return clipped(corner + (self._frames(scale).to_exemplar(offset - middle) + middle), scale.places)

    def finer(self, match: Match, scale: Scale, growth: float) -> Match:
        """The match of the scale before, ``growth`` times coarser, at this scale."""
        return self._frames(scale).finer(match, growth, scale.places)

    def _solver(self, scale: Scale) -> DiscreteSolver:
        exemplar, control = self._neighbourhoods(scale), self.inputs.wanted(scale)
        use, period = self.inputs.use_at(scale), self.inputs.period(scale)
        return OrientedDiscreteSolver(
            exemplar, control, self.occurrence, self.wrap, use, period, self._frames(scale)
        )

    def picture(self, match: Match, scale: Scale) -> tuple[Image, Correspondence]:
        """The result at a scale, all channels, linear; and where its pixels come from."""
        return interpolated_along(self.inputs.pixels(scale), match, self._frames(scale).jacobian), nearest(match)
