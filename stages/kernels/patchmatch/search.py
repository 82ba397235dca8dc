"""PatchMatch over an integer correspondence, with an occurrence penalty on every exemplar patch.

Features are int16 fixed point, pixels in rows of ``width * channels`` values, so distances are exact integers and
results do not depend on the processor. A correspondence is two int32 arrays ``row`` and ``column`` of shape
(patches down, patches across): the exemplar patch (by its top-left pixel) that a target patch is matched with.
"""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.row_distance import LENGTHS, row_distance, two_row_distance

_DRAWS = 5  # positions drawn for one random try until one passes the limit on the occurrence penalty
_USUAL = (20, 24, 40, 48, 80, 96)  # values in a row by the presets; kernels for one length save up to a tenth
_OPEN, _FORWARD, _BACKWARD = 1, 2, 4  # of `Target.active`
ALL_ACTIVE = _OPEN | _FORWARD | _BACKWARD
"""the flags of a target patch of which nothing is known"""


class PatchShape(NamedTuple):
    """Size of a patch."""

    size: int
    """side, px"""
    run: Any
    """values in a row of a patch; or as many int8, where the compiler is to know how many"""
    channels: int

    @classmethod
    def of(cls, size: int, channels: int) -> "PatchShape":
        """Patches of ``size`` x ``size`` pixels with ``channels`` values each."""
        values = size * channels
        known = values in _USUAL or values not in LENGTHS
        return cls(size, (np.int8(0),) * values if known else values, channels)


class Target(NamedTuple):
    """A target and its matches, which the search changes in place."""

    features: Any
    """(H, W * channels) int16; padded by a patch less one along axes that wrap"""
    row: Any
    """(p, q) int32"""
    column: Any
    """(p, q) int32"""
    distance: Any
    """(p, q) int64, of the matches"""
    active: Any
    """(p, q) uint8, 0 where all four neighbours are known to propose the match; else 1, and 2 if a neighbour may
    propose something new in a forward scan, 4 if in a backward scan"""


class SearchedExemplar(NamedTuple):
    """An exemplar and its occurrence penalties, which do not change during a scan."""

    features: Any
    """(h, w * channels) int16"""
    penalty: Any
    """(h - size + 1, w - size + 1) float32, whole numbers, of every patch; larger ones take longer to read"""
    own_penalty: Any
    """int64, what a new match adds to the penalty of its patch"""
    penalty_limit: Any
    """int64, above which random search rejects a patch"""
    unused_row: Any
    """(m,) int32, patches drawn in proportion to how little they are used"""
    unused_column: Any
    """(m,) int32"""


class Scan(NamedTuple):
    """What differs between the scans of a search."""

    forward: bool
    """direction"""
    wrap: Any
    """texloom.stages.vocabulary.facts.Wraps, whether the target continues ``down`` and ``across`` its borders"""
    radii: Any
    """(n,) int64, px, of each random try around the match: half the side of the square where it is made"""
    distance_per_try: Any
    """int64; a patch has one of the random tries for every such distance to its match, the last ones, and at most
    all; 0 for all"""
    fill_tries: int
    """tries at little used patches"""
    key: Any
    """uint64, of the random numbers"""
    everywhere: bool
    """all active patches are visited, as random tries need or a new target; else those to which a neighbour may
    propose something new"""


@compiled(inline="always")
def random_bits(key, position, counter):
    """64 random bits that depend on nothing but the arguments (the finaliser of SplitMix64)."""
    bits = key + np.uint64(position) * np.uint64(0x9E3779B97F4A7C15)
    bits += np.uint64(counter) * np.uint64(0xD1B54A32D192ED03)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@compiled
def count_matches(row, column, counts):
    """Add to ``counts``, integers, how often each exemplar patch is a match, by ``row`` and ``column``, int32."""
    for y in range(row.shape[0]):
        for x in range(row.shape[1]):
            counts[row[y, x], column[y, x]] += 1


@compiled
def count_moves(moves, counts):
    """Update ``counts``, those of all exemplar patches in one row, by what `sweep` returns."""
    for k in range(moves.shape[0]):
        counts[moves[k, 0]] -= 1
        counts[moves[k, 1]] += 1


@compiled
def occurrence_penalty(counts, patch_size, penalty_per_use, penalty):
    """Fill ``penalty`` with the occurrence map's mean over each exemplar patch, times ``penalty_per_use``.

    The occurrence map counts for each exemplar pixel the target patches that cover it [Kaspar2015]_ (3); its mean
    over a patch is (6). Both are box sums, so the mean over all patches costs a few passes over the exemplar.

    Parameters
    ----------
    counts : (h, w) int32, see `count_matches`, h and w the exemplar's patches down and across.
    penalty_per_use : float64, penalty of one use of every pixel of a patch.
    penalty : (h, w) float32, output, whole numbers.
    """
    height, width = counts.shape
    nothing = np.zeros(width, np.int32)
    padded = np.zeros(width + 2 * patch_size, np.int64)
    total = padded[patch_size : patch_size + width]
    above, below = np.zeros(width, np.int32), np.zeros(width, np.int32)
    # A patch at distance (dy, dx) shares (patch_size - |dy|) * (patch_size - |dx|) pixels: two tents, one an axis.
    for y in range(min(patch_size, height)):
        for x in range(width):
            total[x] += (patch_size - y) * counts[y, x]
            below[x] += counts[y, x]
    scale = penalty_per_use / (patch_size * patch_size)
    for y in range(height):
        _tents_across(padded, patch_size, scale, penalty[y])
        # From row to row each value above counts once less, each below once more.
        here = counts[y]
        gone = counts[y - patch_size] if y >= patch_size else nothing
        next_below = counts[y + patch_size] if y + patch_size < height else nothing
        for x in range(width):
            above[x] += here[x] - gone[x]
            below[x] += next_below[x] - here[x]
            total[x] += below[x] - above[x]


@compiled
def add_prices(prices, side, parts, least, lowest, penalty):
    """Add the price of the cell in which each exemplar patch lies to ``penalty``, as far as it is above the least.

    Parameters
    ----------
    prices : (rows, columns) float32, whole numbers.
    side : height and width of a cell, px.
    parts : (h, w) uint8, number of the part in which each patch lies, or None for one of all.
    least : (number of parts,) float32, price of each that is not added.
    lowest : float32, the lowest of these.
    penalty : (h, w) float32, changed in place.
    """
    height, width = penalty.shape
    down, across = side
    for y in range(height):
        of_cells = prices[y // down]
        for column in range(of_cells.size):
            price = of_cells[column]
            if price <= lowest:
                continue
            for x in range(column * across, min((column + 1) * across, width)):
                if parts is None:
                    penalty[y, x] += price - lowest
                else:
                    penalty[y, x] += max(price - least[parts[y, x]], np.float32(0))


@compiled
def find_parts(parts, side, found):
    """Set ``found``, (rows, columns, number of parts) bool, where a cell has patches of a part."""
    height, width = parts.shape
    down, across = side
    for y in range(height):
        of_cells = found[y // down]
        for column in range(found.shape[1]):
            for x in range(column * across, min((column + 1) * across, width)):
                of_cells[column, parts[y, x]] = True


@compiled
def sums_of_cells(values, side, sums):
    """Fill ``sums``, (rows, columns) int64, with those of ``values``, (h, w) int32, over cells of ``side`` px."""
    height, width = values.shape
    down, across = side
    sums[:] = 0
    for y in range(height):
        of_cells = sums[y // down]
        for column in range(of_cells.size):
            total = np.int64(0)
            for x in range(column * across, min((column + 1) * across, width)):
                total += values[y, x]
            of_cells[column] += total


@compiled
def match_energy(row, column, distance, penalty, first, last):
    """Sums of the distances and of the penalties of the matches of rows ``first`` to ``last``, int64."""
    energy, penalised = np.int64(0), np.int64(0)
    for y in range(first, last):
        for x in range(row.shape[1]):
            energy += distance[y, x]
            penalised += np.int64(penalty[row[y, x], column[y, x]])
    return energy, penalised


@inner
def _tents_across(values, side, scale, penalty):
    """Fill ``penalty`` with the sums of ``values`` under tents of half width and height ``side``, times ``scale``.

    ``values`` has ``side`` zeros before and after those of the row.
    """
    total, above, below = np.int64(0), np.int64(0), np.int64(0)
    for x in range(side):
        total += (side - x) * values[side + x]
        below += values[side + x]
    for x in range(penalty.size):
        penalty[x] = np.float32(np.rint(total * scale))
        here = values[side + x]
        above += here - values[x]
        below += values[x + 2 * side] - here
        total += below - above


@inner(forceinline=True)
def patch_distance(shape, target, target_row, target_column, exemplar, row, column, limit):
    """Sum of squared differences of two patches, int64; anything at or above ``limit`` once that is reached."""
    target_pitch, exemplar_pitch = np.uint64(target.shape[1]), np.uint64(exemplar.shape[1])
    target_start = np.uint64(target_row) * target_pitch + np.uint64(target_column * shape.channels)
    exemplar_start = np.uint64(row) * exemplar_pitch + np.uint64(column * shape.channels)
    total = np.int64(0)
    for _ in range(shape.size // 2):
        total += two_row_distance(target, target_start, exemplar, exemplar_start, shape.run)
        if total >= limit:
            return total
        target_start += target_pitch + target_pitch
        exemplar_start += exemplar_pitch + exemplar_pitch
    if shape.size % 2:
        total += row_distance(target, target_start, exemplar, exemplar_start, shape.run)
    return total


@inner(forceinline=True)
def _distance_beside(shape, target, target_row, target_column, exemplar, row, column, step, neighbour, distance):
    """Distance of two patches, from the ``distance`` of those a row before both, or with a ``step`` of -1 after.

    They share all but one row. ``neighbour`` is the row of the target patch before, perhaps the last.
    """
    gone, new = (0, shape.size - 1) if step > 0 else (shape.size - 1, 0)
    target_pitch, exemplar_pitch = np.uint64(target.shape[1]), np.uint64(exemplar.shape[1])
    target_start, exemplar_start = np.uint64(target_column * shape.channels), np.uint64(column * shape.channels)
    distance += row_distance(
        target, np.uint64(target_row + new) * target_pitch + target_start,
        exemplar, np.uint64(row + new) * exemplar_pitch + exemplar_start, shape.run,
    )  # fmt: skip
    return distance - row_distance(
        target, np.uint64(neighbour + gone) * target_pitch + target_start,
        exemplar, np.uint64(row - step + gone) * exemplar_pitch + exemplar_start, shape.run,
    )  # fmt: skip


@compiled
def match_distances(shape, target, exemplar, first, last):
    """Fill rows ``first`` to ``last`` of ``target.distance``; their sum, int64.

    Parameters
    ----------
    shape : PatchShape
    target : Target
    exemplar : (h, w * channels) int16, the exemplar's features
    """
    features, row, column, distance = target.features, target.row, target.column, target.distance
    no_limit, all_distances = np.int64(2**62), np.int64(0)
    for y in range(first, last):
        for x in range(row.shape[1]):
            r, c = np.int64(row[y, x]), np.int64(column[y, x])
            if y > first and row[y - 1, x] + 1 == r and column[y - 1, x] == c:
                d = _distance_beside(shape, features, y, x, exemplar, r, c, np.int64(1), y - 1, distance[y - 1, x])
            else:
                d = patch_distance(shape, features, y, x, exemplar, r, c, no_limit)
            distance[y, x] = d
            all_distances += d
    return all_distances


@compiled(forceinline=True)
def wrap_index(index, size, wrap):
    """An index at most ``size`` beyond an axis, wrapped around if it does so, else -1 where there is nothing."""
    if 0 <= index < size:
        return index
    if not wrap:
        return -1
    return index + size if index < 0 else index - size


@inner(inline="always")
def cross_step(number):
    """Rows and columns to one of the four neighbours of a pixel: above, left, below, right."""
    return (number - 1 if number % 2 == 0 else 0), (number - 2 if number % 2 == 1 else 0)


@inner(inline="always")
def square_step(number):
    """Rows and columns to one of the 3x3 pixels around a pixel, which itself is the first."""
    return (number + 4) % 9 // 3 - 1, (number + 4) % 9 % 3 - 1


@inner(forceinline=True)
def _shifted_match(row, column, y, x, dy, dx, wrap):
    """The exemplar patch that continues the match of the target patch (dy, dx) beside; -1, -1 if there is none."""
    ny, nx = wrap_index(y + dy, row.shape[0], wrap.down), wrap_index(x + dx, row.shape[1], wrap.across)
    if ny < 0 or nx < 0:
        return np.int64(-1), np.int64(-1)
    return np.int64(row[ny, nx]) - dy, np.int64(column[ny, nx]) - dx


@inner(forceinline=True)
def _is_coherent(row, column, y, x, wrap):
    """Whether all four neighbours of a target patch propose the match that it has."""
    for side in range(4):
        dy, dx = cross_step(side)
        ny, nx = wrap_index(y + dy, row.shape[0], wrap.down), wrap_index(x + dx, row.shape[1], wrap.across)
        if ny < 0 or nx < 0:
            continue
        if row[ny, nx] - dy != row[y, x] or column[ny, nx] - dx != column[y, x]:
            return False
    return True


@compiled(inline="always")
def _below(bits, count):
    """A number from 0 to ``count`` - 1 from the lower 32 of random bits, without a division, which is slow."""
    return np.int64((bits & np.uint64(0xFFFFFFFF)) * np.uint64(count) >> np.uint64(32))


@inner(forceinline=True)
def _random_near(penalty, row, column, radius, limit, key, position, counter):
    """A random patch around another whose penalty is within ``limit``, in at most `_DRAWS` draws; else -1, -1."""
    low_row, high_row = max(0, row - radius), min(penalty.shape[0] - 1, row + radius)
    low_column, high_column = max(0, column - radius), min(penalty.shape[1] - 1, column + radius)
    for draw in range(_DRAWS):
        bits = random_bits(key, position, counter + draw)
        r = low_row + _below(bits >> np.uint64(32), high_row - low_row + 1)
        c = low_column + _below(bits, high_column - low_column + 1)
        if np.int64(penalty[r, c]) <= limit:
            return r, c
    return np.int64(-1), np.int64(-1)


@compiled
def sweep(shape, target, exemplar, scan, first, last):
    """One scan of PatchMatch over the target patches of rows ``first`` to ``last``.

    Propagation from the two neighbours behind, then random search around the match, then tries at little used
    patches. A patch whose four neighbours all agree with it is left alone, and where the scan does not go
    ``everywhere``, one whose neighbours behind propose what they have proposed before. Random search rejects what
    costs more than the limit and no less than the match at the start of the visit: the paper leaves open whether
    the best match so far is meant instead.

    Parameters
    ----------
    shape : PatchShape
    target : Target, its matches and distances are changed in place
    exemplar : SearchedExemplar
    scan : Scan

    Returns
    -------
    (n, 2) int64, number of the exemplar patch, row by row, that each changed match had before and has now; and the
    number of distances that were compared.
    """
    row, column, distance, penalty = target.row, target.column, target.distance, exemplar.penalty
    features, exemplar_features, wrap = target.features, exemplar.features, scan.wrap
    active = target.active
    across = row.shape[1]
    rows, columns = penalty.shape
    own_penalty = exemplar.own_penalty
    step, tries = 1 if scan.forward else -1, scan.radii.size
    due, other = (_FORWARD, _BACKWARD) if scan.forward else (_BACKWARD, _FORWARD)
    moves = np.empty(((last - first) * across, 2), np.int64)
    changed, compared = 0, 0
    for i in range(last - first):
        y = first + i if scan.forward else last - 1 - i
        for j in range(across):
            x = j if scan.forward else across - 1 - j
            state = active[y, x]
            if not (state if scan.everywhere else state & due):
                continue
            if _is_coherent(row, column, y, x, wrap):
                active[y, x] = 0
                continue
            active[y, x] = _OPEN | other if scan.everywhere else state & ~due
            patch = y * across + x
            best_row, best_column, best_distance = np.int64(row[y, x]), np.int64(column[y, x]), distance[y, x]
            best_penalty = np.int64(penalty[best_row, best_column])
            best_cost = best_distance + best_penalty
            limit = max(exemplar.penalty_limit, best_penalty - 1)
            above = wrap_index(y - step, row.shape[0], wrap.down)  # or below, if the scan goes backward
            last_row, last_column = np.int64(-1), np.int64(-1)  # compared; both neighbours often propose the same
            omitted = 0
            if scan.distance_per_try > 0:
                omitted = tries - min(tries, best_distance // scan.distance_per_try)
            for number in range(omitted - 2, tries + scan.fill_tries):
                attempt = number if number >= omitted else number - omitted
                if attempt == -2:
                    r, c = _shifted_match(row, column, y, x, -step, np.int64(0), wrap)
                elif attempt == -1:
                    r, c = _shifted_match(row, column, y, x, np.int64(0), -step, wrap)
                elif attempt < tries:
                    counter = attempt * _DRAWS
                    r, c = _random_near(
                        penalty, best_row, best_column, scan.radii[attempt], limit, scan.key, patch, counter
                    )
                else:
                    place = _below(random_bits(scan.key, patch, attempt * _DRAWS), exemplar.unused_row.size)
                    r, c = np.int64(exemplar.unused_row[place]), np.int64(exemplar.unused_column[place])
                if r < 0 or r >= rows or c < 0 or c >= columns:
                    continue
                added = np.int64(penalty[r, c]) + own_penalty
                if (
                    added >= best_cost
                    or (r == best_row and c == best_column)
                    or (r == last_row and c == last_column)
                ):
                    continue
                last_row, last_column = r, c
                compared += 1
                if attempt == -2:
                    d = _distance_beside(
                        shape, features, y, x, exemplar_features, r, c, step, above, distance[above, x]
                    )
                else:
                    d = patch_distance(shape, features, y, x, exemplar_features, r, c, best_cost - added)
                if d + added < best_cost:
                    best_cost, best_distance, best_row, best_column = d + added, d, r, c
            if best_row != row[y, x] or best_column != column[y, x]:
                moves[changed, 0] = np.int64(row[y, x]) * columns + column[y, x]
                moves[changed, 1] = best_row * columns + best_column
                row[y, x], column[y, x], distance[y, x] = best_row, best_column, best_distance
                changed += 1
                for side in range(4):
                    dy, dx = cross_step(side)
                    ny = wrap_index(y + dy, row.shape[0], wrap.down)
                    nx = wrap_index(x + dx, across, wrap.across)
                    if ny >= 0 and nx >= 0:
                        # Those above and to the left propagate from here when a scan goes backward.
                        active[ny, nx] |= _OPEN | (_BACKWARD if side < 2 else _FORWARD)
    return moves[:changed], compared
