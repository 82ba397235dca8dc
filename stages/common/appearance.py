"""One level of an exemplar in short vectors of whole numbers; what looks alike in them.

A *place* is a pixel's number, row * width + column. `texloom.stages.common.distorted_appearance` does the same
where texture is distorted.
"""

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32

from texloom.stages.kernels.core.threads import run_spans, spans

COMPONENTS = 8
"""values of an appearance, and of a place's neighbourhood"""

AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""where the appearances of a neighbourhood stand, in steps"""

ONE = 2048
"""length of a vector of the basis; products with appearances are exact in single precision"""

LONGEST = 2000
"""of an appearance: sums of eight stay within 16000, differences of those in 16 bits"""

FAR = 16000
"""longer than any neighbourhood"""

_RADIUS = 2  # samples of a window on each side of its middle
_SAMPLE = 10_000  # windows that the components are found from
_BLOCK = 2**14  # windows laid out at a time
_CLUSTER = 40  # members of a cluster that a set is first looked for in
_ROUNDS = 3  # in which neighbours pass on what they have found
_SEARCHED = 2**14  # whole neighbourhoods that one is looked for among, for those that are not
_PIECES = 16


def gaussian_stack(
    planes: Float32[np.ndarray, "h w c"], levels: int, toroidal: bool
) -> Float32[np.ndarray, "levels h w c"]:
    """``planes`` without detail that samples 2**level px apart cannot hold; mirrored at borders, or a torus."""
    from scipy.ndimage import gaussian_filter

    stack = [planes]
    for level in range(1, levels):
        # from the level before: variances add up
        sigma = 0.6 * np.sqrt(4.0**level - 4.0 ** (level - 1))
        blurred = gaussian_filter(stack[-1], (sigma, sigma, 0), mode="wrap" if toroidal else "reflect", truncate=3)
        stack.append(blurred)
    return np.stack(stack)


def whole(usable: Bool[np.ndarray, "h w"], level: int, toroidal: bool) -> Bool[np.ndarray, "h w"]:
    """The pixels all of whose neighbourhood is usable: what lies up to three steps away."""
    reach = (_RADIUS + 1) * 2**level
    if toroidal and usable.all():
        return usable
    height, width = usable.shape
    found = usable.copy()
    own_rows, own_columns = np.indices(usable.shape, sparse=True)
    for down, across in ((r, c) for r in (-reach, 0, reach) for c in (-reach, 0, reach)):
        rows, columns = own_rows + down, own_columns + across
        if toroidal:
            rows, columns = rows % height, columns % width
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        found &= inside & usable[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return found


class _Windows:
    """What stands at offsets from every pixel; mirrored at borders, or a torus."""

    def __init__(self, planes: Float32[np.ndarray, "h w c"], reach: int, toroidal: bool):
        self.shape, self.reach = planes.shape[:2], reach
        rows, columns = (
            index % size if toroidal else _mirrored(index, size)
            for size in planes.shape[:2]
            for index in [np.arange(-reach, size + reach)]
        )
        self.padded = planes[rows][:, columns]

    def at(self, offset: tuple[int, int]) -> Float32[np.ndarray, "h w c"]:
        """The planes, shifted by at most ``reach``."""
        top, left = self.reach + offset[0], self.reach + offset[1]
        return np.asarray(self.padded[top : top + self.shape[0], left : left + self.shape[1]])


def _mirrored(index: np.ndarray, size: int) -> np.ndarray:
    around = np.abs(index) % (2 * size - 2)
    return np.asarray(np.minimum(around, 2 * size - 2 - around))


def components(sample: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of rows, and the principal components, (values, count), zeros where there are fewer."""
    sample = sample.astype(np.float64)
    _, vectors = np.linalg.eigh(np.cov(sample, rowvar=False, bias=True))
    basis = np.zeros((sample.shape[1], count))
    kept = min(count, sample.shape[1])
    basis[:, :kept] = vectors[:, ::-1][:, :kept]
    basis *= np.where(basis[np.abs(basis).argmax(axis=0), np.arange(count)] < 0, -1, 1)
    return sample.mean(axis=0), basis


def _some(usable: Bool[np.ndarray, "h w"]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of pixels that are usable, evenly spaced."""
    rows, columns = np.nonzero(usable)
    step = max(1, rows.size // _SAMPLE)
    return rows[::step], columns[::step]


def appearances(
    planes: Float32[np.ndarray, "h w c"],
    usable: Bool[np.ndarray, "h w"],
    level: int,
    toroidal: bool,
) -> Int16[np.ndarray, "h w 8"]:
    """The principal components of the window of 5x5 samples around every pixel."""
    height, width, _ = planes.shape
    reach = range(-_RADIUS, _RADIUS + 1)
    windows = _Windows(planes, _RADIUS * 2**level, toroidal)
    parts = [windows.at((row * 2**level, column * 2**level)) for row in reach for column in reach]
    rows, columns = _some(usable)
    mean, basis = components(np.concatenate([part[rows, columns] for part in parts], axis=1), COMPONENTS)
    found = np.empty((height, width, COMPONENTS))
    for first, last in spans(height, -(-height * width // _BLOCK)):
        # in double precision, so that no library's order of adding shows
        block = np.concatenate([part[first:last] for part in parts], axis=2, dtype=np.float64)
        found[first:last] = (block - mean) @ basis
    longest = float(np.sqrt((found**2).sum(axis=2).max()))
    return np.asarray(np.trunc(found * (LONGEST / max(longest, 1e-6))), np.int16)


def seen_around(appearance: Int16[np.ndarray, "h w 8"], level: int, toroidal: bool) -> Int16[np.ndarray, "h w 64"]:
    """The appearances one step away on eight sides; beyond the border those of the nearest pixel."""
    height, width = appearance.shape[:2]
    parts = []
    own_rows, own_columns = np.indices((height, width), sparse=True)
    for down, across in AROUND:
        rows, columns = own_rows + down * 2**level, own_columns + across * 2**level
        if toroidal:
            rows, columns = rows % height, columns % width
        parts.append(appearance[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)])
    return np.concatenate(parts, axis=2)


def projected(vectors: Int16[np.ndarray, "... n"], basis: Int16[np.ndarray, "n 8"]) -> Int16[np.ndarray, "... 8"]:
    """Appearances in the components of ``basis``."""
    return np.rint((vectors.astype(np.float32) @ basis.astype(np.float32)) / np.float32(ONE)).astype(np.int16)


def neighbourhoods(
    around: Int16[np.ndarray, "h w 64"], basis: Int16[np.ndarray, "64 8"]
) -> Int16[np.ndarray, "h w 8"]:
    """What places are compared by: the sum of what each side contributes."""
    total = np.zeros((*around.shape[:2], COMPONENTS), np.int16)
    for side in range(len(AROUND)):
        part = slice(COMPONENTS * side, COMPONENTS * (side + 1))
        total += projected(around[..., part], basis[part])
    return total


def analyse(
    planes: Float32[np.ndarray, "h w c"],
    complete: Bool[np.ndarray, "h w"],
    level: int,
    toroidal: bool,
    k: int,
    min_separation: int,
) -> tuple[Int16[np.ndarray, "h w 8"], Int16[np.ndarray, "64 8"], Int32[np.ndarray, "h w k"]]:
    """Appearance, basis and similarity sets of one level; see `texloom.stages.analysis.appearance_stack`.

    Parameters
    ----------
    complete : the places whose neighbourhoods are whole.
    min_separation : least distance of the places in a set, px.
    """
    appearance = appearances(planes, complete, level, toroidal)
    around = seen_around(appearance, level, toroidal)
    basis = np.rint(components(around[_some(complete)], COMPONENTS)[1] * ONE).astype(np.int16)
    return appearance, basis, similar_places(neighbourhoods(around, basis), complete, 2**level, k, min_separation)


def similar_places(
    vectors: Int16[np.ndarray, "h w 8"], complete: Bool[np.ndarray, "h w"], step: int, k: int, min_separation: int
) -> Int32[np.ndarray, "h w k"]:
    """For every place ``k`` that look like it: itself if complete, else the one most like it; then others.

    Members of small clusters are compared with each other; then every place tries what its neighbours have found,
    shifted. Of a level's places that are not complete only one in a step is looked for, and the others follow it.
    """
    height, width = complete.shape
    candidates = similar_sets(vectors, complete, k, min_separation).reshape(height, width, k)
    if not complete.all():
        home = _nearest_complete(vectors, complete, step)
        candidates[~complete] = candidates.reshape(-1, k)[home[~complete]]
    return np.ascontiguousarray(candidates, np.int32)


def similar_sets(
    vectors: Int16[np.ndarray, "h w 8"], complete: Bool[np.ndarray, "h w"], k: int, min_separation: int
) -> Int32[np.ndarray, "places k"]:
    """Similarity sets of the complete places; the others are their own."""
    from texloom.stages.kernels.compaction.tree import HALF
    from texloom.stages.kernels.kcoherence.candidates import similar_in_clusters, similar_to_neighbours

    height, width = complete.shape
    places = np.arange(height * width, dtype=np.int32)
    candidates = np.repeat(places[:, None], max(2, k), axis=1)
    if k > 1:
        wide = np.zeros((height * width, 2 * HALF), np.int16)
        wide[:, :COMPONENTS] = vectors.reshape(-1, COMPONENTS)
        outside = ~complete.ravel()
        wide[outside] = 0
        wide[outside, COMPONENTS] = FAR
        halves = wide.reshape(-1, HALF)
        inside = places[~outside]
        members, begin = _clusters(vectors.reshape(-1, COMPONENTS)[inside])
        distance = np.full(candidates.shape, 2**62, np.int64)
        candidates[:, 1:] = -1
        distance[:, 0] = 0
        shared = (
            halves,
            inside[members].astype(np.int64),
            begin,
            width,
            max(1, min_separation),
            _CLUSTER,
            candidates,
            distance,
        )
        run_spans(similar_in_clusters, shared, begin.size - 1, _PIECES)
        for _ in range(_ROUNDS):
            steady = (halves, height, width, max(1, min_separation), candidates.copy(), candidates, distance)
            run_spans(similar_to_neighbours, steady, height, _PIECES)
        candidates = np.where((candidates < 0) | outside[candidates], places[:, None], candidates)
    return np.ascontiguousarray(candidates[:, :k], np.int32)


def _clusters(vectors: Int16[np.ndarray, "n 8"]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of vectors, those of a cluster side by side, and where clusters begin.

    Clusters are equal parts by the first component, parts of those by the second, and so on.
    """
    count = len(vectors)
    parts = max(1, int(np.ceil((count / _CLUSTER) ** 0.25)))
    cell = np.zeros(count, np.int64)
    order = np.arange(count)
    for component in range(4):
        order = np.lexsort((vectors[:, component], cell))
        sizes = np.bincount(cell)
        begin = np.cumsum(sizes) - sizes
        rank = np.empty(count, np.int64)
        rank[order] = np.arange(count) - begin[cell[order]]
        cell = cell * parts + rank * parts // sizes[cell]
    order = np.argsort(cell, kind="stable")
    return order, np.concatenate([np.flatnonzero(np.diff(cell[order], prepend=-1)), [count]])


def _nearest_complete(
    vectors: Int16[np.ndarray, "h w 8"], complete: Bool[np.ndarray, "h w"], step: int
) -> Int32[np.ndarray, "h w"]:
    """For every place that is not complete a complete one that looks like it; others unchanged."""
    from scipy.spatial import KDTree

    from texloom.stages.kernels.core.threads import thread_count

    height, width = complete.shape
    inside = np.flatnonzero(complete)
    inside = inside[:: max(1, inside.size // _SEARCHED)]
    rows, columns = np.nonzero(~complete)
    asked = np.unique(rows // step * step * width + columns // step * step)
    tree = KDTree(vectors.reshape(-1, COMPONENTS)[inside])
    jump = np.zeros(height * width, np.int64)
    jump[asked] = inside[tree.query(vectors.reshape(-1, COMPONENTS)[asked], workers=thread_count())[1]]
    own_rows, own_columns = np.indices((height, width))
    near_rows, near_columns = own_rows // step * step, own_columns // step * step
    at = jump[near_rows * width + near_columns]
    # continues from the jump's target, where that is complete
    to_rows = np.clip(at // width + own_rows - near_rows, 0, height - 1)
    to_columns = np.clip(at % width + own_columns - near_columns, 0, width - 1)
    home = np.where(complete[to_rows, to_columns], to_rows * width + to_columns, at)
    return np.where(complete, own_rows * width + own_columns, home).astype(np.int32)
