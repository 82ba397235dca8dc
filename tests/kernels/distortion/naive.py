"""Slow readable twins of the kernels of distorted textures."""

import math

import numpy as np

from tests.kernels.core.naive import bilinear, sampled


def blur_along(
    planes: np.ndarray, jacobian: np.ndarray, usable: np.ndarray, sigma: np.ndarray, axis: int
) -> np.ndarray:
    """See `texloom.stages.kernels.distortion.blur`."""
    height, width, _ = planes.shape
    out = planes.astype(np.float64)

    def pixel(place: np.ndarray) -> tuple[int, int] | None:
        row, column = round(place[0]), round(place[1])
        return (row, column) if 0 <= row < height and 0 <= column < width else None

    for y, x in np.argwhere(usable & (sigma > 0)):
        total, weight = planes[y, x].astype(np.float64), 1.0
        for side in (-1, 1):
            place, step = np.array([y, x], float), side * 0.75 * sigma[y, x]
            here: tuple[int, int] | None = (y, x)
            for number in range(1, 5):
                assert here is not None
                half = pixel(place + step / 2 * jacobian[here][[axis, 2 + axis]])
                if half is None:
                    break
                here, place = half, place + step * jacobian[half][[axis, 2 + axis]]
                there = pixel(place)
                if there is None or not usable[there]:
                    break
                share = np.exp(-((0.75 * number) ** 2) / 2)
                total += share * bilinear(planes, *place)
                weight += share
        out[y, x] = total / weight
    return out


def cover(controls: np.ndarray, shape: tuple[int, int], dense: int) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels a patch covers, and (u, v) of the nearest of ``dense`` x ``dense`` points of it."""
    at = np.linspace(0, 1, dense)
    basis = np.stack([(1 - at) ** 3, 3 * at * (1 - at) ** 2, 3 * at**2 * (1 - at), at**3], axis=1)
    points = np.einsum("ui,vj,ijk->uvk", basis, basis, controls)
    points = points[..., :2] / points[..., 2:]
    near, place = np.zeros(shape, bool), np.zeros((*shape, 2))
    for row in range(shape[0]):
        for column in range(shape[1]):
            away = np.abs(points - [row, column]).max(axis=2)
            i, j = np.unravel_index(away.argmin(), away.shape)
            near[row, column] = away[i, j] < 0.5
            place[row, column] = at[i], at[j]
    return near, place


def landed(jacobian: np.ndarray, place: tuple[int, int], down: int, across: int, step: float) -> np.ndarray:
    """Where so many steps down and across the texture lead, see `stages.kernels.distortion.distorted_windows`."""
    last = np.array(jacobian.shape[:2]) - 1
    times = max(abs(down), abs(across))
    at = np.array(place, float)
    for _ in range(times):
        probe = at
        for share in (0.5, 1.0):
            near = np.clip(np.floor(probe + 0.5).astype(int), 0, last)
            move = jacobian[tuple(near)].reshape(2, 2) @ (np.array([down, across]) * step / times)
            probe = at + share * move
        at = probe
    return at


def stands_on(mask: np.ndarray, place: np.ndarray) -> bool:
    """Whether a place lies on a pixel of the mask."""
    row, column = np.floor(place + 0.5).astype(int)
    return bool(0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and mask[row, column])


def window(
    planes: np.ndarray, jacobian: np.ndarray, known: np.ndarray, place: tuple[int, int], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """The 25 samples around a pixel, and which of them are known."""
    values, found = [], []
    for down in range(-2, 3):
        for across in range(-2, 3):
            at = landed(jacobian, place, down, across, step)
            values.append(bilinear(planes, *at))
            found.append(stands_on(known, at))
    return np.array(values), np.array(found)


def described(
    values: np.ndarray, found: np.ndarray, mean: np.ndarray, basis: np.ndarray, doubt: np.ndarray
) -> np.ndarray:
    """Components of a window; the most likely ones, given what is known of it."""
    used = np.repeat(found, values.shape[1])
    part = (values.ravel() - mean)[used]
    if found.all():
        return np.asarray(part @ basis)
    return np.linalg.solve(basis[used].T @ basis[used] + np.diag(doubt), basis[used].T @ part)


def cubic_b_spline(x: float) -> float:
    """The cubic B-spline with knots at whole numbers, symmetric around 0."""
    x = abs(x)
    if x < 1:
        return (4 - 6 * x**2 + 3 * x**3) / 6
    return (2 - x) ** 3 / 6 if x < 2 else 0.0


def control_weights(
    position: np.ndarray, low: np.ndarray, spacing: np.ndarray, wrap: bool, shape: tuple[int, int]
) -> dict[tuple[int, int], list[float]]:
    """For every control point near a position its weights; on a small torus one point may have several."""
    at = (position - low) / spacing
    if not wrap:
        at = np.clip(at, 0, np.array(shape) - 3)
    found: dict[tuple[int, int], list[float]] = {}
    for i in range(math.floor(at[0]) - 2, math.floor(at[0]) + 4):
        for j in range(math.floor(at[1]) - 2, math.floor(at[1]) + 4):
            weight = cubic_b_spline(at[0] - i) * cubic_b_spline(at[1] - j)
            if weight > 0:
                # without wrap-around the control point of cell 0 is the second: one stands before the box
                point = (i % shape[0], j % shape[1]) if wrap else (i + 1, j + 1)
                found.setdefault(point, []).append(weight)
    return found


def approximate(
    positions: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    spacing: np.ndarray,
    wrap: bool,
    shape: tuple[int, int],
) -> np.ndarray:
    """Lee, Wolberg and Shin's control lattice: equations 3 to 5."""
    above, below = np.zeros((*shape, 2)), np.zeros(shape)
    for position, value in zip(positions, values, strict=True):
        near = control_weights(position, low, spacing, wrap, shape)
        squares = sum(weight**2 for weights in near.values() for weight in weights)
        for point, weights in near.items():
            for weight in weights:
                above[point] += weight**2 * (weight * value / squares)
                below[point] += weight**2
    return np.divide(above, below[..., None], out=np.zeros_like(above), where=below[..., None] > 0)


def deform(
    control: np.ndarray, low: np.ndarray, spacing: np.ndarray, wrap: bool, positions: np.ndarray
) -> np.ndarray:
    """Positions plus the spline's values there."""
    moved = positions.copy()
    for index, position in enumerate(positions):
        for point, weights in control_weights(position, low, spacing, wrap, control.shape[:2]).items():
            moved[index] += sum(weights) * control[point]
    return moved


def line_mean(noise: np.ndarray, angle: np.ndarray, length: int, y: int, x: int) -> float:
    """Mean of ``noise`` along the field line through a pixel, ``length`` steps to both sides or to the border."""
    met = [noise[y, x]]
    for sign in (1, -1):
        place = np.array([y, x], np.float64)
        step = sign * np.array([np.sin(angle[y, x]), np.cos(angle[y, x])], np.float64)
        for _ in range(length):
            place = place + step
            row, column = np.rint(place).astype(int)
            if not (0 <= row < noise.shape[0] and 0 <= column < noise.shape[1]):
                break
            met.append(noise[row, column])
            there = np.array([np.sin(angle[row, column]), np.cos(angle[row, column])], np.float64)
            step = there if there @ step >= 0 else -there
    return float(np.mean(met))


def feature_distances(mask: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Distances in texture to the features that neighbours have passed on; six sweeps down and up at most.

    A sweep takes each row from left to right, with the three pixels before it and the one to the left, and then
    back, with the one to the right.
    """
    height, width = mask.shape
    found = {(int(y), int(x)): (int(y), int(x)) for y, x in np.argwhere(mask)}

    def length(pixel: tuple[int, int], feature: tuple[int, int]) -> float:
        middle = (pixel[0] + feature[0]) // 2, (pixel[1] + feature[1]) // 2
        mean = (inverse[pixel] + 4 * inverse[middle] + inverse[feature]).reshape(2, 2) / 6
        return float(np.linalg.norm(mean @ np.subtract(pixel, feature)))

    def visit(y: int, x: int, sides: list[tuple[int, int]]) -> None:
        for dy, dx in sides:
            offered = found.get((y + dy, x + dx))
            if offered and ((y, x) not in found or length((y, x), offered) < length((y, x), found[y, x])):
                found[y, x] = offered

    for _ in range(6):
        for before, rows in ((-1, range(height)), (1, range(height - 1, -1, -1))):
            for y in rows:
                for x in range(width):
                    visit(y, x, [(before, -1), (before, 0), (before, 1), (0, -1)])
                for x in range(width - 1, -1, -1):
                    visit(y, x, [(0, 1)])
    return np.array([[length((y, x), found[y, x]) for x in range(width)] for y in range(height)])


def way_to_border(mask: np.ndarray, jacobian: np.ndarray, axis: int, farthest: float, y: int, x: int) -> float:
    """Length in texture of the nearer way along a direction to where ``mask`` changes; negative inside it."""
    nearest = farthest
    for side in (-1, 1):
        place, length = np.array([y, x], float), 0.0
        at = (y, x)
        while length < nearest:
            step = jacobian[at].astype(float)[[axis, 2 + axis]]
            place += side * step / np.hypot(*step)
            length += 1 / np.hypot(*step)
            at = (round(place[0]), round(place[1]))
            if not (0 <= at[0] < mask.shape[0] and 0 <= at[1] < mask.shape[1]):
                break
            if mask[at] != mask[y, x]:
                nearest = min(nearest, length)
                break
    return -nearest if mask[y, x] else nearest


def ellipse_mean(pixels: np.ndarray, usable: np.ndarray, place: np.ndarray, foot: np.ndarray) -> np.ndarray:
    """Mean of a picture under the ellipse of ``foot``, (2, 2), whose axes are at least a px."""
    axes, sizes, _ = np.linalg.svd(foot)
    shape = axes @ np.diag(np.maximum(sizes, 1)) @ axes.T
    last = np.array(pixels.shape[:2]) - 1
    place = np.clip(place, 0, last)
    away = (np.moveaxis(np.indices(pixels.shape[:2]), 0, 2) - place) @ np.linalg.inv(shape).T
    scale = np.hypot(*shape)
    width = np.sqrt(np.maximum(scale**2 - 1, 0))
    at = np.arange(-500, 500)[:, None] / 1000 + 0.0005
    share = np.empty(away.shape)
    for axis in (0, 1):
        t = away[..., axis].ravel() * scale[axis] + at * width[axis]
        lanczos = np.where(np.abs(t) < 3, np.sinc(t) * np.sinc(t / 3), 0)
        share[..., axis] = lanczos.mean(axis=0).reshape(usable.shape)
    share = share.prod(axis=2) * usable
    near = usable & (np.abs(away) < 1 - 1e-9).all(axis=2)
    if not near.any():
        return np.asarray(pixels[tuple(np.rint(place).astype(int))])
    low, high = pixels[near].min(axis=0), pixels[near].max(axis=0)
    if share.sum() <= 0.5 * np.linalg.det(shape) / scale.prod():
        share = np.maximum(share, 0)
    return np.asarray(np.clip((share[..., None] * pixels).sum(axis=(0, 1)) / share.sum(), low, high))


def find_positions(
    chart: np.ndarray, jacobian: np.ndarray, sharp: np.ndarray, steps: int, most: float, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    position, shown = start.copy(), np.zeros(start.shape[:2], bool)
    for target in np.ndindex(shown.shape):
        for _ in range(steps):
            at = tuple(np.rint(position[target]).astype(int))
            step = jacobian[at].reshape(2, 2) @ (target - sampled(chart, *position[target]))
            position[target] = np.clip(position[target] + step, 0, np.array(sharp.shape) - 1)
        at = tuple(np.rint(position[target]).astype(int))
        shown[target] = sharp[at] and (np.abs(target - sampled(chart, *position[target])) < most).all()
    return position, shown
