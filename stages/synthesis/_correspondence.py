"""Correspondences between the patches of a target and of an exemplar: making, scaling, reading out.

Held as one (2, p, q) int32 array, rows then columns, so that each plane is contiguous for the kernels. A patch is
named by its top-left pixel.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Int32, UInt32

Patches: TypeAlias = Int32[np.ndarray, "2 p q"]


def from_pixels(
    pixels: UInt32[np.ndarray, "H W 2"],
    full: tuple[int, int],
    patches: tuple[int, int],
    places: tuple[int, int],
    patch_size: int,
    factor: float,
) -> Patches:
    """Patch correspondence at the scale of ``factor`` from a pixel correspondence at full size.

    Each patch takes the displacement of the pixel under its middle.

    Parameters
    ----------
    pixels : exemplar pixel of every target pixel, at full size.
    full : height and width that the target patches cover at full size; pixels beyond ``pixels`` repeat its border.
    patches : target patches down and across at the scale.
    places : exemplar patches down and across at the scale.
    """
    height, width = pixels.shape[:2]
    margin = ((full[0] - height) // 2, (full[1] - width) // 2)
    middle = [
        np.minimum(((np.arange(count) + patch_size / 2) / factor).astype(np.int64), size - 1) - edge
        for count, size, edge in zip(patches, full, margin, strict=True)
    ]
    rows = np.clip(middle[0], 0, height - 1)
    columns = np.clip(middle[1], 0, width - 1)
    nearest = pixels[rows[:, None], columns[None, :]].astype(np.float64)
    shift = nearest - np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
    return _placed(np.moveaxis(shift, 2, 0) * factor, np.array(margin) * factor, places)


def rescale(
    match: Patches, patches: tuple[int, int], places: tuple[int, int], factor: float
) -> Int32[np.ndarray, "2 finer_p finer_q"]:
    """The same correspondence on a grid that is ``factor`` times finer.

    Displacements are taken from the nearest patch and scaled, so that patches that moved together still do;
    interpolated positions would not.
    """
    down, across = match.shape[1:]
    rows = (np.arange(patches[0]) * 2 + 1) * down // (2 * patches[0])
    columns = (np.arange(patches[1]) * 2 + 1) * across // (2 * patches[1])
    shift = match - np.stack(np.meshgrid(np.arange(down), np.arange(across), indexing="ij"))
    return _placed(shift[:, rows[:, None], columns[None, :]] * factor, np.zeros(2), places)


def _placed(shift: np.ndarray, origin: np.ndarray, places: tuple[int, int]) -> Patches:
    own = np.stack(np.meshgrid(np.arange(shift.shape[1]), np.arange(shift.shape[2]), indexing="ij"))
    match = own + np.rint(shift - origin[:, None, None]).astype(np.int64)
    limit = np.array(places)[:, None, None] - 1
    return np.ascontiguousarray(np.clip(match, 0, limit).astype(np.int32))


def to_pixels(match: Patches, patch_size: int, wrap: bool) -> UInt32[np.ndarray, "H W 2"]:
    """The exemplar pixel that each target pixel takes from the patch whose middle it is (or is nearest to)."""
    down, across = match.shape[1:]
    middle = patch_size // 2
    extra = 0 if wrap else patch_size - 1
    rows, columns = np.arange(down + extra) - middle, np.arange(across + extra) - middle
    if wrap:
        patch_rows, patch_columns = rows % down, columns % across
        offset_rows, offset_columns = np.full(down, middle), np.full(across, middle)
    else:
        patch_rows, patch_columns = np.clip(rows, 0, down - 1), np.clip(columns, 0, across - 1)
        offset_rows, offset_columns = rows + middle - patch_rows, columns + middle - patch_columns
    near = match[:, patch_rows[:, None], patch_columns[None, :]]
    return np.stack([near[0] + offset_rows[:, None], near[1] + offset_columns[None, :]], axis=2).astype(np.uint32)
