"""Discrete synthesis under control: pixels are copied one by one, by k-coherence, from coarse to fine."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32

from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.numerics.matrices import eigenvectors, row_product, square_sums
from texloom.stages.synthesis.reconstruction.expected_use import expected_use
from texloom.stages.synthesis.reconstruction.local_variance import local_variance
from texloom.stages.synthesis.reconstruction.oriented_places import Frames
from texloom.stages.vocabulary.facts import Wraps

_RADIUS = 2  # of a neighbourhood, px
_SIDE = 2 * _RADIUS + 1
_UNIT = 4  # steps of a neighbourhood's vector per CIELAB unit
_CANDIDATES = 4  # similar pixels of a pixel
_MIN_SEPARATION = 3  # px between a pixel and its candidates, more than
_SEARCH_DIMENSIONS = 8  # in which candidates are searched
_SEARCH_TOLERANCE = (
    3.0  # share by which they may be farther than the nearest; five times as fast as an exact search
)
LARGEST = 2**14
"""px of an exemplar up to which candidates are searched"""

_SAMPLES = 2**12  # neighbourhoods that the principal components are found from
_SEAM_PENALTY = 2.0  # a pixel, for continuing none of the eight neighbours; as the others in `local_variance`
_MOMENTUM = 0.9  # weight of the past use in penalties; without, all pixels would leave a place at once
_SINGLE = 0.3  # weight of a pixel's own use beside that around it; without, single pixels would repeat
_REPEAT_PENALTY = 0.25  # a pixel, for each other pixel near it that has the same source
_REPEAT_REACH = 8  # px; a source should occur once as near
_MERGE_DISTANCE = np.float32(0.5)  # px by which continuations of oriented neighbours may differ and still be one
_PIECES = 16

Sources: TypeAlias = Int32[np.ndarray, "H W 2"] | Float32[np.ndarray, "H W 2"]
"""where pixels come from: exemplar pixels, or places between them"""


@dataclass(frozen=True)
class ScaledExemplar:
    """An exemplar at one scale, as the search sees it."""

    texture: Float32[np.ndarray, "h w c"]
    control: Float32[np.ndarray, "h w k"]
    vectors: Int16[np.ndarray, "rows half"]
    basis: Float32[np.ndarray, "n d"]
    candidates: Int32[np.ndarray, "h w s 2"]

    @classmethod
    def of(
        cls,
        texture: Float32[np.ndarray, "h w c"],
        control: Float32[np.ndarray, "h w k"],
        coarser: "ScaledExemplar | None",
    ) -> "ScaledExemplar":
        """Principal components of the neighbourhoods, and candidates that are similar in them.

        Candidates are searched, or taken over from the next ``coarser`` scale.
        """
        from texloom.stages.kernels.kcoherence.discrete_pixels import DIMENSIONS
        from texloom.stages.kernels.kcoherence.discrete_pixels import LARGEST as LIMIT

        height, width = texture.shape[:2]
        planes = np.concatenate([texture, control], axis=2)
        padded = np.pad(planes, ((_RADIUS, _RADIUS), (_RADIUS, _RADIUS), (0, 0)), mode="edge")
        parts = [padded[dy : dy + height, dx : dx + width] for dy in range(_SIDE) for dx in range(_SIDE)]
        step = max(1, int(np.sqrt(height * width / _SAMPLES)))
        some = np.concatenate([part[::step, ::step] for part in parts], axis=2).astype(np.float64)
        some = some.reshape(-1, some.shape[2])
        _, directions = eigenvectors(square_sums(some - some.mean(axis=0)))
        strongest = directions[:, ::-1][:, :DIMENSIONS]
        basis = np.zeros((len(strongest), DIMENSIONS), np.float32)
        basis[:, : strongest.shape[1]] = _UNIT * strongest
        vectors = np.zeros((height, width, DIMENSIONS), np.float32)
        for part, rows in zip(parts, np.split(basis, len(parts)), strict=True):
            vectors += row_product(part.reshape(-1, part.shape[2]), rows).reshape(vectors.shape)
        candidates = _candidates(vectors) if coarser is None else _rescaled(coarser.candidates, (height, width))
        rounded = np.clip(np.rint(vectors), -LIMIT, LIMIT).astype(np.int16).reshape(-1, DIMENSIONS // 2)
        return cls(np.ascontiguousarray(texture), control, rounded, basis, candidates)


def _candidates(vectors: Float32[np.ndarray, "h w d"]) -> Int32[np.ndarray, "h w s 2"]:
    """Similar pixels that are not next to a pixel; the pixel itself where there are none."""
    spatial = loaded("scipy.spatial")
    height, width = vectors.shape[:2]
    flat = np.ascontiguousarray(vectors.reshape(height * width, -1)[:, :_SEARCH_DIMENSIONS])
    count = min(len(flat), 4 * _CANDIDATES)
    tree = spatial.KDTree(flat, balanced_tree=False, compact_nodes=False)
    matches = tree.query(flat, k=count, eps=_SEARCH_TOLERANCE, workers=thread_count())[1].reshape(len(flat), count)
    own = np.arange(len(flat))[:, None]
    near = (
        np.maximum(np.abs(matches // width - own // width), np.abs(matches % width - own % width))
        <= _MIN_SEPARATION
    )
    order = np.argsort(near, axis=1, kind="stable")[:, :_CANDIDATES]
    chosen = np.where(np.take_along_axis(near, order, 1), own, np.take_along_axis(matches, order, 1))
    return np.stack(np.divmod(chosen, width), axis=2).astype(np.int32).reshape(height, width, -1, 2)


def _rescaled(coarse: Int32[np.ndarray, "p q s 2"], size: tuple[int, int]) -> Int32[np.ndarray, "h w s 2"]:
    """Candidates of a coarser scale at a finer one, by their displacements."""
    growth = np.array(size) / coarse.shape[:2]
    own = np.indices(size).transpose(1, 2, 0)
    parent = np.minimum(((own + 0.5) / growth).astype(np.int64), np.array(coarse.shape[:2]) - 1)
    shift = coarse[parent[..., 0], parent[..., 1]] - parent[:, :, None]
    moved = own[:, :, None] + np.rint(shift * growth).astype(np.int64)
    return np.clip(moved, 0, np.array(size) - 1).astype(np.int32)


class DiscreteSolver:
    """Choice of the sources of one target's pixels at one scale.

    Without an occurrence penalty smooth places win: they are near to everything, so that detail is lost and single
    pixels repeat ([Kaspar2015]_ section 3.2 has that of patches). Here a place that serves as many pixels as it
    should costs ``occurrence`` times the `local_variance`; see `expected_use`. Few places that control asks for
    often would still repeat in rows; therefore a source costs more near copies of itself. Places ``period`` px
    apart are the same place of a toroidal exemplar.
    """

    def __init__(
        self,
        exemplar: ScaledExemplar,
        control: Float32[np.ndarray, "H W k"],
        occurrence: float,
        wrap: Wraps,
        use: Float32[np.ndarray, "h w"] | None = None,
        period: tuple[int, int] | None = None,
    ):
        self.exemplar, self.period = exemplar, period
        self.control = np.ascontiguousarray(control)
        self.scale = _SIDE**2 * _UNIT**2
        unit = local_variance(exemplar.texture) * self.scale
        expected = self._of_all_copies(expected_use(exemplar.control, control, _SIDE, use))
        self.penalty_per_use = occurrence * unit / expected
        self.seam_penalty = np.int64(_SEAM_PENALTY * unit / 8)
        self.repeat_penalty = np.int64(_REPEAT_PENALTY * unit)
        self.wrap = wrap
        self.use: Float32[np.ndarray, "h w"] | None = None

    def _penalty(self, source: Sources) -> np.ndarray:
        ndimage = loaded("scipy.ndimage")
        height, width = self.exemplar.texture.shape[:2]
        rows, columns = np.moveaxis(self.pixels(source).astype(np.int64), 2, 0)
        places = rows * width + columns
        use = np.bincount(places.ravel(), minlength=height * width).reshape(height, width).astype(np.float32)
        use = self._of_all_copies(
            (1 - _SINGLE) * ndimage.uniform_filter(use, _SIDE, mode="nearest") + _SINGLE * use
        )
        self.use = use if self.use is None else _MOMENTUM * self.use + (1 - _MOMENTUM) * use
        return np.asarray(np.rint(np.minimum(self.use * self.penalty_per_use, 2.0**50)), np.int64)

    @functools.cached_property
    def _places(self) -> Int32[np.ndarray, "h w"]:
        """Numbers of the exemplar's pixels; those that are the same place share one."""
        height, width = self.exemplar.texture.shape[:2]
        down, across = self.period or (height, width)
        rows, columns = np.arange(height, dtype=np.int32) % down, np.arange(width, dtype=np.int32) % across
        return rows[:, None] * np.int32(width) + columns

    def _of_all_copies(self, use: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """The sum of a use over all places that are the same one of a toroidal exemplar."""
        for axis, period in enumerate(self.period or ()):
            wide = np.pad(use, [(period, period) if side == axis else (0, 0) for side in (0, 1)])
            use = sum(
                np.take(wide, range(first, first + use.shape[axis]), axis) for first in (0, period, 2 * period)
            )
        return use

    def __call__(
        self,
        source: Sources,
        tries: int,
        edges_only: bool,
        random: np.random.Generator,
    ) -> tuple[float, float, float]:
        """Let every pixel choose once, in four subpasses; ``source`` is changed.

        Parameters
        ----------
        tries : random places that a pixel tries.
        edges_only : pixels that continue all their neighbours stay.

        Returns
        -------
        energy and, of it, the occurrence penalty, CIELAB units squared, means of those pixels that chose; share of
        the pixels that changed.
        """
        from texloom.stages.kernels.kcoherence.discrete_pixels import ParityPass

        before = source.copy()
        parts: list[tuple[int, int, int]] = []
        for parity in range(4):
            penalty = self._penalty(source)
            new = source.copy()
            key = random.integers(2**64, dtype=np.uint64)
            subpass = ParityPass(parity, tries, self.seam_penalty, edges_only, self.wrap, key)
            kernel, exemplar = self._kernel(penalty, source)
            arguments = (source, new, self.control, *exemplar, subpass)
            parts += run_spans(kernel, arguments, source.shape[0], _PIECES)
            source[:] = new
        energy, penalties, chosen = (sum(column) for column in zip(*parts, strict=True))
        changed = float((self.pixels(source) != self.pixels(before)).any(axis=2).mean())
        share = 1 / (max(chosen, 1) * self.scale)
        return energy * share, penalties * share, changed

    def pixels(self, source: Sources) -> np.ndarray:
        """The exemplar pixels that are nearest to sources."""
        return source

    def _kernel(self, penalty: np.ndarray, source: Sources) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """The kernel, and its arguments between the target's control and the subpass."""
        from texloom.stages.kernels.kcoherence.discrete_pixels import (
            ExemplarNeighbourhoods,
            Repeats,
            choose_sources,
        )

        own = self.exemplar
        exemplar = ExemplarNeighbourhoods(own.texture, own.vectors, own.basis, own.candidates, penalty, _RADIUS)
        used = self._places[source[..., 0], source[..., 1]]
        for axis, around in enumerate(self.wrap):
            beyond = [(_REPEAT_REACH, _REPEAT_REACH) if axis == side else (0, 0) for side in (0, 1)]
            used = np.pad(used, beyond, mode="wrap") if around else np.pad(used, beyond, constant_values=-1)
        repeats = Repeats(self._places, used, _REPEAT_REACH, self.repeat_penalty)
        return choose_sources, (exemplar, repeats)


class OrientedDiscreteSolver(DiscreteSolver):
    """Choice of the sources of an oriented target's pixels, which lie between pixels of the exemplar."""

    def __init__(
        self,
        exemplar: ScaledExemplar,
        control: Float32[np.ndarray, "H W k"],
        occurrence: float,
        wrap: Wraps,
        use: Float32[np.ndarray, "h w"] | None,
        period: tuple[int, int] | None,
        frames: Frames,
    ):
        super().__init__(exemplar, control, occurrence, wrap, use, period)
        self.frames = frames
        self.texture = fixed_point(exemplar.texture)
        self.vectors = exemplar.vectors.reshape(len(exemplar.texture), -1)
        channels = exemplar.texture.shape[2]
        unit = np.ones((_SIDE**2, channels + control.shape[2], 1), np.float32)
        unit[:, :channels] /= UNIT
        self.basis = exemplar.basis * unit.reshape(-1, 1)

    def pixels(self, source: Sources) -> np.ndarray:
        """The exemplar pixels that are nearest to sources."""
        return np.asarray(np.rint(source))

    def _kernel(self, penalty: np.ndarray, source: Sources) -> tuple[Callable[..., Any], tuple[Any, ...]]:  # noqa: ARG002
        """See `DiscreteSolver`; repeats are not penalised."""
        from texloom.stages.kernels.kcoherence.discrete_pixels import ExemplarNeighbourhoods
        from texloom.stages.kernels.kcoherence.oriented_discrete import Orientation, choose_oriented_sources

        candidates = self.exemplar.candidates
        exemplar = ExemplarNeighbourhoods(self.texture, self.vectors, self.basis, candidates, penalty, _RADIUS)
        orientation = Orientation(self.frames.jacobian, self.frames.inverse, _MERGE_DISTANCE)
        return choose_oriented_sources, (exemplar, orientation)
