"""Correspondences between the patches of a target and of an exemplar: conversion from and to pixels, and scaling.

A correspondence is one (2, p, q) int32 array of the top-left pixels of patches. Large ones are processed in bands
of rows, since intermediate arrays take several times their memory.
"""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int32, Int64, UInt32

from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.scratch import bands, empty, run_bands

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
    columns = np.clip(middle[1], 0, width - 1)
    match = empty((2, *patches), np.int32)

    def place(first: int, last: int) -> None:
        rows = np.clip(middle[0][first:last], 0, height - 1)[:, None]
        nearest = np.moveaxis(pixels[rows, columns], 2, 0).astype(np.float64)
        for axis, own in enumerate((rows, columns)):
            shift = (nearest[axis] - own) * factor - margin[axis] * factor
            match[axis, first:last] = _placed(shift, axis, places[axis], first)

    run_bands(place, (), patches[0], (match, pixels))
    return match


def rescale(
    match: Patches, patches: tuple[int, int], places: tuple[int, int], factor: float
) -> Int32[np.ndarray, "2 finer_p finer_q"]:
    """The same correspondence on a grid that is ``factor`` times finer.

    Displacements are those of the nearest patch, scaled; interpolated ones would break up coherent regions.
    """
    down, across = match.shape[1:]
    rows = (np.arange(patches[0]) * 2 + 1) * down // (2 * patches[0])
    columns = (np.arange(patches[1]) * 2 + 1) * across // (2 * patches[1])
    finer = empty((2, *patches), np.int32)

    def place(first: int, last: int) -> None:
        near = match[:, rows[first:last, None], columns]
        for axis, own in enumerate((rows[first:last, None], columns)):
            finer[axis, first:last] = _placed((near[axis] - own) * factor, axis, places[axis], first)

    run_bands(place, (), patches[0], (finer, match))
    return finer


def _placed(shift: Float64[np.ndarray, "p q"], axis: int, places: int, first: int) -> Float64[np.ndarray, "p q"]:
    """The rows (``axis`` 0) or columns (1) of the places that patches from row ``first`` on are shifted to."""
    line = np.arange(first, first + shift.shape[0])[:, None] if axis == 0 else np.arange(shift.shape[1])
    moved = np.rint(shift, out=shift)
    moved += line
    return np.clip(moved, 0, places - 1, out=moved)


def target_sides(match: Patches, patch_size: int, wrap: Wraps) -> tuple[int, int]:
    """Height and width of the target of a match: along an axis that wraps there are as many pixels as patches."""
    extra = wrap.where_open(patch_size - 1)
    return match.shape[1] + extra[0], match.shape[2] + extra[1]


def to_pixels(
    match: Patches, patch_size: int, wrap: Wraps, margin: tuple[int, int] = (0, 0)
) -> UInt32[np.ndarray, "H W 2"]:
    """The exemplar pixel that each target pixel has in the patch whose middle is nearest to it.

    Without ``margin`` px above and below, left and right.
    """
    middle = patch_size // 2
    (patch_rows, offset_rows), (patch_columns, offset_columns) = (
        _patches_along(np.arange(edge, side - edge) - middle, count, middle, around)
        for count, side, edge, around in zip(
            match.shape[1:], target_sides(match, patch_size, wrap), margin, wrap, strict=True
        )
    )
    pixels = empty((patch_rows.size, patch_columns.size, 2), np.uint32)

    def take(first: int, last: int) -> None:
        strip = slice(first, last)
        near = match[:, patch_rows[strip, None], patch_columns]
        pixels[strip, :, 0] = near[0] + offset_rows[strip, None]
        pixels[strip, :, 1] = near[1] + offset_columns

    run_bands(take, (), patch_rows.size, (pixels, match))
    return pixels


def to_layers(match: Patches) -> UInt32[np.ndarray, "p q 2"]:
    """A match as a checkpoint holds it."""
    layers = empty((*match.shape[1:], 2), np.uint32)
    for band in bands(len(layers), layers, match):
        layers[band] = np.moveaxis(match[:, band], 0, 2)
    return layers


def from_layers(layers: UInt32[np.ndarray, "p q 2"]) -> Patches:
    """A match from a checkpoint."""
    match = empty((2, *layers.shape[:2]), np.int32)
    for band in bands(len(layers), layers, match):
        match[:, band] = np.moveaxis(layers[band], 2, 0)
    return match


def _patches_along(
    lines: np.ndarray, count: int, middle: int, around: bool
) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """Of each line of pixels, the patch along an axis whose middle is nearest, and the pixel's offset in it."""
    if around:
        return lines % count, np.full(lines.size, middle)
    patches = np.clip(lines, 0, count - 1)
    return patches, lines + middle - patches
