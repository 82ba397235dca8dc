"""Slow readable twins of the kernels of cells."""

import itertools

import numpy as np

from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT


def basins(values: np.ndarray, depth: float) -> np.ndarray:
    """The basin of each pixel: sets of pixels that grow from the lowest value on."""
    height, width = values.shape
    label = np.full((height, width), -1)
    lowest: list[float] = []
    for place in np.argsort(values, axis=None, kind="stable").tolist():
        row, column = divmod(place, width)
        sides = [(row - 1, column), (row, column - 1), (row, column + 1), (row + 1, column)]
        near = [side for side in sides if 0 <= side[0] < height and 0 <= side[1] < width and label[side] >= 0]
        if not near:
            label[row, column] = len(lowest)
            lowest.append(float(values[row, column]))
            continue
        own = int(label[min(near, key=lambda side: values[side])])
        label[row, column] = own
        for side in near:
            other = int(label[side])
            if other != own and values[row, column] - max(lowest[own], lowest[other]) < depth:
                label[label == other] = own
                lowest[own] = min(lowest[own], lowest[other])
    return label


def fit(
    lab: np.ndarray,
    places: np.ndarray,
    points: np.ndarray,
    weights: np.ndarray,
    wanted: np.ndarray,
    shift: np.ndarray,
) -> float:
    """Weighted squared difference; infinite where a pixel may not be used."""
    moved = points + shift
    if (moved < 0).any() or (moved >= lab.shape[:2]).any() or not places[tuple(moved.T)].all():
        return np.inf
    difference = lab[tuple(moved.T)].astype(np.float64) - wanted
    return float((weights * (difference**2).sum(axis=1)).sum())


def seams(
    lab: np.ndarray,
    slopes: np.ndarray,
    inside: np.ndarray,
    offset: float,
    unit: float,
    most: float,
    source: np.ndarray,
    state: np.ndarray,
) -> int:
    """Cost of all seams of a window with these sources, but those between kept pixels or beside absent ones."""
    last = np.array(lab.shape[:2]) - 1
    total = 0
    for axis, step in enumerate(np.array([[1, 0], [0, 1]])):
        for place in np.ndindex(source.shape[0] - step[0], source.shape[1] - step[1]):
            one, other = source[place], source[tuple(place + step)]
            states = state[place], state[tuple(place + step)]
            if (one + step == other).all() or states == (KEPT, KEPT) or ABSENT in states:
                continue
            ends = [np.clip(at, 0, last) for at in (one, other)]
            after, before = np.minimum(ends[0] + step, last), np.maximum(ends[1] - step, 0)
            colours = [lab[tuple(at)].astype(np.float64) for at in (ends[0], before, after, ends[1])]
            square = ((colours[0] - colours[1]) ** 2).sum() + ((colours[2] - colours[3]) ** 2).sum()
            slope = sum(float(slopes[axis][tuple(at)]) for at in (ends[0], before, after, ends[1]))
            cost = int(min(np.rint(square / (slope + offset) * unit), most))
            numbers = [int(inside[tuple(at)]) for at in ends]
            of_one = abs(numbers[0]) == abs(numbers[1])
            total += cost * (2 if min(numbers) > 0 or (max(numbers) > 0 and not of_one) else 1)
    return total


def least_seams(
    given: tuple[np.ndarray, np.ndarray, np.ndarray, float, float, float],
    old: np.ndarray,
    new: np.ndarray,
    state: np.ndarray,
) -> int:
    """The least cost of all choices of the free pixels."""
    free = np.argwhere(state == FREE)
    costs = []
    for choice in itertools.product([False, True], repeat=len(free)):
        taken = state == FILLED
        taken[tuple(free.T)] = choice
        costs.append(seams(*given, np.where(taken[..., None], new, old), state))
    return min(costs)
