"""Discrete synthesis: every pixel moves to the exemplar pixel that continues its neighbours best."""

from __future__ import annotations

import numba
import numpy as np

from stages.kernels.patch_search import random_bits


@numba.njit(cache=True, nogil=True)
def move_pixels(  # type: ignore[no-untyped-def]
    old, new, texture, given, vectors, basis, similar, radius, parity, tries, jump, wrap, key, first, last
):
    """Choose the sources of the pixels of one parity in rows ``first`` to ``last``.

    Each of the 3x3 neighbours proposes the exemplar pixel that continues its source, and those that continue the
    places that look like its source. The one whose neighbourhood is nearest to the pixel's is taken.

    Parameters
    ----------
    old, new : (H, W, 2) int32, sources before and after
    texture : (h, w, c) float32, what is copied
    given : (H, W, k) float32, control of the target, which is not copied
    vectors : (h, w, d) float32, neighbourhoods of the exemplar in few dimensions
    basis : (d, (2 * radius + 1)**2 * (c + k)) float32, from a neighbourhood to its dimensions
    similar : (h, w, s, 2) int32, places that look like a pixel
    parity : 0..3, which of every 2x2 pixels
    tries : random places tried for a pixel
    jump : factor on the distance of what does not continue a neighbour, at least 1
    wrap : bool, the target is a torus; else its border repeats
    key : uint64, of the random numbers

    Returns
    -------
    float, sum of the squared distances of the chosen.
    """
    height, width = old.shape[0], old.shape[1]
    rows, columns, colours = texture.shape
    controls = given.shape[2]
    around = np.empty(basis.shape[1], np.float32)
    wanted = np.empty(basis.shape[0], np.float32)
    energy = np.float64(0)
    for y in range(first + (first + parity // 2) % 2, last, 2):
        for x in range(parity % 2, width, 2):
            at = 0
            for dy in range(-radius, radius + 1):
                ny = (y + dy) % height if wrap else min(max(y + dy, 0), height - 1)
                for dx in range(-radius, radius + 1):
                    nx = (x + dx) % width if wrap else min(max(x + dx, 0), width - 1)
                    r, c = old[ny, nx, 0], old[ny, nx, 1]
                    for k in range(colours):
                        around[at + k] = texture[r, c, k]
                    for k in range(controls):
                        around[at + colours + k] = given[ny, nx, k]
                    at += colours + controls
            for d in range(wanted.size):
                total = np.float32(0)
                for i in range(around.size):
                    total += basis[d, i] * around[i]
                wanted[d] = total

            best = np.float32(np.inf)
            best_row, best_column = old[y, x, 0], old[y, x, 1]
            for which in range(-1, similar.shape[2] + 1):
                # first what continues a neighbour, then what looks like that, then anything
                random = which == similar.shape[2]
                for place in range(tries if random else 9):
                    if random:
                        bits = random_bits(key, y * width + x, place)
                        r = np.int64((bits >> np.uint64(32)) % np.uint64(rows))
                        c = np.int64((bits & np.uint64(0xFFFFFFFF)) % np.uint64(columns))
                    else:
                        dy, dx = place // 3 - 1, place % 3 - 1
                        ny, nx = y + dy, x + dx
                        if wrap:
                            ny, nx = ny % height, nx % width
                        elif ny < 0 or ny >= height or nx < 0 or nx >= width:
                            continue
                        r, c = np.int64(old[ny, nx, 0]), np.int64(old[ny, nx, 1])
                        if which >= 0:
                            r, c = np.int64(similar[r, c, which, 0]), np.int64(similar[r, c, which, 1])
                        r, c = r - dy, c - dx
                        if r < 0 or r >= rows or c < 0 or c >= columns:
                            continue
                    total = np.float32(0)
                    for d in range(wanted.size):
                        difference = wanted[d] - vectors[r, c, d]
                        total += difference * difference
                    if which >= 0:
                        total *= jump
                    if total < best:
                        best, best_row, best_column = total, r, c
            new[y, x, 0], new[y, x, 1] = best_row, best_column
            energy += best
    return energy
