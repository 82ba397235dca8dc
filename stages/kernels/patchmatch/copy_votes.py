"""Copying votes: every target pixel takes one of the exemplar pixels that the patches over it propose."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def copy_votes(row, column, target, exemplar, channels, patch_size, reach, wrap, source, first, last):
    """Fill ``source[first:last]`` with the proposal whose surroundings are most like those of the target pixel.

    A proposal is the exemplar pixel that a patch over the target pixel is matched with there; of equals, the first
    in the order of the patches wins, the patch whose middle is nearest coming before all others.

    Parameters
    ----------
    row, column : (p, q) int32, the correspondence
    target : (H, W * channels) int16, what pixels should be like, as the mean of all votes
    exemplar : (h, w * channels) int16
    reach : pixels to every side that are compared; beyond the target they do not count, beyond the exemplar its
        border repeats
    wrap : bool, the target is a torus of (p, q) pixels; else it has (p, q) + patch_size - 1 pixels
    source : (H, W, 2) int32, output
    """
    down, across = row.shape
    extra = 0 if wrap else patch_size - 1
    height, width = down + extra, across + extra
    rows, columns = exemplar.shape[0], exemplar.shape[1] // channels
    middle = patch_size // 2
    for y in range(first, last):
        for x in range(width):
            best = np.int64(2**62)
            seen_row, seen_column = np.int64(-1), np.int64(-1)
            best_row, best_column = np.int64(0), np.int64(0)
            for place in range(-1, patch_size * patch_size):
                if place < 0:
                    qy, qx = y - middle, x - middle
                    if not wrap:
                        qy, qx = min(max(qy, 0), down - 1), min(max(qx, 0), across - 1)
                    i, j = y - qy, x - qx
                else:
                    i, j = place // patch_size, place % patch_size
                    qy, qx = y - i, x - j
                if wrap:
                    qy, qx = qy % down, qx % across
                elif qy < 0 or qy >= down or qx < 0 or qx >= across:
                    continue
                r, c = np.int64(row[qy, qx]) + i, np.int64(column[qy, qx]) + j
                if (r == seen_row and c == seen_column) or (r == best_row and c == best_column and best < 2**62):
                    continue
                seen_row, seen_column = r, c
                total = np.int64(0)
                for dy in range(-reach, reach + 1):
                    ty = y + dy
                    if wrap:
                        ty = ty % height
                    elif ty < 0 or ty >= height:
                        continue
                    near_row = min(max(r + dy, 0), rows - 1)
                    for dx in range(-reach, reach + 1):
                        tx = x + dx
                        if wrap:
                            tx = tx % width
                        elif tx < 0 or tx >= width:
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
