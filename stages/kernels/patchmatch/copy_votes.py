"""Votes that are copied: every target pixel takes one of the exemplar pixels that the patches over it propose."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.patchmatch.search import wrap_index


@compiled
def copy_votes(votes, target, reach, source, first, last):
    """Fill ``source[first:last]`` with the proposal whose surroundings are most like those of the target pixel.

    A proposal is the exemplar pixel that a patch over the target pixel is matched with there; of equal ones the
    first is taken, in the order of the patches after the one whose centre is nearest.

    Parameters
    ----------
    votes : texloom.stages.kernels.patchmatch.voting.Votes, of int16
    target : (H, W * channels) int16, what pixels should be like, as the mean of all votes
    reach : pixels to every side that are compared, where it wraps fewer than it has; beyond the target they do not
        count, beyond the exemplar its border repeats
    source : (H, W, 2) int32, output
    """
    row, column, exemplar, channels, patch_size, wrap = votes
    down, across = row.shape
    height, width = source.shape[0], source.shape[1]
    rows, columns = exemplar.shape[0], exemplar.shape[1] // channels
    centre = patch_size // 2
    for y in range(first, last):
        for x in range(width):
            best = np.int64(2**62)
            last_row, last_column = np.int64(-1), np.int64(-1)
            best_row, best_column = np.int64(-1), np.int64(-1)
            for patch in range(-1, patch_size * patch_size):
                i, j = patch // patch_size, patch % patch_size
                if patch < 0:
                    i, j = centre, centre
                    if not wrap.down:
                        i = y - min(max(y - i, 0), down - 1)
                    if not wrap.across:
                        j = x - min(max(x - j, 0), across - 1)
                qy, qx = wrap_index(y - i, down, wrap.down), wrap_index(x - j, across, wrap.across)
                if qy < 0 or qx < 0:
                    continue
                r, c = np.int64(row[qy, qx]) + i, np.int64(column[qy, qx]) + j
                if (r == last_row and c == last_column) or (r == best_row and c == best_column):
                    continue
                last_row, last_column = r, c
                total = np.int64(0)
                for dy in range(-reach, reach + 1):
                    ty = wrap_index(y + dy, height, wrap.down)
                    if ty < 0:
                        continue
                    near_row = min(max(r + dy, 0), rows - 1)
                    for dx in range(-reach, reach + 1):
                        tx = wrap_index(x + dx, width, wrap.across)
                        if tx < 0:
                            continue
                        near_column = min(max(c + dx, 0), columns - 1)
                        for k in range(channels):
                            difference = np.int64(target[ty, tx * channels + k]) - np.int64(
                                exemplar[near_row, near_column * channels + k]
                            )
                            total += difference * difference
                    if total >= best:
                        break
                if total < best:
                    best, best_row, best_column = total, r, c
            source[y, x, 0], source[y, x, 1] = best_row, best_column
