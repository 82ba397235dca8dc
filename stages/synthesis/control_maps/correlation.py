"""Correlation of a texture with its control map."""

import numpy as np
from jaxtyping import Float32, Int64

_GRIDS = (256, 64)  # squares along the longer side: fine maps describe pixels, coarse ones regions
_HALVINGS = 5  # of the control's values into cells
_SHIFTS = 6  # displacements along a side by which chance is estimated


def correlation(planes: Float32[np.ndarray, "h w c"], control: Float32[np.ndarray, "h w k"]) -> float:
    """Share of the texture's variance that control explains beyond chance, 0..1; both as `ControlScale` gives them.

    Means over small squares are compared: of CIELAB, of further maps, and of lightness' differences to the right
    and below, which stand for structure. They are grouped by control into 32 cells; explained is the
    variance between cells by that of all. Chance is what the same map explains when it is displaced on a torus,
    since two smooth maps always have something in common. The better of two sizes of squares counts.
    """
    lightness = planes[..., 0]
    steps = [np.abs(np.diff(lightness, axis=axis, append=lightness.take([-1], axis))) for axis in (0, 1)]
    planes = np.concatenate([planes, np.stack(steps, axis=2)], axis=2)
    return max(_explained(_means(planes, squares), _means(control, squares)) for squares in _GRIDS)


def _means(planes: Float32[np.ndarray, "h w c"], squares: int) -> Float32[np.ndarray, "rows columns c"]:
    import cv2

    height, width, _ = planes.shape
    factor = min(1.0, squares / max(height, width))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    return np.stack(
        [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in np.moveaxis(planes, 2, 0)], axis=2
    )


def _explained(planes: Float32[np.ndarray, "h w c"], control: Float32[np.ndarray, "h w k"]) -> float:
    cells = median_cells(control.reshape(-1, control.shape[2]))
    total_variance = float(planes.astype(np.float64).var(axis=(0, 1)).sum())
    if total_variance < 1e-6:
        return 0.0

    centred = planes.reshape(-1, planes.shape[2]).astype(np.float64)
    columns = np.ascontiguousarray((centred - centred.mean(axis=0)).T)
    counts = np.maximum(np.bincount(cells), 1)
    sides = planes.shape[:2]

    def between(*shift: int) -> float:
        """The share that the cells explain of planes that are displaced on a torus."""
        moved = np.roll(cells.reshape(sides), [-step for step in shift], axis=(0, 1)).ravel()
        sums = (np.bincount(moved, weights=column) for column in columns)
        return sum(float((total**2 / counts).sum()) for total in sums) / len(centred) / total_variance

    chance = [
        between(sides[0] * i // _SHIFTS, sides[1] * j // _SHIFTS)
        for i in range(_SHIFTS)
        for j in range(_SHIFTS)
        if i or j
    ]
    floor = min(float(np.mean(chance)), 0.999)
    return float(np.clip((between(0, 0) - floor) / (1 - floor), 0, 1))


def median_cells(values: Float32[np.ndarray, "n k"], halvings: int = _HALVINGS) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Cells of a tree that halves the values at the median of their widest channel."""
    members = [np.arange(len(values))]
    own = [values]
    for _ in range(halvings):
        for cell in range(len(members)):
            if len(members[cell]) < 2:
                continue
            line = own[cell][:, int(own[cell].var(axis=0).argmax())]
            middle = np.median(line)
            upper = line > middle
            if not upper.any():
                upper = line == middle
            if not upper.all():
                for parts in (members, own):
                    parts.append(parts[cell][upper])
                    parts[cell] = parts[cell][~upper]
    cells = np.empty(len(values), np.int64)
    for cell, places in enumerate(members):
        cells[places] = cell
    return cells
