"""Seam carving: gradient energy of pixels, and removal of a seam."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def gradient_energy(pixels, errors):
    """Fill ``errors`` with the change of all channels across and down each pixel, absolute values.

    Between the two neighbours along an axis; at a border between the pixel and its only one.

    Parameters
    ----------
    pixels : (h, w, c) int16; only as many columns as ``errors`` has are read
    errors : (h, m) float32, output; whole numbers
    """
    height, width = errors.shape
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            before, after = max(x - 1, 0), min(x + 1, width - 1)
            total = np.int32(0)
            for k in range(pixels.shape[2]):
                total += abs(np.int32(pixels[y, after, k]) - np.int32(pixels[y, before, k]))
                total += abs(np.int32(pixels[below, x, k]) - np.int32(pixels[above, x, k]))
            errors[y, x] = total


@compiled
def close_seam(pixels, number, path, width):
    """Remove a seam: move the pixels right of it one pixel to the left.

    Parameters
    ----------
    pixels, number : (h, w, c) int16 and (h, w) int32, changed in place
    path : (h,) int64, the seam's column in every row
    width : columns that are in use
    """
    for y in range(number.shape[0]):
        for x in range(path[y], width - 1):
            number[y, x] = number[y, x + 1]
            for k in range(pixels.shape[2]):
                pixels[y, x, k] = pixels[y, x + 1, k]
