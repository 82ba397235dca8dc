"""Windows and neighbourhoods of a texture that is distorted in its picture.

A window is 5x5 samples one step apart in the texture, a neighbourhood the windows of the eight places one step
away. Offsets are advected a step at a time along the Jacobians, by the midpoint rule.
"""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.short_vectors import paired, sum_of_eight

_SIDE = 2  # samples on each side of a window's middle
_DOWN = (-1, -1, -1, 0, 0, 1, 1, 1)  # the eight neighbours
_ACROSS = (-1, 0, 1, -1, 1, -1, 0, 1)
_COMPONENTS = 8
_VARIATION = 0.01  # of a step from the middle of a tile to its corners, as a share

TILE = 8
"""side, px, of a square of pixels whose windows are read side by side, if the texture is evenly distorted"""

MARGIN = TILE + 1
"""px that planes are continued beyond the border, to read a tile at once"""


@compiled(forceinline=True)
def _nearest(value, size):
    return int(min(max(value + 0.5, 0.0), size - 0.5))


@inner
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


@inner
def _is_set(flags, row, column):
    """Whether the pixel nearest to a position is in the picture and set in ``flags``."""
    r, c = math.floor(row + 0.5), math.floor(column + 0.5)
    return 0 <= r < flags.shape[0] and 0 <= c < flags.shape[1] and flags[r, c]


@inner(forceinline=True)
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


@compiled
def least_stretch(jacobian, used, first, last):
    """The smallest singular value, at most 1, of the Jacobians of the ``used`` pixels of some rows.

    Parameters
    ----------
    jacobian : (h, w, 4) float32, from texture to px
    used : (h, w) bool
    """
    least = 1.0
    for y in range(first, last):
        for x in range(used.shape[1]):
            if used[y, x]:
                a, b = np.float64(jacobian[y, x, 0]), np.float64(jacobian[y, x, 1])
                c, d = np.float64(jacobian[y, x, 2]), np.float64(jacobian[y, x, 3])
                half, area = (a * a + b * b + c * c + d * d) / 2, a * d - b * c
                least = min(least, half - math.sqrt(max(half * half - area * area, 0.0)))
    return math.sqrt(max(least, 0.0))


@compiled
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


@compiled
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


@inner
def _even_side(jacobian, top, left):
    """Side of the parts of a tile within which steps hardly vary."""
    height, width = jacobian.shape[:2]
    side = TILE
    while side > 1:
        bottom, right = min(top + side, height) - 1, min(left + side, width) - 1
        middle = jacobian[(top + bottom) // 2, (left + right) // 2]
        most = 0.0
        for row in (top, bottom):
            for column in (left, right):
                there = jacobian[row, column]
                for axis in range(2):
                    off = (there[axis] - middle[axis]) ** 2 + (there[2 + axis] - middle[2 + axis]) ** 2
                    most = max(most, off / (middle[axis] ** 2 + middle[2 + axis] ** 2))
        if most <= _VARIATION**2:
            break
        side //= 2
    return side


@inner
def _read_tile(planes, known, sharp, top, left, shape, offset, mean, at, windows, used, missing, blurred):
    """Fill the samples at an offset from all pixels of a tile less the mean, 0 where unknown.

    See `describe_windows`.

    Parameters
    ----------
    shape : rows and columns of the tile
    offset : row and column, px
    at : number of the sample
    windows, used : (samples * c, lanes) float32 and (samples, lanes) bool, output
    missing, blurred : (lanes,) uint8, counts of samples that are not known, and not sharp; added to
    """
    rows, columns = shape
    channels, height, width = planes.shape
    down, across = math.floor(offset[0]), math.floor(offset[1])
    p, q = np.float32(offset[0] - down), np.float32(offset[1] - across)
    # nearest pixels; the margin is wide enough to hold all of a tile that is beyond the border
    first = min(max(top + MARGIN + down + (p >= 0.5), 0), height - rows)
    second = min(max(left + MARGIN + across + (q >= 0.5), 0), width - columns)
    complete = True
    for i in range(rows):
        for j in range(columns):
            is_known = known[first + i, second + j]
            used[at, i * columns + j] = is_known
            missing[i * columns + j] += not is_known
            blurred[i * columns + j] += not sharp[first + i, second + j]
            complete &= is_known
    first = min(max(top + MARGIN + down, 0), height - rows - 1)
    second = min(max(left + MARGIN + across, 0), width - columns - 1)
    one = np.float32(1)
    a, b, c, d = (one - p) * (one - q), (one - p) * q, p * (one - q), p * q
    for channel in range(channels):
        out, middle = windows[at * channels + channel], mean[at * channels + channel]
        for i in range(rows):
            upper, lower = planes[channel, first + i], planes[channel, first + i + 1]
            for j in range(columns):
                above = a * upper[second + j] + b * upper[second + j + 1]
                out[i * columns + j] = above + (c * lower[second + j] + d * lower[second + j + 1]) - middle
        if not complete:
            for lane in range(rows * columns):
                out[lane] *= used[at, lane]


@inner
def _project_all(windows, basis, products, lanes):
    """Fill ``products``, (8, n), with those of the windows, (values, n), and the basis."""
    products[:, :lanes] = 0
    for i in range(windows.shape[0]):
        for k in range(_COMPONENTS):
            factor, values, sums = basis[i, k], windows[i], products[k]
            for lane in range(lanes):
                sums[lane] += factor * values[lane]


@inner
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


@compiled
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


@compiled
def describe_windows(
    planes,
    jacobian,
    known,
    sharp,
    described,
    step,
    mean,
    basis,
    doubt,
    scale,
    longest,
    out,
    seen,
    first,
    last,
):
    """Fill rows ``first`` to ``last`` of tiles of ``out`` with the components of each window, as integers.

    All windows of a tile, or of a part of it where the distortion varies, have the same offsets, those of its
    middle. Of windows with unknown samples, the components are the most likely ones given the others.

    Parameters
    ----------
    planes : (c, h + 2 MARGIN, w + 2 MARGIN) float32, continued beyond the border
    jacobian : (h, w, 4) float32, from texture to px
    known : bool, of the size of the planes: pixels that may be read
    sharp : the same: those of them that are as sharp as the level requires
    described : (h, w) bool, pixels that are described, a part of those that may be read; others are left unchanged
    step : in texture
    mean, basis : (25 c,) and (25 c, 8) float32, see `gather_windows`
    doubt : (8,) float64, residual variance of the components divided by that of each component
    scale, longest : float32, factor on the components, and the length to which longer vectors are shortened
    out : (h, w, 8) int16, output
    seen : (h, w) bool, output: whether the whole window is sharp
    """
    height, width = described.shape
    samples = (2 * _SIDE + 1) ** 2
    windows, used = np.zeros((mean.size, TILE * TILE), np.float32), np.empty((samples, TILE * TILE), np.bool_)
    missing, blurred = np.empty(TILE * TILE, np.uint8), np.empty(TILE * TILE, np.uint8)
    products = np.empty((_COMPONENTS, TILE * TILE), np.float32)
    matrix, right = np.empty((_COMPONENTS, _COMPONENTS)), np.empty(_COMPONENTS)
    for place in range(first * -(-width // TILE), last * -(-width // TILE)):
        top, left = place // -(-width // TILE) * TILE, place % -(-width // TILE) * TILE
        side = _even_side(jacobian, top, left)
        for part in range((TILE // side) ** 2):
            y, x = top + part // (TILE // side) * side, left + part % (TILE // side) * side
            rows, columns = min(side, height - y), min(side, width - x)
            if not described[y : y + rows, x : x + columns].any():
                continue
            missing[:], blurred[:] = 0, 0
            for at in range(samples):
                down, across = at // (2 * _SIDE + 1) - _SIDE, at % (2 * _SIDE + 1) - _SIDE
                middle = y + rows // 2, x + columns // 2
                to = _advect(jacobian, *middle, down, across, step)
                shape, offset = (rows, columns), (to[0] - middle[0], to[1] - middle[1])
                _read_tile(planes, known, sharp, y, x, shape, offset, mean, at, windows, used, missing, blurred)
            _project_all(windows, basis, products, rows * columns)
            for lane in range(rows * columns):
                row, column = y + lane // columns, x + lane % columns
                if described[row, column]:
                    right[:] = products[:, lane]
                    if missing[lane] > 0:
                        _fill_gram(basis, used[:, lane], doubt, mean.size // samples, matrix)
                        _solve(matrix, right)
                    length = scale * math.sqrt(np.square(right).sum())
                    factor = scale * min(1.0, longest / max(length, 1e-6))
                    for k in range(_COMPONENTS):
                        out[row, column, k] = int(factor * right[k])
                    seen[row, column] = blurred[lane] == 0


@compiled
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


@compiled
def describe_neighbourhoods(appearance, seen, jacobian, described, step, basis, every, out, whole, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with the components of each ``every``-th pixel's neighbourhood.

    Parameters
    ----------
    appearance : (h, w, 8) int16
    seen : (h, w) bool, the pixels whose windows are whole
    jacobian, step : see `describe_windows`
    described : (h, w) bool, pixels that are described; others are left unchanged
    basis : (64, 8) int16, orthonormal but for a factor of 2048
    every : px, between rows and columns that are described
    out : (ceil(h / every), ceil(w / every), 8) int16, output
    whole : (ceil(h / every), ceil(w / every)) bool, output: whether all windows are whole, the pixel's own too
    """
    height, width = seen.shape
    sides = paired(basis)
    at = np.empty(8, np.int64)
    for i in range(first, last):
        for j in range(out.shape[1]):
            y, x = i * every, j * every
            if described[y, x]:
                complete = seen[y, x]
                for side in range(8):
                    row, column = _advect(jacobian, y, x, _DOWN[side], _ACROSS[side], step)
                    complete = complete and _is_set(seen, row, column)
                    at[side] = _nearest(row, height) * width + _nearest(column, width)
                sum_of_eight(out, i * out.shape[1] + j, appearance, at, sides, 0)
                whole[i, j] = complete


@compiled
def interpolate(grid, every, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with what is between the values of every ``every``-th pixel.

    Parameters
    ----------
    grid : (ceil(h / every), ceil(w / every), c) of any type
    out : (h, w, c) of the same type, output; integers are rounded towards 0
    """
    rows, columns, channels = grid.shape
    share = np.float32(1 / every)
    for y in range(first, last):
        upper, lower = grid[y // every], grid[min(y // every + 1, rows - 1)]
        p = share * np.float32(y % every)
        for x in range(out.shape[1]):
            left, right = x // every, min(x // every + 1, columns - 1)
            q = share * np.float32(x % every)
            for k in range(channels):
                above = upper[left, k] + q * (upper[right, k] - upper[left, k])
                below = lower[left, k] + q * (lower[right, k] - lower[left, k])
                out[y, x, k] = above + p * (below - above)


@compiled
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


@compiled
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
