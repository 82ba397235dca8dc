"""Objects of an exemplar that lie apart on a plain ground: flowers on paper, coins on cloth."""

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.analysis.structure.contour_cells import MAX_AREA, MIN_CELLS, ContourCells, boxes_of, inside_of

MIN_GROUND = 0.5  # of the exemplar's area, in large cells, of one that may show objects on a ground
_MIN_COVER = 0.1  # of the exemplar's area, in whole objects
_MIN_SHARE = 0.8  # of their area, in closed contours
_AROUND = 12  # px around a cell in which its colour is compared with that of the ground
_FEW = 20  # px of ground there, below which all the ground counts
_MARGIN = 8.0  # CIELAB units by which an object differs more from the ground than that varies
_ONE = 0.2  # of its outline that a cell shares with another, from which on both are one object
_LOOKED_AT = 1e6  # px of a large exemplar, of which colours are compared
_STEPS = 8  # of a CIELAB unit, in whole numbers


class GroundObjects(ContourCells):
    """The cells between contours that are objects on a ground.

    The ground is what large cells show, and small ones of its colour, which objects and lines enclose; that of an
    exemplar is at least `MIN_GROUND`. Cells that share much of their outlines are one object.

    Parameters
    ----------
    cells : of the exemplar.
    lab : the exemplar with its border, CIELAB.
    """

    def __init__(self, cells: ContourCells, lab: Float32[np.ndarray, "h w 3"]):
        count, self.ground = len(cells.area), cells.ground
        objects = ~cells.large & (cells.area > 0) & ~_like_ground(cells, lab)
        number = _joined(cells.label, objects & cells.whole)
        self.label: Int64[np.ndarray, "h w"] = number[cells.label]
        inside = inside_of(self.label)
        size = np.bincount(self.label.ravel(), minlength=count)
        small = np.zeros(count, bool)
        small[np.unique(number[objects])] = True
        small &= size < MAX_AREA * size.sum()
        self.core: Bool[np.ndarray, "h w"] = _largest_parts(inside & small[self.label], self.label)
        self.area = np.bincount(self.label[self.core], minlength=count)
        cut = np.bincount(number[~cells.whole], minlength=count) > 0
        closed = np.bincount(number[cells.closed], minlength=count) > 0
        self.whole = small & ~cut & (self.area > 0)
        self.large = ~small
        self.boxes = boxes_of(self.label, self.core, count)
        self.closed = closed & self.whole
        total = int(size[self.whole].sum())
        self.closed_share = float(size[self.closed].sum()) / total if total else 0.0
        self.cover = total / self.label.size

    @property
    def clear(self) -> bool:
        """Whether the exemplar shows objects in closed contours on a ground."""
        several = self.ground >= MIN_GROUND and self.whole.sum() >= MIN_CELLS
        return bool(several and self.closed_share >= _MIN_SHARE and self.cover >= _MIN_COVER)


def _largest_parts(core: Bool[np.ndarray, "h w"], label: Int64[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The inside of each cell without the smaller of its connected parts, such as tips."""
    import cv2

    count, part = cv2.connectedComponents(core.astype(np.uint8), connectivity=4)
    size = np.bincount(part.ravel(), minlength=count)
    owner = np.zeros(count, np.int64)
    owner[part] = label
    order = np.lexsort((-np.arange(count), size, owner))
    order = order[order > 0]
    last = np.append(owner[order][1:], -1) != owner[order]
    kept = np.zeros(count, bool)
    kept[order[last[: len(order)]]] = True
    return np.asarray(kept[part] & core)


def _like_ground(cells: ContourCells, lab: Float32[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Cells whose mean colour is no farther from that of the ground around than it varies there, with a margin."""
    step = max(1, round(float(np.sqrt(cells.label.size / _LOOKED_AT))))
    tone = np.rint(lab[::step, ::step] * _STEPS).astype(np.int64)
    label, core = cells.label[::step, ::step], cells.core[::step, ::step]
    label, own, ground = label[core], tone[core], cells.large[label]
    sums = np.stack([np.bincount(label, own[:, channel], len(cells.area)) for channel in range(3)], axis=1)
    mean = sums / np.maximum(1, np.bincount(label, minlength=len(cells.area)))[:, None]
    planes = np.concatenate([tone, (tone**2).sum(axis=2, keepdims=True), np.ones_like(tone[..., :1])], axis=2)
    total = np.zeros((tone.shape[0] + 1, tone.shape[1] + 1, 5), np.int64)
    total[1:, 1:] = np.where(ground[..., None], planes, 0).cumsum(axis=0).cumsum(axis=1)
    first = np.maximum(cells.boxes[:, :2] - _AROUND, 0) // step
    last = np.minimum(-(-(cells.boxes[:, 2:] + _AROUND) // step), tone.shape[:2])
    around = total[last[:, 0], last[:, 1]] - total[first[:, 0], last[:, 1]]
    around += total[first[:, 0], first[:, 1]] - total[last[:, 0], first[:, 1]]
    around[around[:, 4] < _FEW] = total[-1, -1]
    number = np.maximum(1, around[:, 4])
    middle = around[:, :3] / number[:, None]
    spread = np.sqrt(np.maximum(around[:, 3] / number - (middle**2).sum(axis=1), 0))
    return np.asarray(((mean - middle) ** 2).sum(axis=1) <= (spread + _MARGIN * _STEPS) ** 2)


def _joined(label: Int64[np.ndarray, "h w"], objects: Bool[np.ndarray, "n"]) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """For each cell the least number of those that are one object with it, its own where it is none."""
    count = len(objects)
    codes = []
    for axis in (0, 1):
        first, second = (label[:-1], label[1:]) if axis == 0 else (label[:, :-1], label[:, 1:])
        differs = first != second
        ends = np.stack([first[differs], second[differs]])
        codes.append(ends.min(axis=0) * count + ends.max(axis=0))
    pairs, lengths = np.unique(np.concatenate(codes), return_counts=True)
    one, other = np.divmod(pairs, count)
    outline = np.bincount(one, lengths, count) + np.bincount(other, lengths, count)
    together = objects[one] & objects[other] & (lengths > _ONE * np.minimum(outline[one], outline[other]))
    number = np.arange(count)
    for first, second in zip(one[together].tolist(), other[together].tolist(), strict=True):
        least, most = sorted((int(number[first]), int(number[second])))
        number[number == most] = least
    return number
