"""Discrete synthesis under control: pixels are copied one by one, by k-coherence, from coarse to fine."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32

from stages.kernels.threads import run_all, spans, thread_count

_RADIUS = 2  # of a neighbourhood, px
_DIMENSIONS = 12  # that neighbourhoods are compared in
_SIMILAR = 4  # places that look like a pixel
_APART = 3  # px between a pixel and places that look like it, more than
LARGEST = 2**14
"""px of an exemplar up to which places that look alike are searched"""

_SAMPLES = 2**12  # neighbourhoods that the dimensions are found from
_JUMP = 1.2  # price of not continuing a neighbour, as a factor on the squared distance


@dataclass(frozen=True)
class Neighbourhoods:
    """An exemplar at one scale, as the search sees it."""

    texture: Float32[np.ndarray, "h w c"]
    vectors: Float32[np.ndarray, "h w d"]
    basis: Float32[np.ndarray, "d n"]
    similar: Int32[np.ndarray, "h w s 2"]

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
        height, width = texture.shape[:2]
        planes = np.concatenate([texture, control], axis=2)
        padded = np.pad(planes, ((_RADIUS, _RADIUS), (_RADIUS, _RADIUS), (0, 0)), mode="edge")
        side = 2 * _RADIUS + 1
        parts = [padded[dy : dy + height, dx : dx + width] for dy in range(side) for dx in range(side)]
        step = max(1, int(np.sqrt(height * width / _SAMPLES)))
        some = np.concatenate([part[::step, ::step] for part in parts], axis=2).astype(np.float64)
        _, directions = np.linalg.eigh(np.cov(some.reshape(-1, some.shape[2]).T))
        basis = np.ascontiguousarray(directions[:, ::-1][:, :_DIMENSIONS].T.astype(np.float32))
        vectors = np.zeros((height, width, len(basis)), np.float32)
        for part, columns in zip(parts, np.split(basis, len(parts), axis=1), strict=True):
            vectors += part @ columns.T
        similar = _similar(vectors) if coarser is None else _carried(coarser.similar, (height, width))
        return cls(np.ascontiguousarray(texture), vectors, basis, similar)


def _similar(vectors: Float32[np.ndarray, "h w d"]) -> Int32[np.ndarray, "h w s 2"]:
    """The nearest places that are not next to a pixel; the pixel itself where there are none."""
    from scipy.spatial import KDTree

    height, width, dimensions = vectors.shape
    flat = vectors.reshape(-1, dimensions)
    count = min(len(flat), 6 * _SIMILAR)
    found = KDTree(flat).query(flat, k=count, workers=thread_count())[1].reshape(len(flat), count)
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


def move(
    source: Int32[np.ndarray, "H W 2"],
    exemplar: Neighbourhoods,
    given: Float32[np.ndarray, "H W k"],
    tries: int,
    wrap: bool,
    random: np.random.Generator,
) -> tuple[float, float]:
    """Let every pixel choose once, in four turns; ``source`` is changed.

    Returns
    -------
    energy a pixel, CIELAB units squared; share of the pixels that changed.
    """
    from stages.kernels.inverse_coherence import move_pixels

    before = source.copy()
    energy = 0.0
    for parity in range(4):
        new = source.copy()
        key = random.integers(2**64, dtype=np.uint64)
        shared = (
            source, new, exemplar.texture, given, exemplar.vectors, exemplar.basis, exemplar.similar, _RADIUS,
            parity, tries, np.float32(_JUMP), wrap, key,
        )  # fmt: skip
        energy += sum(run_all(move_pixels, [(*shared, *span) for span in spans(source.shape[0], 16)]))
        source[:] = new
    pixels = source.shape[0] * source.shape[1]
    return energy / pixels / (2 * _RADIUS + 1) ** 2, float((source != before).any(axis=2).mean())
