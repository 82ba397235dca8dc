"""Tensors of ComfyUI as pictures, and runs with ComfyUI's progress bar and interruption."""

from __future__ import annotations

import logging
from typing import Any

import comfy.model_management
import comfy.utils
import numpy as np
import torch
from PIL import Image

from .texloom_client import Client, Pixels, RunHandle, RunResult

_CLIENT = Client()
_LEVELS = {"uint8": 255, "uint16": 65535}
_PAUSE = 0.1  # seconds between looks at a run
_STEPS = 1000  # of the progress bar


def pictures(images: Any) -> list[np.ndarray]:
    """The pictures of an IMAGE (B, H, W, C): uint8 where all values are multiples of 1/255, else uint16."""
    return [_levels(np.asarray(one.cpu().numpy(), np.float32)) for one in images]


def _levels(values: np.ndarray) -> np.ndarray:
    if values.min() < 0 or values.max() > 1:
        logging.warning("texloom: values beyond 0..1 are clipped: %.3f to %.3f", values.min(), values.max())
        values = np.clip(values, 0, 1)
    levels = np.rint(values * 255)
    if np.abs(values * 255 - levels).max() < 1e-3:  # 8 bits, but for what dividing by 255 rounds
        return levels.astype(np.uint8)
    return np.rint(values * np.float32(65535)).astype(np.uint16)


def grey(picture: np.ndarray, name: str) -> np.ndarray:
    """A map with one value a pixel, which IMAGE holds three times; estimators may give them a trace of colour."""
    channels = picture[..., :3].astype(np.float64)
    if (spread := np.ptp(channels, axis=2).max()) > 0:
        share = spread / np.iinfo(picture.dtype).max
        logging.warning("texloom: %s: its channels differ by up to %.3f; their mean is used", name, share)
    return np.rint(channels.mean(axis=2)).astype(picture.dtype)


def masks(mask: Any, count: int, name: str) -> list[np.ndarray]:
    """The masks of a MASK (B, H, W) or (H, W) for so many pictures, white where they are above a half."""
    white = [255 * (np.asarray(one.cpu().numpy()) > 0.5).astype(np.uint8) for one in _batch(mask)]
    return paired(white, count, name, "pictures")


def levels(mask: Any, count: int, name: str) -> list[np.ndarray]:
    """The same with all that is between black and white."""
    return paired(pictures(_batch(mask)), count, name, "pictures")


def paired(given: list[np.ndarray], count: int, name: str, others: str) -> list[np.ndarray]:
    """One of ``given`` for each of so many others."""
    if len(given) not in (1, count):
        raise ValueError(f"{name}: {len(given)} given for {count} {others}; give one, or as many")
    return given * count if len(given) == 1 else given


def _batch(mask: Any) -> Any:
    return mask if len(mask.shape) == 3 else mask.reshape((1, *mask.shape))


def image(made: list[Pixels]) -> Any:
    """An IMAGE of results; they have one size."""
    if len(sizes := {one.shape[:2] for one in made}) > 1:
        told = ", ".join(f"{width}x{height}" for height, width in sorted(sizes))
        raise ValueError(f"the results have several sizes, which a batch cannot hold: {told}; make them one by one")
    values = [one.numpy().astype(np.float32) / np.float32(_LEVELS[one.dtype]) for one in made]
    return torch.from_numpy(np.stack([one if one.ndim == 3 else one[..., None].repeat(3, 2) for one in values]))


def run_all(flow: str, sources: list[dict[str, Any]], *, seed: int = 0, **how: Any) -> list[RunResult]:
    """Run a flow on each picture of a batch, the first with this seed, the next with the one after it."""
    bar = comfy.utils.ProgressBar(_STEPS * len(sources))
    made = []
    for number, given in enumerate(sources):
        run = _CLIENT.submit(flow, given, seed=seed + number, **how)
        made.append(_finished(run, bar, number))
        for note in made[-1].notes:
            logging.warning("texloom: %s", note)
    return made


def _finished(run: RunHandle, bar: Any, number: int) -> RunResult:
    shown = None
    while True:
        try:
            return run.wait(_PAUSE)
        except TimeoutError:
            pass
        status, preview = run.poll(), run.preview()
        picture = None
        if preview is not None and preview is not shown:
            shown, picture = preview, ("PNG", Image.fromarray(preview.numpy()[..., :3]), None)
        bar.update_absolute(_STEPS * number + int(_STEPS * status.done), preview=picture)
        try:
            comfy.model_management.throw_exception_if_processing_interrupted()
        except BaseException:
            run.cancel()
            raise
