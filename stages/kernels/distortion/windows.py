"""Windows and neighbourhoods of a texture that is distorted in its picture.

A window is 5x5 samples one step apart in the texture, a neighbourhood the windows of the eight places one step
away. Offsets are advected a step at a time along the Jacobians, by the midpoint rule.
"""

import math

import numba
import numpy as np

from texloom.stages.kernels.core.short_vectors import paired, sum_of_eight

_SIDE = 2  # samples on each side of a window's middle
_DOWN = (-1, -1, -1, 0, 0, 1, 1, 1)  # the eight neighbours
_ACROSS = (-1, 0, 1, -1, 1, -1, 0, 1)
_COMPONENTS = 8
_LANES = 32  # windows that are read side by side: positions of one alone would wait for each other


@numba.njit(cache=True, nogil=True, forceinline=True)
def _nearest(value, size):
    return int(min(max(value + 0.5, 0.0), size - 0.5))


@numba.njit(cache=True, nogil=True)
def _advect(jacobian, row, column, down, across, step):
    """The row and column so many steps down and across the texture from another, taken a step at a time."""
    height, width = jacobian.shape[:2]
    times = max(abs(down), abs(across))
    if times == 0:
        return row, column
    u, v = down * step / times, across * step / times
    for _ in range(times):
        r, c = _nearest(row, height), _nearest(column, width)
        half_row = row + 0.5 * (jacobian[r, c, 0] * u + jacobian[r, c, 1] * v)
        half_column = column + 0.5 * (jacobian[r, c, 2] * u + jacobian[r, c, 3] * v)
        r, c = _nearest(half_row, height), _nearest(half_column, width)
        row += jacobian[r, c, 0] * u + jacobian[r, c, 1] * v
        column += jacobian[r, c, 2] * u + jacobian[r, c, 3] * v
    return row, column


@numba.njit(cache=True, nogil=True)
def _is_set(flags, row, column):
    """Whether the pixel nearest to a position is in the picture and set in ``flags``."""
    r, c = math.floor(row + 0.5), math.floor(column + 0.5)
    return 0 <= r < flags.shape[0] and 0 <= c < flags.shape[1] and flags[r, c]


@numba.njit(cache=True, nogil=True, forceinline=True)
def _add_sample(planes, row, column, out, at):
    """Put the picture's values between pixels into ``out`` from ``at`` on; beyond the border those at it."""
    height, width, channels = planes.shape
    row, column = min(max(row, 0.0), height - 1.0), min(max(column, 0.0), width - 1.0)
    top, left = min(int(row), height - 2), min(int(column), width - 2)
    p, q = np.float32(row - top), np.float32(column - left)
    one = np.float32(1)
    first, second = np.uint64(top), np.uint64(left)
    below, right = np.uint64(top + 1), np.uint64(left + 1)
    for c in range(channels):
        upper = (one - q) * planes[first, second, c] + q * planes[first, right, c]
        lower = (one - q) * planes[below, second, c] + q * planes[below, right, c]
        out[at + c] = (one - p) * upper + p * lower


@numba.njit(cache=True, nogil=True)
def whole_windows(valid, jacobian, step, reach, every, out, first, last):
    """Fill whether all positions around every ``every``-th pixel of every ``every``-th row are valid.

    Parameters
    ----------
    valid : (h, w) bool
    jacobian : (h, w, 4) float32, from texture to px
    step : in texture
    reach : steps to each side
    out : (ceil(h / every), ceil(w / every)) bool, output; rows ``first`` to ``last`` are filled
    """
    for i in range(first, last):
        for j in range(out.shape[1]):
            whole = valid[i * every, j * every]
            for down in range(-reach, reach + 1):
                for across in range(-reach, reach + 1):
                    if whole:
                        row, column = _advect(jacobian, i * every, j * every, down, across, step)
                        whole = _is_set(valid, row, column)
            out[i, j] = whole


@numba.njit(cache=True, nogil=True)
def gather_windows(planes, jacobian, places, step, out):
    """Lay out the windows around some pixels.

    Parameters
    ----------
    planes : (h, w, c) float32
    jacobian : (h, w, 4) float32, from texture to px
    places : (n,) int64, row * w + column
    step : in texture
    out : (n, 25 c) float32, output: samples row by row, their channels side by side
    """
    channels = planes.shape[2]
    for index in range(places.size):
        y, x = places[index] // planes.shape[1], places[index] % planes.shape[1]
        at = 0
        for down in range(-_SIDE, _SIDE + 1):
            for across in range(-_SIDE, _SIDE + 1):
                row, column = _advect(jacobian, y, x, down, across, step)
                _add_sample(planes, row, column, out[index], at)
                at += channels


@numba.njit(cache=True, nogil=True)
def _middle(known, top, left, every):
    """The known pixel that represents a block: the middle one, or the first; (-1, -1) where there is none."""
    height, width = known.shape
    row, column = top + every // 2, left + every // 2
    if row < height and column < width and known[row, column]:
        return row, column
    for y in range(top, min(top + every, height)):
        for x in range(left, min(left + every, width)):
            if known[y, x]:
                return y, x
    return -1, -1


@numba.njit(cache=True, nogil=True)
def _move_all(jacobian, positions, axis, half):
    """Move positions, (2, n) float32, by twice ``half`` along an axis of the texture, by the midpoint rule."""
    height, width = jacobian.shape[:2]
    for i in range(positions.shape[1]):
        row, column = positions[0, i], positions[1, i]
        r, c = np.uint64(_nearest(row, height)), np.uint64(_nearest(column, width))
        half_row, half_column = row + half * jacobian[r, c, axis], column + half * jacobian[r, c, 2 + axis]
        r, c = np.uint64(_nearest(half_row, height)), np.uint64(_nearest(half_column, width))
        half_row, half_column = half * jacobian[r, c, axis], half * jacobian[r, c, 2 + axis]
        positions[0, i], positions[1, i] = row + half_row + half_row, column + half_column + half_column


@numba.njit(cache=True, nogil=True)
def _read_all(planes, known, sharp, positions, number, mean, windows, used, missing, blurred):
    """Read sample ``number`` of each window at its position, less the mean; unknown ones are 0."""
    height, width, channels = planes.shape
    zero, one = np.float32(0), np.float32(1)
    lowest, rightmost = np.float32(height - 1), np.float32(width - 1)
    for i in range(positions.shape[1]):
        row, column = positions[0, i], positions[1, i]
        inside = -0.5 <= row < height - 0.5 and -0.5 <= column < width - 0.5
        r, c = np.uint64(_nearest(row, height)), np.uint64(_nearest(column, width))
        is_known = inside and known[r, c]
        used[number, i] = is_known
        missing[i] += not is_known
        blurred[i] += not (inside and sharp[r, c])
        row, column = min(max(row, zero), lowest), min(max(column, zero), rightmost)
        top, left = min(int(row), height - 2), min(int(column), width - 2)
        p, q = row - np.float32(top), column - np.float32(left)
        weight = one if is_known else zero
        first, second, below, right = np.uint64(top), np.uint64(left), np.uint64(top + 1), np.uint64(left + 1)
        for channel in range(channels):
            upper = (one - q) * planes[first, second, channel] + q * planes[first, right, channel]
            lower = (one - q) * planes[below, second, channel] + q * planes[below, right, channel]
            at = number * channels + channel
            windows[at, i] = weight * ((one - p) * upper + p * lower - mean[at])


@numba.njit(cache=True, nogil=True)
def _read_windows(planes, jacobian, known, sharp, pixels, step, mean, windows, used, missing, blurred):
    """Fill the samples around pixels less the mean, whether each is known, and how many are not, and not sharp."""
    side, half = 2 * _SIDE + 1, np.float32(0.5 * step)
    missing[:] = 0
    blurred[:] = 0
    for vertical in range(-1, 2, 2):
        middle = pixels.copy()
        for down in range(0 if vertical < 0 else 1, _SIDE + 1):
            # to the middle of a row of samples, and from there to both sides
            if down > 0:
                _move_all(jacobian, middle, 0, vertical * half)
            centre = (_SIDE + vertical * down) * side + _SIDE
            for horizontal in range(-1, 2, 2):
                at = middle.copy()
                for across in range(0 if horizontal < 0 else 1, _SIDE + 1):
                    if across > 0:
                        _move_all(jacobian, at, 1, horizontal * half)
                    number = centre + horizontal * across
                    _read_all(planes, known, sharp, at, number, mean, windows, used, missing, blurred)


@numba.njit(cache=True, nogil=True)
def _project_all(windows, basis, products):
    """Fill ``products``, (8, lanes), with those of the windows, (values, lanes), and the basis."""
    products[:] = 0
    for i in range(windows.shape[0]):
        for k in range(_COMPONENTS):
            factor, values, sums = basis[i, k], windows[i], products[k]
            for lane in range(_LANES):
                sums[lane] += factor * values[lane]


@numba.njit(cache=True, nogil=True)
def _fill_gram(basis, used, doubt, channels, matrix):
    """Fill the lower half with products of the basis over known samples, and ``doubt`` added on the diagonal."""
    for k in range(_COMPONENTS):
        for m in range(_COMPONENTS):
            matrix[k, m] = doubt[k] if k == m else 0.0
    for i in range(used.size):
        if used[i]:
            for j in range(i * channels, (i + 1) * channels):
                for k in range(_COMPONENTS):
                    for m in range(k + 1):
                        matrix[k, m] += basis[j, k] * basis[j, m]


@numba.njit(cache=True, nogil=True)
def _solve(matrix, right):
    """Replace ``right`` by the solution of ``matrix`` x = ``right``: Cholesky, from the lower half."""
    size = right.size
    for i in range(size):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(value) if i == j else value / matrix[j, j]
    for i in range(size):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@numba.njit(cache=True, nogil=True)
def describe_windows(
    planes, jacobian, known, sharp, described, step, mean, basis, doubt, every, out, seen, first, last
):
    """Fill rows ``first`` to ``last`` of blocks of ``out`` with the components of the window around each pixel.

    Of windows with unknown samples, the components are the most likely ones given the others.

    Parameters
    ----------
    planes : (h, w, c) float32
    jacobian : (h, w, 4) float32, from texture to px
    known : (h, w) bool, pixels that may be read
    sharp : (h, w) bool, pixels that are as sharp as the level requires, a part of those
    described : (h, w) bool, pixels that are described, a part of those that may be read; others are left unchanged
    step : in texture
    mean, basis : (25 c,) and (25 c, 8) float32, see `gather_windows`
    doubt : (8,) float64, residual variance of the components divided by that of each component
    every : side, px, of blocks of which one pixel is described for all
    out : (h, w, 8) float32, output
    seen : (h, w) bool, output: whether the whole window is sharp
    """
    height, width, channels = planes.shape
    samples = (2 * _SIDE + 1) ** 2
    windows, used = np.zeros((samples * channels, _LANES), np.float32), np.empty((samples, _LANES), np.bool_)
    missing, blurred = np.empty(_LANES, np.int64), np.empty(_LANES, np.int64)
    pixels, lefts = np.empty((2, _LANES), np.float32), np.empty(_LANES, np.int64)
    products = np.empty((_COMPONENTS, _LANES), np.float32)
    matrix, right = np.empty((_COMPONENTS, _COMPONENTS)), np.empty(_COMPONENTS)
    for block in range(first, last):
        count = 0
        for left in range(0, width, every):
            y, x = _middle(described, block * every, left, every)
            if y >= 0:
                pixels[0, count], pixels[1, count], lefts[count] = y, x, left
                count += 1
            if count == 0 or (count < _LANES and left + every < width):
                continue
            shown = pixels[:, :count]
            _read_windows(planes, jacobian, known, sharp, shown, step, mean, windows, used, missing, blurred)
            _project_all(windows, basis, products)
            for i in range(count):
                right[:] = products[:, i]
                if missing[i] > 0:
                    _fill_gram(basis, used[:, i], doubt, channels, matrix)
                    _solve(matrix, right)
                for row in range(block * every, min((block + 1) * every, height)):
                    for column in range(lefts[i], min(lefts[i] + every, width)):
                        if described[row, column]:
                            seen[row, column] = blurred[i] == 0
                            for k in range(_COMPONENTS):
                                out[row, column, k] = right[k]
            count = 0


@numba.njit(cache=True, nogil=True)
def gather_neighbours(appearance, jacobian, places, step, out):
    """Lay out the appearances one step away from some pixels.

    Parameters
    ----------
    appearance : (h, w, 8) int16
    jacobian, places, step : see `gather_windows`
    out : (n, 64) int16, output
    """
    height, width = appearance.shape[:2]
    for index in range(places.size):
        y, x = places[index] // width, places[index] % width
        for side in range(8):
            row, column = _advect(jacobian, y, x, _DOWN[side], _ACROSS[side], step)
            r, c = _nearest(row, height), _nearest(column, width)
            for k in range(_COMPONENTS):
                out[index, _COMPONENTS * side + k] = appearance[r, c, k]


@numba.njit(cache=True, nogil=True)
def describe_neighbourhoods(appearance, seen, jacobian, known, step, basis, every, out, whole, first, last):
    """Fill rows ``first`` to ``last`` of blocks of ``out`` with the components of each pixel's neighbourhood.

    Parameters
    ----------
    appearance : (h, w, 8) int16
    seen : (h, w) bool, the pixels whose windows are whole
    jacobian, step, every : see `describe_windows`
    known : (h, w) bool, pixels that are described
    basis : (64, 8) int16, orthonormal but for a factor of 2048
    out : (h, w, 8) int16, output
    whole : (h, w) bool, output: whether all windows are whole, the pixel's own too
    """
    height, width = seen.shape
    sides = paired(basis)
    at = np.empty(8, np.int64)
    total = np.empty((1, _COMPONENTS), np.int16)
    for block in range(first, last):
        for left in range(0, width, every):
            y, x = _middle(known, block * every, left, every)
            if y < 0:
                continue
            complete = seen[y, x]
            for side in range(8):
                row, column = _advect(jacobian, y, x, _DOWN[side], _ACROSS[side], step)
                complete = complete and _is_set(seen, row, column)
                at[side] = _nearest(row, height) * width + _nearest(column, width)
            sum_of_eight(total, 0, appearance, at, sides, 0)
            for row in range(block * every, min((block + 1) * every, height)):
                for column in range(left, min(left + every, width)):
                    if known[row, column]:
                        whole[row, column] = complete and seen[row, column]
                        for k in range(_COMPONENTS):
                            out[row, column, k] = total[0, k]


@numba.njit(cache=True, nogil=True)
def follow(targets, every, whole, jacobian, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with each pixel's target, offset from that of its block's first.

    Parameters
    ----------
    targets : (H, W) int64, row * w + column that the first pixel of each block maps to; -1 for none
    every : side of a block, px
    whole : (h, w) bool, valid targets; pixels whose own would not be valid take that of the first
    jacobian : (h, w, 4) float32, which carries offsets from the first pixel to offsets from its target
    out : (h, w) int32, output; -1 for none
    """
    height, width = whole.shape
    for y in range(first, last):
        for x in range(width):
            top, left = y // every * every, x // every * every
            to = targets[y // every, x // every]
            out[y, x] = to
            if to >= 0 and (y > top or x > left):
                here, there = jacobian[top, left], jacobian[to // width, to % width]
                area = here[0] * here[3] - here[1] * here[2]
                down, across = y - top, x - left
                u = (here[3] * down - here[1] * across) / area
                v = (here[0] * across - here[2] * down) / area
                row = to // width + there[0] * u + there[1] * v
                column = to % width + there[2] * u + there[3] * v
                if _is_set(whole, row, column):
                    out[y, x] = _nearest(row, height) * width + _nearest(column, width)


@numba.njit(cache=True, nogil=True)
def describe_whole(appearance, sides, margin, nearest_valid, jacobian, step, every, far, values, first, last):
    """Fill rows ``first`` to ``last`` of blocks of ``values``, see `texloom.stages.kernels.per_pixel.correction`.

    Parameters
    ----------
    appearance : (rows, pitch, 8) int16, of one level
    sides : (32, 16) int16, of this level
    margin : places around the pixels
    nearest_valid : (rows, pitch) int32: the place itself, row * pitch + column, where its neighbourhood is valid
    jacobian : (h, w, 4) float32, of the pixels
    step : in texture
    every : side, px, of blocks of which one pixel is described for all that are valid
    far : int, the first number of sums of pixels that are not valid
    values : (rows, pitch, d) int16, output; the first 8 of each
    """
    height, width = jacobian.shape[:2]
    pitch, eights = values.shape[1], values.shape[2] // _COMPONENTS
    at = np.empty(8, np.int64)
    for block in range(first, last):
        for left in range(0, width, every):
            row, column = -1, -1
            for y in range(block * every, min((block + 1) * every, height)):
                for x in range(left, min(left + every, width)):
                    place = (y + margin) * pitch + x + margin
                    out = values[y + margin, x + margin]
                    if nearest_valid[y + margin, x + margin] != place:
                        out[0] = far
                    elif row >= 0:
                        for k in range(_COMPONENTS):
                            out[k] = values[row, column, k]
                    else:
                        row, column = y + margin, x + margin
                        for side in range(8):
                            down, across = _advect(jacobian, y, x, _DOWN[side], _ACROSS[side], step)
                            at[side] = (_nearest(down, height) + margin) * pitch + _nearest(across, width) + margin
                        sum_of_eight(values, place * eights, appearance, at, sides, 0)
