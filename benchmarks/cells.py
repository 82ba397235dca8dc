"""Mixed cells of results with and without their completion: cells of two tones and fused ones.

    python -m benchmarks.cells wall.png stones.jpg                     twice their size, seed 1
    python -m benchmarks.cells wall.png --size 512 --seeds 3 --tileable
    python -m benchmarks.cells wall.png --preset fast

A cell of the result is what connects the insides of the exemplar's cells (`ContourCells`). It counts as mixed
where at least 6 % of its pixels come from another place than most of them, and differ there by more than 6 CIELAB
units from what that place would show. Exemplars that do not consist of cells are named, without the second run.
CPU seconds are of the whole run; the first runs of a new installation compile kernels.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image as Pillow

import texloom
from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.common.grids.border import Border
from texloom.stages.vocabulary.color import lab_from_linear

_MIN_PART = 0.06  # of a cell's area
_MIN_TONE = 6.0  # CIELAB units


def mixed_cells(match: np.ndarray, lab: np.ndarray, cells: ContourCells) -> tuple[int, int]:
    """How many cells of a result are mixed, and of how many.

    Parameters
    ----------
    match : (H, W, 2), source of each pixel.
    lab : (h, w, 3), the exemplar, CIELAB.
    """
    import cv2

    rows, columns = (match[..., axis].astype(np.int64) for axis in (0, 1))
    count, number = cv2.connectedComponents(cells.core[rows, columns].astype(np.uint8), connectivity=4)
    smooth = cv2.blur(lab, (3, 3))
    down, across = np.indices(number.shape)
    mixed = total = 0
    smallest = 0.3 * float(np.quantile(cells.area[cells.whole], 0.1))
    order = np.argsort(number, axis=None, kind="stable")
    for own in np.split(order, np.cumsum(np.bincount(number.ravel(), minlength=count))[:-1])[1:]:
        if len(own) <= smallest:
            continue
        total += 1
        shift = np.stack([(rows - down).ravel()[own], (columns - across).ravel()[own]])
        shifts, counts = np.unique(shift, axis=1, return_counts=True)
        most = shifts[:, counts.argmax()]
        other = (shift != most[:, None]).any(axis=0)
        at = own[other]
        there = [
            np.clip(place.ravel()[at] + step, 0, side - 1)
            for place, step, side in zip((down, across), most, lab.shape[:2], strict=True)
        ]
        shown = smooth[rows.ravel()[at], columns.ravel()[at]]
        differs = np.abs(shown - smooth[there[0], there[1]]).max(axis=1, initial=0) > _MIN_TONE
        mixed += int(differs.sum() >= _MIN_PART * len(own))
    return mixed, total


def main() -> None:
    """Print a line for each exemplar and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("exemplars", nargs="+", type=Path)
    parser.add_argument("--size", type=int, help="of results, px; twice the exemplar's longer side")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--preset", default="default")
    parser.add_argument("--tileable", action="store_true")
    given = parser.parse_args()
    print(f"{'exemplar':24} seed  mixed cells, CPU seconds: without | with completion")
    for path in given.exemplars:
        for seed in range(1, given.seeds + 1):
            parts = []
            for whole in (False, True):
                with tempfile.TemporaryDirectory() as store:
                    side = given.size or 2 * max(Pillow.open(path).size)
                    begin = time.process_time()
                    result = texloom.run(
                        "self_tuning",
                        {"exemplar": path},
                        {"texture.whole_cells": whole},
                        size=(side, side),
                        seed=seed,
                        preset=given.preset,
                        tileable=given.tileable,
                        store=store,
                        out=Path(store) / "out",
                    )
                    seconds = time.process_time() - begin
                    image = result["tone"].image
                    cells = ContourCells(result["edges"].strength, Border(1))
                    found = mixed_cells(result["texture"].match, lab_from_linear(image.color), cells)
                parts.append(f"{found[0]:5} of {found[1]:5}, {seconds:6.1f} s")
                if not cells.clear:
                    break
            note = "" if len(parts) == 2 else "  (does not consist of cells)"
            print(f"{path.name:24} {seed:4}  {' | '.join(parts)}{note}", flush=True)


if __name__ == "__main__":
    main()
