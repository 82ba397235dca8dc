"""One level of inverse texture synthesis: its data, the two matches, and the choice of the compaction's pixels."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32, Int64

from texloom.stages.analysis.similarity.k_coherence import Candidates, KCoherenceParams, similar_places
from texloom.stages.analysis.similarity.tsvq import Leaf, Nodes, TsvqParams, cut, grow
from texloom.stages.common.similarity.neighbourhoods import UNIT, Components, fixed_point, places, whole
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.core.threads import run_all, run_spans, spans

_PIECES = 16  # of work that threads share; any number gives the same result
_PASSES = 2  # rounds of propagation
_NEGLIGIBLE = 0.4  # change of what a pixel should be, CIELAB units, for which none is chosen anew
_SIMILAR = 0.1  # change of the weight of that, relative to it, likewise

Source: TypeAlias = Int32[np.ndarray, "2 H W"]
"""rows and columns of the texture pixels that a compaction is copied from"""

Places: TypeAlias = Int32[np.ndarray, "2 p q"]
"""rows and columns of neighbourhoods, by their top-left pixels"""


@dataclass(frozen=True)
class Tree:
    """Clusters and similarity sets of one level's neighbourhoods."""

    nodes: Nodes
    leaf: Leaf
    candidates: Candidates


class TextureLevel:
    """A texture at one resolution.

    Parameters
    ----------
    features : what neighbourhoods are compared by, CIELAB units.
    size : side of a neighbourhood, px.
    step : px between the texture's neighbourhoods that count, along both sides.
    tree : of ``features`` where it is known; else it is made.
    inside : the pixels that are part of a texture; None for all.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        size: int,
        step: int,
        tree: Tree | None,
        clusters: TsvqParams,
        coherence: KCoherenceParams,
        inside: Bool[np.ndarray, "h w"] | None = None,
    ):
        self.height, self.width, self.channels = features.shape
        self.size, self.step = size, step
        self.inside = np.full((self.height, self.width), True) if inside is None else np.ascontiguousarray(inside)
        self.pixels = fixed_point(features)
        self.components = Components.of(self.pixels, self.channels, size)
        self.places = places(self.height, self.width, size)
        if tree is None:
            grown = grow(self.vectors, whole(self.inside, size), self.components.unit, clusters)
            candidates = similar_places(self.vectors, grown.nodes, grown.leaf, size // 2, coherence)
            tree = Tree(grown.nodes, grown.leaf, candidates)
        self.tree = tree
        self.grid = (-(-self.places[0] // step), -(-self.places[1] // step))
        self.counted = tree.leaf[::step, ::step] >= 0
        self._centres: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def shape(self) -> Any:
        """Of a neighbourhood."""
        from texloom.stages.kernels.patchmatch.search import PatchShape

        return PatchShape.of(self.size, self.channels)

    @cached_property
    def vectors(self) -> Int16[np.ndarray, "n 32"]:
        """Those of all neighbourhoods, row by row."""
        return self.components.vectors(self.pixels)

    def copy(self, source: Source) -> Int16[np.ndarray, "H Wc"]:
        """The compaction's features."""
        planes = self.pixels.reshape(self.height, self.width, self.channels)[source[0], source[1]]
        return np.ascontiguousarray(planes.reshape(planes.shape[0], -1))

    def centres(self, clusters: int) -> tuple[np.ndarray, np.ndarray]:
        """Vectors of the centres of at most ``clusters`` clusters, and the cluster of every place of the grid.

        -1 where there is no neighbourhood.
        """
        if clusters not in self._centres:
            leaf = self.tree.leaf[:: self.step, :: self.step][self.counted]
            nodes, numbers = np.unique(cut(self.tree.nodes, clusters)[leaf], return_inverse=True)
            row, column = self.tree.nodes[nodes, 2], self.tree.nodes[nodes, 3]
            cluster = np.full(self.grid, -1)
            cluster[self.counted] = numbers
            medoids = row.astype(np.int64) * self.places[1] + column
            self._centres[clusters] = self.components.vectors_at(self.pixels, medoids), cluster
        return self._centres[clusters]


def nearest_in(allowed: Bool[np.ndarray, "h w"], wanted: np.ndarray) -> Int32[np.ndarray, "2 H W"]:
    """The allowed place nearest to each of ``wanted``, (2, H, W) rows and columns that may lie outside."""
    limit = np.array(allowed.shape)[:, None, None] - 1
    clipped = np.clip(wanted, 0, limit).astype(np.int32)
    if allowed[clipped[0], clipped[1]].all():
        return clipped
    ndimage = loaded("scipy.ndimage")
    rows, columns = ndimage.distance_transform_edt(~allowed, return_distances=False, return_indices=True)
    return np.stack([rows[clipped[0], clipped[1]], columns[clipped[0], clipped[1]]]).astype(np.int32)


def nearest(vectors: Int16[np.ndarray, "n 32"], others: Int16[np.ndarray, "m 32"]) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """For each of ``vectors`` the index of the nearest of ``others``, the first of equal ones.

    Components are whole numbers of at most 2047. The more the first components differ, the less is searched.
    """
    from texloom.stages.kernels.compaction.nearest_vectors import nearest_vectors
    from texloom.stages.kernels.compaction.tree import HALF

    order = np.argsort(others[:, 0], kind="stable")
    ordered = others[order].reshape(-1, HALF)
    indices = np.empty(len(vectors), np.int64)
    halves = np.ascontiguousarray(vectors).reshape(-1, HALF)
    run_spans(nearest_vectors, (halves, ordered, order, indices), len(vectors), _PIECES)
    return indices


class Matching:
    """A compaction at one level, and its two matches with the texture.

    Parameters
    ----------
    alpha, completeness : weights of the forward and of the inverse term.
    seams : weight of the visibility of seams, where pixels from different places meet.
    wrap : the compaction is a torus, and a neighbourhood begins at every pixel.

    Attributes
    ----------
    source : where its pixels come from.
    values : its features; those of a torus are padded by a neighbourhood less one pixel.
    inverse : the place in the compaction of every place of the texture's grid.
    forward : the place in the texture of every place in the compaction.
    moved : the places in the compaction that differ from when matches were last sought.
    """

    def __init__(
        self,
        level: TextureLevel,
        source: Source,
        alpha: float,
        seams: float,
        completeness: float = 1.0,
        wrap: bool = False,
    ):
        self.level, self.alpha, self.seams, self.completeness = level, alpha, seams, completeness
        self.wrap, self.extra = wrap, level.size - 1 if wrap else 0
        self.source: Source = source
        padded = self._whole(source)
        self.values: Int16[np.ndarray, "P Qc"] = level.copy(padded)
        self.places = places(padded.shape[1], padded.shape[2], level.size)
        self.inverse: Places | None = None
        middle = level.size // 2
        inner = padded[:, middle : middle + self.places[0], middle : middle + self.places[1]] - middle
        self.forward: Places = nearest_in(level.tree.leaf >= 0, inner)
        self.inverse_distance = np.empty(level.grid, np.int64)
        self.forward_distance = np.empty(self.places, np.int64)
        self.moved = np.full(self.places, True)
        self._active = np.full(source.shape[1:], True)
        self._wanted = np.full((*source.shape[1:], level.channels), np.inf, np.float32)
        self._weights = np.zeros(source.shape[1:], np.float32)

    def _whole(self, planes: np.ndarray) -> np.ndarray:
        """(n, H, W) planes, those of a torus padded so that every neighbourhood is whole."""
        extra = (0, self.extra)
        return np.pad(planes, ((0, 0), extra, extra), mode="wrap")

    def energy(self) -> tuple[float, float, float]:
        """The energy's terms: inverse, forward [Wei2008]_ (1), and seams; squared CIELAB units a pixel."""
        from texloom.stages.kernels.compaction.solver import seam_sum

        unit = UNIT**2 * self.level.size**2
        inverse = self.completeness * float(self.inverse_distance[self.level.counted].mean()) / unit
        forward = self.alpha * float(self.forward_distance.mean()) / unit
        if self.seams == 0:
            return inverse, forward, 0.0
        visible = seam_sum(self.level.pixels, self.level.channels, self.wrap, self.source)
        return inverse, forward, self.seams * visible / (2 * UNIT**2 * self.source[0].size)

    @property
    def _of_texture(self) -> Any:
        """The texture's neighbourhoods, with matches in the compaction."""
        from texloom.stages.kernels.compaction.solver import MatchedNeighbourhoods

        level = self.level
        return MatchedNeighbourhoods(level.shape, level.pixels, self.values, level.step)

    @property
    def _of_compaction(self) -> Any:
        """The compaction's neighbourhoods, with matches in the texture."""
        from texloom.stages.kernels.compaction.solver import MatchedNeighbourhoods

        return MatchedNeighbourhoods(self.level.shape, self.values, self.level.pixels, 1)

    def match_inverse(self, proposed: Places) -> None:
        """Keep the better of the inverse match and ``proposed``, and let neighbours propose their continuation."""
        from texloom.stages.kernels.compaction.solver import improve_match, propagate_match

        level, neighbourhoods = self.level, self._of_texture
        old = proposed if self.inverse is None else self.inverse
        match = old.copy()
        arguments: tuple[Any, ...] = (neighbourhoods, proposed, self.moved, match, self.inverse_distance)
        run_spans(improve_match, arguments, level.grid[0], _PIECES)
        changed = (match != old).any(axis=0) | self.moved[match[0], match[1]]
        for _ in range(_PASSES):
            old = match.copy()
            arguments = (neighbourhoods, self.wrap, old, changed, match, self.inverse_distance)
            run_spans(propagate_match, arguments, level.grid[0], _PIECES)
            changed = (match != old).any(axis=0)
        self.inverse = match

    def propose_by_centres(self, clusters: int) -> Places:
        """The best place for the centre of each neighbourhood's cluster, by a search of the whole compaction."""
        centres, cluster = self.level.centres(clusters)
        return np.ascontiguousarray(np.where(cluster >= 0, self._search(centres)[:, cluster], np.int32(-1)))

    def propose_by_search(self) -> Places:
        """The best place for each neighbourhood, by a search of the whole compaction."""
        step, (down, across) = self.level.step, self.level.places
        grid = self.level.vectors.reshape(down, across, -1)[::step, ::step]
        proposed = np.full((2, *self.level.grid), -1, np.int32)
        proposed[:, self.level.counted] = self._search(grid[self.level.counted])
        return proposed

    def _search(self, wanted: Int16[np.ndarray, "n 32"]) -> Int32[np.ndarray, "2 n"]:
        numbers = nearest(wanted, self.level.components.vectors(self.values))
        return np.asarray(np.stack(np.divmod(numbers, self.places[1])), np.int32)

    def match_forward_by_coherence(self) -> None:
        """Improve the forward match by k-coherence."""
        from texloom.stages.kernels.compaction.solver import match_by_coherence

        source, candidates = self._whole(self.source), self.level.tree.candidates
        arguments = (self._of_compaction, source, candidates, self.moved, self.forward, self.forward_distance)
        run_spans(match_by_coherence, arguments, self.places[0], _PIECES)

    def match_forward_by_search(self) -> None:
        """Improve the forward match by a search of the whole texture."""
        from texloom.stages.kernels.compaction.solver import improve_match

        level = self.level
        valid = np.flatnonzero(level.tree.leaf >= 0)
        numbers = valid[nearest(level.components.vectors(self.values), level.vectors[valid])]
        proposed = np.stack(np.divmod(numbers, level.places[1])).astype(np.int32).reshape(2, *self.places)
        anew = np.full(level.places, True)
        arguments = (self._of_compaction, proposed, anew, self.forward, self.forward_distance)
        run_spans(improve_match, arguments, self.places[0], _PIECES)

    def use(self) -> Float32[np.ndarray, "H W"]:
        """How many texture neighbourhoods are matched with those around each pixel, relative to the mean."""
        ndimage = loaded("scipy.ndimage")
        assert self.inverse is not None
        height, width = self.source.shape[1:]
        middle = self.level.size // 2
        rows, columns = self.inverse[:, self.level.counted].astype(np.int64) + middle
        numbers = rows % height * width + columns % width
        counts = np.bincount(numbers, minlength=height * width).reshape(height, width).astype(np.float64)
        smooth = ndimage.uniform_filter(counts, self.level.size, mode="wrap" if self.wrap else "nearest")
        return np.asarray(smooth / smooth.mean(), np.float32)

    def mean_votes(self) -> tuple[Float32[np.ndarray, "H W c"], Float32[np.ndarray, "H W"]]:
        """The weighted mean of all pixels that are matched with each, and the sum of their weights.

        Were any value allowed, the mean would minimise the energy. Where the weights are 0 it is the present value.
        """
        from texloom.stages.kernels.compaction.solver import gather_votes, scatter_votes

        assert self.inverse is not None
        level = self.level
        shape = (self.values.shape[0], self.values.shape[1] // level.channels)

        def inverse_votes(first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
            sums, counts = np.zeros(self.values.shape, np.int64), np.zeros(shape, np.int64)
            scatter_votes(self._of_texture, self.inverse, sums, counts, first, last)
            return sums, counts

        parts = run_all(inverse_votes, spans(level.grid[0], 4))
        inverse_sums, inverse_counts = (np.sum(part, axis=0) for part in zip(*parts, strict=True))
        sums, counts = np.zeros(self.values.shape, np.int64), np.zeros(shape, np.int64)
        gather_votes(self._of_compaction, self.forward, sums, counts)
        one, other = self.completeness / int(level.counted.sum()), self.alpha / math.prod(self.places)
        weights = (self._folded(inverse_counts) * one + self._folded(counts) * other)[..., 0]
        planes = self._folded(inverse_sums) * one + self._folded(sums) * other
        height, width = weights.shape
        own = self.values.reshape(height + self.extra, width + self.extra, -1)
        means = own[:height, :width].astype(np.float64)
        np.divide(planes, weights[..., None], out=means, where=weights[..., None] > 0)
        return means.astype(np.float32), weights.astype(np.float32)

    def _folded(self, sums: Int64[np.ndarray, "P Qn"]) -> Int64[np.ndarray, "H W n"]:
        """Sums over all neighbourhoods by pixel; the padding of a torus is added to its first pixels."""
        height, width = self.source.shape[1:]
        whole = sums.reshape(height + self.extra, width + self.extra, -1)
        whole[: self.extra] += whole[height:]
        whole[:, : self.extra] += whole[:, width:]
        return whole[:height, :width]

    def choose(self) -> int:
        """Copy to every pixel the candidate that lowers the energy most; the number of pixels that changed."""
        from texloom.stages.kernels.compaction.solver import CompactionSource, Objective, choose_pixels

        level, new = self.level, self.source.copy()
        wanted, weights = self.mean_votes()
        seam_weight = np.float32(self.seams * level.size**2 / (2 * weights.size))
        texture = CompactionSource(level.pixels, level.inside, level.tree.candidates, level.size)
        stale = (np.abs(wanted - self._wanted) > _NEGLIGIBLE * UNIT).any(axis=2)
        self._active |= stale | (np.abs(weights - self._weights) > _SIMILAR * weights)
        self._wanted[self._active], self._weights[self._active] = wanted[self._active], weights[self._active]
        choose_pixels(texture, Objective(wanted, weights, seam_weight, self.wrap), self._active, new)
        changed = (new != self.source).any(axis=0)
        self.source, self.values = new, level.copy(self._whole(new))
        self.moved = ~whole(~self._whole(changed[None])[0], level.size)
        return int(changed.sum())

    def average(self) -> None:
        """Set every pixel to the mean of its votes, which need not occur in the texture."""
        means = np.rint(self.mean_votes()[0]).astype(np.int16)
        whole = np.moveaxis(self._whole(np.moveaxis(means, 2, 0)), 0, 2)
        self.values = np.ascontiguousarray(whole).reshape(self.values.shape)
        self.moved[:] = True

    def source_of_forward(self) -> Source:
        """The texture pixel under each pixel of the compaction by the forward match of the place around it."""
        height, width = self.source.shape[1:]
        middle = self.level.size // 2
        rows, columns = np.arange(height) - middle, np.arange(width) - middle
        if not self.wrap:
            rows, columns = np.clip(rows, 0, self.places[0] - 1), np.clip(columns, 0, self.places[1] - 1)
        shift = np.stack(np.broadcast_arrays((np.arange(height) - rows)[:, None], np.arange(width) - columns))
        return np.asarray(self.forward[:, rows[:, None], columns] + shift, np.int32)
