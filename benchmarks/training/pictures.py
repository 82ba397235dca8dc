"""Procedural textures whose contours are exactly known: layout, materials, relief, light, wear, camera."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from benchmarks.training.fields import Array, bent, log_uniform, octaves, smooth_noise
from benchmarks.training.layouts import LAYOUTS

_FINE = 2  # drawn so many times larger, then reduced: borders fall between pixels as in photographs
_MERGED = 3.0  # px; the two sides of a thinner joint are one contour
_VISIBLE = 4.0  # CIELAB; a border across which colour and shade differ less is no contour
_BLANK = 0.05  # share of textures without any contour, such as sand
SMALLEST = {"train": 8.0, "judge": 16.0}
"""size of the smallest parts, px, by split; evaluation reduces pictures afterwards"""


@dataclasses.dataclass(frozen=True)
class Picture:
    """A texture and where its contours are."""

    color: UInt8[np.ndarray, "h w 3"]
    """sRGB"""
    contours: Bool[np.ndarray, "h w"]
    """true on the pixels that a contour runs through"""
    kind: str
    """the layout's name"""


def _borders(ids: Array) -> Array:
    """Pixels whose right or lower neighbour belongs to another part."""
    borders = np.zeros(ids.shape, bool)
    borders[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    borders[:-1] |= ids[:-1] != ids[1:]
    return borders


def _distance(mask: Array) -> Array:
    """Distance of every pixel to the nearest true one; far where there is none."""
    if not mask.any():
        return np.full(mask.shape, 1e4, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5), np.float32)


def _grain(ids: Array, own: bool, rng: np.random.Generator) -> Array:
    """Fine structure that is no contour, in CIELAB: noise, speckles or streaks, ``own`` to each part or common."""
    shape = ids.shape
    size = 512
    kind = rng.integers(4)
    if kind == 0:
        field = octaves((size, size), _FINE * log_uniform(rng, 2, 24), rng.uniform(0.5, 1.2), rng)
    elif kind == 1:
        field = smooth_noise((size, size), _FINE * log_uniform(rng, 1, 3.5), rng)
        field = np.clip(field - np.float32(rng.uniform(-0.5, 1.5)), 0, 1.5) * rng.choice([-1.5, 1.5])
    elif kind == 2:
        thin = _FINE * log_uniform(rng, 0.8, 3)
        field = smooth_noise((size, size), (thin, min(250.0, thin * log_uniform(rng, 5, 40))), rng)
    else:
        field = octaves((size, size), _FINE * 3, 1.0, rng)
    rows, columns = np.indices(shape, np.float32)
    if own:
        angle = rng.uniform(0, 2 * np.pi, 256) if rng.random() < 0.5 else np.zeros(256)
        part = ids * 40503 % 65537 % 256
        cosine, sine = np.cos(angle)[part], np.sin(angle)[part]
        shift = rng.uniform(0, size, (2, 256))
        rows, columns = (
            (cosine * rows + sine * columns + shift[0][part]).astype(np.float32),
            (cosine * columns - sine * rows + shift[1][part]).astype(np.float32),
        )
    field = cv2.remap(
        field, columns % (size - 1), rows % (size - 1), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    tint = np.append(1.0, rng.normal(0, 0.15, 2)).astype(np.float32)
    return np.asarray(field[..., None] * (tint * np.float32(log_uniform(rng, 0.4, 11))))


def _part_colors(ids: Array, contrast: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Colour of every pixel's part, in CIELAB, and the number of its material."""
    count = 1024
    materials = int(rng.integers(1, 4))
    base = np.array([rng.uniform(20, 85), *rng.normal(0, 14, 2)])
    palette = base + rng.normal(0, 1, (materials, 3)) * [contrast, 0.5 * contrast, 0.5 * contrast]
    material = rng.integers(materials, size=count)
    spread = log_uniform(rng, 0.3, 1.0) * contrast
    colors = palette[material] + rng.normal(0, 1, (count, 3)) * [spread, 0.3 * spread, 0.3 * spread]
    part = ids * 40503 % 65537 % count
    return colors[part].astype(np.float32), material[part]


def _relief(distance: Array, unit: float, kind: str, rng: np.random.Generator) -> Array:
    """Factor on the light: bulging or bevelled parts lit from a side, and darkness in the gaps between them."""
    shade = np.ones(distance.shape, np.float32)
    if rng.random() < (0.9 if kind in {"pebbles", "scales", "weave", "leaves"} else 0.5):
        radius = np.float32(unit * rng.uniform(0.05, 0.5))
        inside = np.minimum(distance / radius, 1)
        height = cv2.GaussianBlur(radius * np.sqrt(inside * (2 - inside)), (0, 0), max(0.6, float(radius) / 8))
        angle, strength = rng.uniform(0, 2 * np.pi), log_uniform(rng, 0.06, 0.9)
        down, across = np.gradient(height)
        shade += np.float32(strength) * np.tanh(np.sin(angle) * down + np.cos(angle) * across)
    if rng.random() < 0.6:
        reach = np.float32(_FINE * log_uniform(rng, 0.8, max(1.0, unit / _FINE * 0.15)))
        shade *= 1 - np.float32(rng.uniform(0.05, 0.95)) * np.exp(-distance / reach)
    return np.maximum(shade, np.float32(0.1))


def _light(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Factor on the light that varies without any contour: uneven lamps and soft shadows."""
    light = 1 + np.float32(rng.uniform(0, 0.2)) * smooth_noise(shape, shape[0] * rng.uniform(0.3, 2), rng)
    if rng.random() < 0.3:
        period = shape[0] * rng.uniform(0.3, 1)
        steep = period / (_FINE * log_uniform(rng, 12, 40))  # a shadow's border is 12 to 40 px wide
        light *= 1 - np.float32(rng.uniform(0.1, 0.5)) / (1 + np.exp(-steep * smooth_noise(shape, period, rng)))
    return np.clip(light, 0.2, 2)


def _camera(color: Array, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """sRGB codes after simulated blur, exposure, noise and compression."""
    if rng.random() < 0.35:  # low resolution, enlarged
        side = color.shape[0]
        less = round(side / rng.uniform(1.3, 2.5))
        color = cv2.resize(color, (less, less), interpolation=cv2.INTER_AREA)
        color = cv2.resize(color, (side, side), interpolation=cv2.INTER_LINEAR)
    blur = rng.uniform(0, 1.6) if rng.random() < 0.6 else 0.0
    if blur > 0.3:
        color = cv2.GaussianBlur(color, (0, 0), blur)
    if rng.random() < 0.15:
        color = np.repeat(color.mean(axis=2, keepdims=True), 3, axis=2)
    exposure = max(1.0, 0.15 / max(float(color.mean()), 1e-3))
    color = color * np.float32(exposure)
    middle = color.mean()
    color = (color - middle) * np.float32(log_uniform(rng, 0.5, 1.5)) + middle + np.float32(rng.normal(0, 0.05))
    if rng.random() < 0.6:
        noise = rng.standard_normal(color.shape, np.float32)
        color = color + np.float32(log_uniform(rng, 0.002, 0.04)) * noise
    encoded = np.rint(np.clip(color, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.4:
        quality = int(rng.integers(50, 96))
        _, file = cv2.imencode(".jpg", encoded, [cv2.IMWRITE_JPEG_QUALITY, quality])
        encoded = cv2.imdecode(file, cv2.IMREAD_COLOR)
    return np.ascontiguousarray(encoded)


def _joint_width(kind: str, unit: float, rng: np.random.Generator) -> float:
    """Width of the joints between parts, px of the result; 0 for none."""
    if kind == "cracks":
        return log_uniform(rng, 0.7, 3.5)
    share = {"bricks": 0.8, "tiles": 0.7, "cells": 0.5, "planks": 0.7, "pebbles": 0.15}.get(kind, 0.05)
    return log_uniform(rng, 0.8, max(1.0, 0.25 * unit)) if rng.random() < share else 0.0


def draw_picture(kind: str, side: int, unit: float, rng: np.random.Generator) -> Picture:
    """Draw a texture of ``kind`` of ``side`` pixels square, whose parts are about ``unit`` pixels large."""
    fine = side * _FINE
    large = unit * _FINE
    canvas = LAYOUTS[kind](int(1.5 * fine), large, rng)
    bend = large * (rng.uniform(0, 0.25) if rng.random() < 0.5 else 0.02)
    turn = rng.uniform(0, np.pi) if rng.random() < 0.5 else 0.0
    ids = bent(canvas, (fine, fine), turn, bend, rng)
    if rng.random() < _BLANK:
        ids = np.zeros_like(ids)

    # Joints: as wide as drawn, a little uneven, rounder than the parts; those of cracks end somewhere.
    borders = _borders(ids)
    distance = _distance(borders)
    width = _joint_width(kind, unit, rng)
    joint = np.zeros(ids.shape, bool)
    if width > 0:
        uneven = 1 + np.float32(rng.uniform(0, 0.4)) * smooth_noise(ids.shape, large / 2, rng)
        soft = rng.uniform(0, 0.12) * large if rng.random() < 0.5 and width > _MERGED else 0.0
        rounded = cv2.GaussianBlur(np.minimum(distance, large), (0, 0), soft) if soft > 1 else distance
        joint = rounded < np.float32(width * _FINE / 2) * np.maximum(uneven, np.float32(0.3))
    if kind == "cracks":
        lasting = smooth_noise(ids.shape, large * 2, rng) > np.float32(rng.uniform(-2, 0))
        joint &= lasting
        borders &= lasting
        distance = _distance(borders)
    if width >= _MERGED:
        borders = _borders(np.where(joint, -1, ids))
        distance = _distance(borders)

    # Materials; cracks run through one piece.
    contrast = log_uniform(rng, 3.5, 32)
    parts = np.zeros_like(ids) if kind == "cracks" else ids
    color, material = _part_colors(parts, contrast, rng)
    if width > 0:
        offset = np.array([rng.choice([-1, -1, 1]) * log_uniform(rng, 5, 40), *rng.normal(0, 4, 2)], np.float32)
        color[joint] = (color.reshape(-1, 3).mean(axis=0) if rng.random() < 0.7 else color[joint]) + offset
        material = np.where(joint, -1, material)
    relief = _relief(np.where(joint, 0, distance), large, kind, rng)
    if kind in {"leaves", "pebbles"} and rng.random() < 0.5:  # what lies deeper is darker
        relief *= 1 - np.float32(rng.uniform(0.2, 0.9)) * (1 - ids / np.float32(max(ids.max(), 1)))
    visible = _visible(color * relief[..., None], material)

    own = kind != "cracks" and rng.random() < 0.6
    grains = [_grain(ids, own, rng) for _ in range(1 + (rng.random() < 0.5))]
    for number, grain in enumerate(grains):
        color += grain if number == 0 else np.where((material == 0)[..., None], grain, 0)
    if rng.random() < 0.5:
        blotch = smooth_noise(ids.shape, _FINE * log_uniform(rng, 15, 80), rng)
        color += blotch[..., None] * rng.normal(0, (3, 1.5, 1.5)).astype(np.float32)
    if rng.random() < 0.4:
        worn = np.clip(smooth_noise(ids.shape, _FINE * log_uniform(rng, 10, 60), rng), 0, 1)
        worn *= np.float32(rng.uniform(0.2, 0.9))
        blurred = cv2.GaussianBlur(color, (0, 0), _FINE * rng.uniform(1.5, 4))
        color += (blurred - color) * worn[..., None]

    color[..., 0] = np.clip(color[..., 0], 1, 99)
    encoded = cv2.cvtColor(color, cv2.COLOR_Lab2RGB) * (relief * _light(ids.shape, rng))[..., None]
    reduced = cv2.resize(encoded, (side, side), interpolation=cv2.INTER_AREA)
    contours = (borders & visible).reshape(side, _FINE, side, _FINE).any(axis=(1, 3))
    return Picture(_camera(reduced, rng), contours, kind)


def _visible(color: Array, material: Array) -> Array:
    """Where colours without grain, or materials, differ within three pixels of the result."""
    window = np.ones((3 * _FINE + 1, 3 * _FINE + 1), np.uint8)
    span = cv2.dilate(color, window) - cv2.erode(color, window)
    numbers = material.astype(np.float32)
    other = cv2.dilate(numbers, window) != cv2.erode(numbers, window)
    return np.asarray((span.max(axis=2) > _VISIBLE) | other)


def picture_of(split: str, number: int, side: int, seed: int) -> Picture:
    """Picture ``number`` of a split (``train`` or ``judge``); the kinds alternate."""
    rng = np.random.default_rng([seed, list(SMALLEST).index(split), number])
    unit = log_uniform(rng, SMALLEST[split], 90)
    return draw_picture(list(LAYOUTS)[number % len(LAYOUTS)], side, unit, rng)
