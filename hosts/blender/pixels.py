"""Blender's pixels, which are floats from the bottom row on, as pictures, and back."""

from __future__ import annotations

import numpy as np

from .texloom_client import Pixels, TexloomError


def to_array(flat: np.ndarray, width: int, height: int, channels: int, is_float: bool, is_data: bool) -> np.ndarray:
    """Rows from the top, R G B A: uint8 as in the file, or float32 of linear light, whose colours are not
    multiplied by alpha.

    flat : float32, as `Image.pixels` has it; those of floats of images with alpha are multiplied by it.
    """
    values = flat.reshape(height, width, channels)[::-1]
    if not is_float:
        return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
    values = values.astype(np.float32)
    if channels == 4 and not is_data:
        alpha = values[..., 3:]
        values = np.concatenate([values[..., :3] / np.where(alpha > 0, alpha, 1), alpha], axis=2)
    if not np.isfinite(values).all():
        raise TexloomError("the picture has values that are not finite numbers")
    return np.ascontiguousarray(values)


def without_alpha(values: np.ndarray) -> np.ndarray:
    """R G B where the picture is opaque everywhere, or has no alpha."""
    if values.shape[2] < 4:
        return values
    full = 255 if values.dtype == np.uint8 else 1.0
    return np.ascontiguousarray(values[..., :3]) if (values[..., 3] >= full).all() else values


def transparent(values: np.ndarray) -> np.ndarray:
    """The mask of what is transparent, uint8 (h, w), white where alpha is below a half."""
    if values.shape[2] < 4:
        raise TexloomError("the picture has no alpha; erase it with the brush Erase Alpha, or choose a mask")
    half = 128 if values.dtype == np.uint8 else 0.5
    return np.where(values[..., 3] < half, np.uint8(255), np.uint8(0))


def painted(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The mask of what is painted, uint8 (h, w), white where the mean of colour times alpha is above a half."""
    if values.shape[:2] != shape:
        sizes = [f"{width}x{height}" for height, width in (values.shape[:2], shape)]
        raise TexloomError(f"the mask has {sizes[0]} px, the picture {sizes[1]} px; paint one of its size")
    full = 255.0 if values.dtype == np.uint8 else 1.0
    white = values[..., :3].mean(axis=2) / full
    if values.shape[2] == 4:
        white = white * (values[..., 3] / full)
    return np.where(white > 0.5, np.uint8(255), np.uint8(0))


def some(mask: np.ndarray, what: str) -> np.ndarray:
    """The mask, which must cover some of the picture, but not all."""
    if not mask.any():
        raise TexloomError(f"nothing is {what}; paint what is to be made anew")
    if mask.all():
        raise TexloomError(f"all is {what}; leave some of the picture")
    return mask


def to_flat(made: Pixels) -> tuple[np.ndarray, bool, bool]:
    """What `Image.pixels` takes of a result, R G B A; whether the image is of floats, and whether it has alpha."""
    values = made.numpy()
    is_float = made.dtype == "float32"  # else uint8, as nothing else is sent
    values = values.astype(np.float32) if is_float else values / np.float32(255)
    values = values[..., None] if values.ndim == 2 else values
    if values.shape[2] == 1:
        values = values.repeat(3, 2)
    has_alpha = values.shape[2] == 4
    if not has_alpha:
        values = np.concatenate([values, np.ones_like(values[..., :1])], axis=2)
    elif is_float:
        values = np.concatenate([values[..., :3] * values[..., 3:], values[..., 3:]], axis=2)
    return np.ascontiguousarray(values[::-1]).ravel(), is_float, has_alpha
