"""Discrete synthesis under control: pixels are copied one by one, by k-coherence, from coarse to fine."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Int16, Int32

from texloom.stages.common.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.synthesis._kcoherence.evenness import expected_use
from texloom.stages.synthesis._kcoherence.frames import Frames

_RADIUS = 2  # of a neighbourhood, px
_SIDE = 2 * _RADIUS + 1
_UNIT = 4  # steps of a neighbourhood's vector per CIELAB unit
_SIMILAR = 4  # places that look like a pixel
_APART = 3  # px between a pixel and places that look like it, more than
_SEARCHED = 8  # dimensions in which such places are searched
_INEXACT = 3.0  # share by which they may be farther than the nearest; five times as fast as an exact search
LARGEST = 2**14
"""px of an exemplar up to which places that look alike are searched"""

_SAMPLES = 2**12  # neighbourhoods that the dimensions are found from
_BROKEN = 80.0  # CIELAB units squared a pixel: what it costs to continue none of the eight neighbours
_LAG = 0.9  # weight of the past in the use that prices follow; without, all would leave a place at once
_SINGLE = 0.3  # weight of a pixel's own use beside that of all around it; without, single pixels would repeat
_TOGETHER = np.float32(0.5)  # px by which what turned neighbours continue may differ and still be one place
_PIECES = 16

Sources: TypeAlias = Int32[np.ndarray, "H W 2"] | Float32[np.ndarray, "H W 2"]
"""where pixels come from: exemplar pixels, or places between them"""


@dataclass(frozen=True)
class Neighbourhoods:
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
        coarser: "Neighbourhoods | None",
    ) -> "Neighbourhoods":
        """Principal components of the neighbourhoods, and the places that look alike in them.

        Such places are searched, or taken over from the next ``coarser`` scale.
        """
        from texloom.stages.kernels.kcoherence.discrete import DIMENSIONS
        from texloom.stages.kernels.kcoherence.discrete import LARGEST as FARTHEST

        height, width = texture.shape[:2]
        planes = np.concatenate([texture, control], axis=2)
        padded = np.pad(planes, ((_RADIUS, _RADIUS), (_RADIUS, _RADIUS), (0, 0)), mode="edge")
        parts = [padded[dy : dy + height, dx : dx + width] for dy in range(_SIDE) for dx in range(_SIDE)]
        step = max(1, int(np.sqrt(height * width / _SAMPLES)))
        some = np.concatenate([part[::step, ::step] for part in parts], axis=2).astype(np.float64)
        _, directions = np.linalg.eigh(np.cov(some.reshape(-1, some.shape[2]).T))
        strongest = directions[:, ::-1][:, :DIMENSIONS]
        basis = np.zeros((len(strongest), DIMENSIONS), np.float32)
        basis[:, : strongest.shape[1]] = _UNIT * strongest
        vectors = np.zeros((height, width, DIMENSIONS), np.float32)
        for part, rows in zip(parts, np.split(basis, len(parts)), strict=True):
            vectors += part @ rows
        candidates = _similar(vectors) if coarser is None else _carried(coarser.candidates, (height, width))
        held = np.clip(np.rint(vectors), -FARTHEST, FARTHEST).astype(np.int16).reshape(-1, DIMENSIONS // 2)
        return cls(np.ascontiguousarray(texture), control, held, basis, candidates)


def _similar(vectors: Float32[np.ndarray, "h w d"]) -> Int32[np.ndarray, "h w s 2"]:
    """Near places that are not next to a pixel; the pixel itself where there are none."""
    from scipy.spatial import KDTree

    height, width = vectors.shape[:2]
    flat = np.ascontiguousarray(vectors.reshape(height * width, -1)[:, :_SEARCHED])
    count = min(len(flat), 4 * _SIMILAR)
    tree = KDTree(flat, balanced_tree=False, compact_nodes=False)
    found = tree.query(flat, k=count, eps=_INEXACT, workers=thread_count())[1].reshape(len(flat), count)
    own = np.arange(len(flat))[:, None]
    near = np.maximum(np.abs(found // width - own // width), np.abs(found % width - own % width)) <= _APART
    order = np.argsort(near, axis=1, kind="stable")[:, :_SIMILAR]
    chosen = np.where(np.take_along_axis(near, order, 1), own, np.take_along_axis(found, order, 1))
    return np.stack(np.divmod(chosen, width), axis=2).astype(np.int32).reshape(height, width, -1, 2)


def _carried(coarse: Int32[np.ndarray, "p q s 2"], size: tuple[int, int]) -> Int32[np.ndarray, "h w s 2"]:
    """Places that look alike, taken over from a coarser scale by their displacements."""
    growth = np.array(size) / coarse.shape[:2]
    own = np.indices(size).transpose(1, 2, 0)
    parent = np.minimum(((own + 0.5) / growth).astype(np.int64), np.array(coarse.shape[:2]) - 1)
    shift = coarse[parent[..., 0], parent[..., 1]] - parent[:, :, None]
    moved = own[:, :, None] + np.rint(shift * growth).astype(np.int64)
    return np.clip(moved, 0, np.array(size) - 1).astype(np.int32)


class Movement:
    """Pixels of one target that move at one scale.

    Without a price on use, smooth places win: they are near to everything, so that detail is lost and single pixels
    repeat ([Kaspar2015]_ section 3.2 has that of patches). Here a place that serves as many pixels as it should
    costs ``occurrence``, CIELAB units squared a pixel; see `expected_use`.
    """

    def __init__(
        self, exemplar: Neighbourhoods, given: Float32[np.ndarray, "H W k"], occurrence: float, wrap: bool
    ):
        self.exemplar = exemplar
        self.given = np.ascontiguousarray(given)
        self.scale = _SIDE**2 * _UNIT**2
        self.price_per_use = occurrence * self.scale / expected_use(exemplar.control, given, _SIDE)
        self.broken = np.int64(_BROKEN * self.scale / 8)
        self.wrap = wrap
        self.use: Float32[np.ndarray, "h w"] | None = None

    def _price(self, source: Sources) -> np.ndarray:
        from scipy.ndimage import uniform_filter

        height, width = self.exemplar.texture.shape[:2]
        rows, columns = np.moveaxis(self.pixels(source).astype(np.int64), 2, 0)
        places = rows * width + columns
        use = np.bincount(places.ravel(), minlength=height * width).reshape(height, width).astype(np.float32)
        use = (1 - _SINGLE) * uniform_filter(use, _SIDE, mode="nearest") + _SINGLE * use
        self.use = use if self.use is None else _LAG * self.use + (1 - _LAG) * use
        return np.asarray(np.rint(np.minimum(self.use * self.price_per_use, 2.0**50)), np.int64)

    def __call__(
        self,
        source: Sources,
        tries: int,
        edges_only: bool,
        random: np.random.Generator,
    ) -> tuple[float, float, float]:
        """Let every pixel choose once, in four turns; ``source`` is changed.

        Parameters
        ----------
        tries : random places that a pixel tries.
        edges_only : pixels that continue all their neighbours stay.

        Returns
        -------
        energy and, of it, the price of use, CIELAB units squared, means of those pixels that chose; share of the
        pixels that changed.
        """
        kernel = self._kernel()
        before = source.copy()
        energy, paid, chosen = 0, 0, 0
        for parity in range(4):
            price = self._price(source)
            new = source.copy()
            key = random.integers(2**64, dtype=np.uint64)
            turn = (parity, tries, self.broken, edges_only, self.wrap, key)
            found = run_spans(kernel, (source, new, *self._known(price), *turn), source.shape[0], _PIECES)
            energy += sum(part[0] for part in found)
            paid += sum(part[1] for part in found)
            chosen += sum(part[2] for part in found)
            source[:] = new
        changed = float((self.pixels(source) != self.pixels(before)).any(axis=2).mean())
        share = 1 / (max(chosen, 1) * self.scale)
        return energy * share, paid * share, changed

    def pixels(self, source: Sources) -> np.ndarray:
        """The exemplar pixels that are nearest to sources."""
        return source

    def _kernel(self) -> Callable[..., Any]:
        """Moves pixels; takes sources before and after, `_known`, and what changes from turn to turn."""
        from texloom.stages.kernels.kcoherence.discrete import move_pixels

        kernel: Callable[..., Any] = move_pixels
        return kernel

    def _known(self, price: np.ndarray) -> tuple[Any, ...]:
        """What the kernel takes of exemplar and target."""
        known = self.exemplar
        return known.texture, self.given, known.vectors, known.basis, known.candidates, price, _RADIUS


class TurnedMovement(Movement):
    """Pixels of a target whose texture turns; their sources lie between pixels of the exemplar."""

    def __init__(
        self,
        exemplar: Neighbourhoods,
        given: Float32[np.ndarray, "H W k"],
        occurrence: float,
        wrap: bool,
        frames: Frames,
    ):
        super().__init__(exemplar, given, occurrence, wrap)
        self.frames = frames
        self.texture = fixed_point(exemplar.texture)
        self.vectors = exemplar.vectors.reshape(len(exemplar.texture), -1)
        channels = exemplar.texture.shape[2]
        unit = np.ones((_SIDE**2, channels + given.shape[2], 1), np.float32)
        unit[:, :channels] /= UNIT
        self.basis = exemplar.basis * unit.reshape(-1, 1)

    def pixels(self, source: Sources) -> np.ndarray:
        """The exemplar pixels that are nearest to sources."""
        return np.asarray(np.rint(source))

    def _kernel(self) -> Callable[..., Any]:
        from texloom.stages.kernels.kcoherence.oriented_discrete import move_turned

        kernel: Callable[..., Any] = move_turned
        return kernel

    def _known(self, price: np.ndarray) -> tuple[Any, ...]:
        return (
            self.texture, self.exemplar.texture.shape[2], self.given, self.vectors, self.basis,
            self.exemplar.candidates, price, self.frames.jacobian, self.frames.inverse, _RADIUS, _TOGETHER,
        )  # fmt: skip
