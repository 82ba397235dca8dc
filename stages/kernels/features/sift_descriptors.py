"""Features that are found again when a picture is turned or scaled.

Only sums, products, quotients and roots are used, so that bits do not depend on the processor or its C library.
"""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

_BORDER = 5  # px of a level in which nothing is found
_MOVES = 5  # px that a feature may move until it is at an extremum
_FLAT = 0.04  # contrast, 0..1, times the levels of an octave, that is too low
_EDGE = 10.0  # ratio of curvatures that is an edge's
_TURNS = 36  # bins of directions around a feature
_SIDE, _PARTS = 4, 8  # cells along a descriptor's side, and directions in each
_TAU = 2 * math.pi
_HALVES = np.ldexp(1.0, -np.arange(1023))  # 1, 1/2, 1/4 ...


@inner
def _exp_of_minus(x):
    """e to the power of -x, 0 <= x < 700."""
    twos = math.floor(x * 1.4426950408889634 + 0.5)
    rest = (x - twos * 6.93145751953125e-1) - twos * 1.42860682030941723212e-6
    rest = -rest
    square = rest * rest
    above = rest * ((1.26177193074810590878e-4 * square + 3.02994407707441961300e-2) * square + 1.0)
    below = (3.00198505138664455042e-6 * square + 2.52448340349684104192e-3) * square + 2.27265548208155028766e-1
    return (1.0 + 2.0 * (above / (below * square + 2.0 - above))) * _HALVES[int(twos)]


@inner
def _direction(y, x):
    """The angle of (x, y), from 0 up to 2 pi."""
    down, across = abs(y), abs(x)
    if down == 0.0 and across == 0.0:
        return 0.0
    share = min(down, across) / max(down, across)
    begin = 0.0
    if share > 0.41421356237309504880:
        share, begin = (share - 1.0) / (share + 1.0), math.pi / 4
    z = share * share
    above = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z
             - 1.228866684490136173410e2) * z - 6.485021904942025371773e1  # fmt: skip
    below = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z
             + 4.853903996359136964868e2) * z + 1.945506571482613964425e2  # fmt: skip
    angle = begin + share + share * (z * above / below)
    if down > across:
        angle = math.pi / 2 - angle
    if x < 0:
        angle = math.pi - angle
    if y < 0:
        angle = _TAU - angle
    return angle if angle < _TAU else 0.0


@inner
def _is_extremum(levels, layer, y, x):
    value = levels[layer, y, x]
    for k in range(layer - 1, layer + 2):
        for i in range(y - 1, y + 2):
            for j in range(x - 1, x + 2):
                if (value > 0 and levels[k, i, j] > value) or (value < 0 and levels[k, i, j] < value):
                    return False
    return True


@inner
def _candidates(levels, layer, y, least, flags):
    """Mark the pixels of a row, from `_BORDER` on, that no neighbour in their level exceeds."""
    line = levels[layer, y]
    own, before, after = line[_BORDER:], line[_BORDER - 1 :], line[_BORDER + 1 :]
    above, below = levels[layer, y - 1, _BORDER:], levels[layer, y + 1, _BORDER:]
    for x in range(flags.size):
        most = max(before[x], after[x], above[x], below[x])
        lowest = min(before[x], after[x], above[x], below[x])
        flags[x] = ((own[x] > least) & (own[x] >= most)) | ((own[x] < -least) & (own[x] <= lowest))


@inner
def _refined(levels, layer, y, x, out):
    """Fill ``out``, a row of what `find_extrema` returns; false where the contrast is low."""
    count, height, width = levels.shape
    for _ in range(_MOVES):
        v2 = 2.0 * levels[layer, y, x]
        dx = (levels[layer, y, x + 1] - levels[layer, y, x - 1]) * 0.5
        dy = (levels[layer, y + 1, x] - levels[layer, y - 1, x]) * 0.5
        ds = (levels[layer + 1, y, x] - levels[layer - 1, y, x]) * 0.5
        dxx = levels[layer, y, x + 1] + levels[layer, y, x - 1] - v2
        dyy = levels[layer, y + 1, x] + levels[layer, y - 1, x] - v2
        dss = levels[layer + 1, y, x] + levels[layer - 1, y, x] - v2
        dxy = (levels[layer, y + 1, x + 1] - levels[layer, y + 1, x - 1]
               - levels[layer, y - 1, x + 1] + levels[layer, y - 1, x - 1]) * 0.25  # fmt: skip
        dxs = (levels[layer + 1, y, x + 1] - levels[layer + 1, y, x - 1]
               - levels[layer - 1, y, x + 1] + levels[layer - 1, y, x - 1]) * 0.25  # fmt: skip
        dys = (levels[layer + 1, y + 1, x] - levels[layer + 1, y - 1, x]
               - levels[layer - 1, y + 1, x] + levels[layer - 1, y - 1, x]) * 0.25  # fmt: skip
        a, b, c = dyy * dss - dys * dys, dxs * dys - dxy * dss, dxy * dys - dxs * dyy
        whole = dxx * a + dxy * b + dxs * c
        if whole == 0.0:
            return False
        xc = -(a * dx + b * dy + c * ds) / whole
        xr = -(b * dx + (dxx * dss - dxs * dxs) * dy + (dxy * dxs - dxx * dys) * ds) / whole
        xi = -(c * dx + (dxy * dxs - dxx * dys) * dy + (dxx * dyy - dxy * dxy) * ds) / whole
        if abs(xc) < 0.5 and abs(xr) < 0.5 and abs(xi) < 0.5:
            contrast = (levels[layer, y, x] + 0.5 * (dx * xc + dy * xr + ds * xi)) / 255.0
            trace, product = dxx + dyy, dxx * dyy - dxy * dxy
            if abs(contrast) * (count - 2) < _FLAT or product <= 0:
                return False
            if trace * trace * _EDGE >= (_EDGE + 1) * (_EDGE + 1) * product:
                return False
            out[0], out[1], out[2], out[3], out[4], out[5], out[6] = layer, y, x, xi, xr, xc, abs(contrast)
            return True
        if not (abs(xc) < 1e6 and abs(xr) < 1e6 and abs(xi) < 1e6):
            return False
        x, y, layer = x + int(np.rint(xc)), y + int(np.rint(xr)), layer + int(np.rint(xi))
        if not (1 <= layer <= count - 2 and _BORDER <= y < height - _BORDER and _BORDER <= x < width - _BORDER):
            return False
    return False


@compiled
def find_extrema(levels, least):
    """Extrema of differences of blurred pictures.

    Parameters
    ----------
    levels : (layers, h, w) float32, 0..255
    least : smallest difference that counts

    Returns
    -------
    (n, 7) float64: layer, row and column of a pixel, what lies beyond it of each, and the contrast, 0..1
    """
    count, height, width = levels.shape
    found = np.empty((64, 7))
    number = 0
    flags = np.empty(max(width - 2 * _BORDER, 0), np.bool_)
    for layer in range(1, count - 1):
        for y in range(_BORDER, height - _BORDER):
            _candidates(levels, layer, y, np.float32(least), flags)
            for x in range(_BORDER, width - _BORDER):
                if flags[x - _BORDER] and _is_extremum(levels, layer, y, x):
                    if number == len(found):
                        before, found = found, np.empty((2 * number, 7))
                        for i in range(number):
                            for k in range(7):
                                found[i, k] = before[i, k]
                    if _refined(levels, layer, y, x, found[number]):
                        number += 1
    return found[:number]


@compiled
def find_directions(picture, y, x, scale, out):
    """Write the main directions around a pixel of a (h, w) float32 picture to ``out``, (36,), and count them."""
    height, width = picture.shape
    radius, sigma = int(np.rint(4.5 * scale)), 1.5 * scale
    raw, smooth = np.zeros(_TURNS), np.zeros(_TURNS)
    for i in range(max(-radius, 1 - y), min(radius, height - 2 - y) + 1):
        for j in range(max(-radius, 1 - x), min(radius, width - 2 - x) + 1):
            dx = np.float64(picture[y + i, x + j + 1]) - picture[y + i, x + j - 1]
            dy = np.float64(picture[y + i - 1, x + j]) - picture[y + i + 1, x + j]
            share = _exp_of_minus((i * i + j * j) / (2.0 * sigma * sigma))
            turn = int(np.rint(_direction(dy, dx) * (_TURNS / _TAU))) % _TURNS
            raw[turn] += share * math.sqrt(dx * dx + dy * dy)
    most = 0.0
    for k in range(_TURNS):
        near = raw[(k - 1) % _TURNS] + raw[(k + 1) % _TURNS]
        far = raw[(k - 2) % _TURNS] + raw[(k + 2) % _TURNS]
        smooth[k] = (6.0 * raw[k] + 4.0 * near + far) / 16.0
        most = max(most, smooth[k])
    count = 0
    for k in range(_TURNS):
        before, own, after = smooth[(k - 1) % _TURNS], smooth[k], smooth[(k + 1) % _TURNS]
        if own > before and own > after and own >= 0.8 * most:
            turn = k + 0.5 * (before - after) / (before - 2.0 * own + after)
            out[count] = (turn % _TURNS) * (_TAU / _TURNS)
            count += 1
    return count


@compiled
def describe(picture, y, x, cosine, sine, angle, scale, out):
    """Fill ``out``, (128,), with integers that describe what lies around (y, x) of a (h, w) float32 picture."""
    height, width = picture.shape
    step = 3.0 * scale
    diagonal = int(math.sqrt(height * height + width * width))
    radius = min(int(np.rint(step * math.sqrt(2.0) * (_SIDE + 1) * 0.5)), diagonal)
    row, column = int(np.rint(y)), int(np.rint(x))
    cells = np.zeros((_SIDE + 2, _SIDE + 2, _PARTS))
    for i in range(max(-radius, 1 - row), min(radius, height - 2 - row) + 1):
        for j in range(max(-radius, 1 - column), min(radius, width - 2 - column) + 1):
            across, down = (j * cosine - i * sine) / step, (j * sine + i * cosine) / step
            r, c = down + _SIDE / 2 - 0.5, across + _SIDE / 2 - 0.5
            if not (-1 < r < _SIDE and -1 < c < _SIDE):
                continue
            dx = np.float64(picture[row + i, column + j + 1]) - picture[row + i, column + j - 1]
            dy = np.float64(picture[row + i - 1, column + j]) - picture[row + i + 1, column + j]
            away = down * down + across * across
            size = math.sqrt(dx * dx + dy * dy) * _exp_of_minus(away * (2.0 / (_SIDE * _SIDE)))
            turned = _direction(dy, dx) - angle
            turn = (turned if turned >= 0 else turned + _TAU) * (_PARTS / _TAU)
            r0, c0, t0 = math.floor(r), math.floor(c), math.floor(turn)
            r, c, turn = r - r0, c - c0, turn - t0
            for a in range(2):
                by_row = size * (r if a else 1.0 - r)
                for b in range(2):
                    by_column = by_row * (c if b else 1.0 - c)
                    cell = cells[int(r0) + 1 + a, int(c0) + 1 + b]
                    cell[int(t0) % _PARTS] += by_column * (1.0 - turn)
                    cell[int(t0 + 1) % _PARTS] += by_column * turn
    values = np.empty(out.size)
    square = 0.0
    for k in range(out.size):
        values[k] = cells[1 + k // (_SIDE * _PARTS), 1 + k // _PARTS % _SIDE, k % _PARTS]
        square += values[k] * values[k]
    most = 0.2 * math.sqrt(square)
    square = 0.0
    for k in range(out.size):
        values[k] = min(values[k], most)
        square += values[k] * values[k]
    factor = 512.0 / max(math.sqrt(square), 1e-12)
    for k in range(out.size):
        out[k] = min(np.rint(values[k] * factor), 255.0)
