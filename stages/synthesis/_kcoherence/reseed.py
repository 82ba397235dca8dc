"""New sources for pixels whose control a coarser scale did not show."""

import numpy as np
from jaxtyping import Float32, Int32

from texloom.stages.synthesis._kcoherence.correlation import median_cells

_BLOCK = 8  # px; pixels of a block get one piece of the exemplar
_TRIES = 16  # pieces tried for a block
_FAR = 0.06  # of the range of control, divided by the share that control explains, at which a source is replaced
_NEW = 0.5  # of that distance, by which control must differ from the coarser scale's
_ALIKE = 0.5  # of that distance, root mean square, within which a piece is accepted
_AROUND = 4  # of 3x3 pixels that must be as far, since control is noisy


def reseeded(
    source: Int32[np.ndarray, "H W 2"],
    own: Float32[np.ndarray, "h w k"],
    wanted: Float32[np.ndarray, "H W k"],
    coarser: Float32[np.ndarray, "H W k"],
    explained: float,
    random: np.random.Generator,
) -> Int32[np.ndarray, "H W 2"]:
    """Sources with those replaced, piece by piece, whose control is far from the wanted.

    A line that is thinner than a pixel of the coarser scale, as a river, is lost there, and single pixels of it are
    too unlike their neighbours to be chosen later. Where control explains little, its deviations matter little.

    Parameters
    ----------
    source : taken over from the coarser scale.
    own, wanted : control of the exemplar and of the target.
    coarser : control of the target as the coarser scale shows it, at this one's size.
    explained : share of the texture's variance that control explains, 0..1.
    """
    from scipy.ndimage import uniform_filter

    height, width = own.shape[:2]
    limit = (_FAR / max(explained, _FAR) * float(np.ptp(own, axis=(0, 1)).max(initial=0))) ** 2
    before = _distance(own[source[..., 0], source[..., 1]], wanted)
    is_far = (before > limit) & (_distance(wanted, coarser) > _NEW**2 * limit)
    rows, columns = np.nonzero(is_far & (9 * uniform_filter(is_far.astype(np.float32), 3) > _AROUND - 0.5))
    if not len(rows):
        return source
    before = before[rows, columns]
    block = rows // _BLOCK * wanted.shape[1] + columns // _BLOCK
    order = np.lexsort((-before, block))
    rows, columns, before = rows[order], columns[order], before[order]
    _, worst, block = np.unique(block[order], return_index=True, return_inverse=True)
    drawn = _of_similar_control(own, wanted[rows[worst], columns[worst]], random)
    # each piece shows at the worst pixel of its block the place that was drawn
    down, across = rows - rows[worst][block], columns - columns[worst][block]
    r, c = drawn[block] // width + down[:, None], drawn[block] % width + across[:, None]
    outside = (r < 0) | (r >= height) | (c < 0) | (c >= width)
    r, c = np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)
    distances = _distance(own[r, c], wanted[rows, columns][:, None])
    distances[outside] = np.inf
    sums = np.zeros((len(worst), _TRIES))
    np.add.at(sums, block, np.minimum(distances, 4 * limit))
    # the first that will do: the best would repeat
    is_alike = sums < _ALIKE**2 * limit * np.bincount(block)[:, None]
    tried = np.where(is_alike.any(axis=1), is_alike.argmax(axis=1), sums.argmin(axis=1))[block]
    every = np.arange(len(rows))
    nearer = distances[every, tried] < _ALIKE**2 * before
    new = source.copy()
    new[rows[nearer], columns[nearer]] = np.stack([r[every, tried], c[every, tried]], axis=1)[nearer]
    return new


def _distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Squared distance of values of control."""
    squares: np.ndarray = np.square(one - other).sum(axis=-1)
    return squares


def _of_similar_control(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "n k"], random: np.random.Generator
) -> np.ndarray:
    """For each wanted value, random pixels of the exemplar among those of the most similar control; (n, tries)."""
    values = own.reshape(-1, own.shape[2])
    cells = median_cells(values)
    counts = np.bincount(cells)
    means = np.stack([np.bincount(cells, plane) for plane in values.T], axis=1) / np.maximum(counts, 1)[:, None]
    means[counts == 0] = np.inf
    cell = _distance(wanted[:, None], means).argmin(axis=1)
    drawn = random.random((len(wanted), _TRIES)) * counts[cell][:, None]
    pixels = np.argsort(cells, kind="stable")
    return np.asarray(pixels[(np.cumsum(counts) - counts)[cell][:, None] + drawn.astype(np.int64)])
