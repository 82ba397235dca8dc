"""Accuracy of detected contours: precision, recall and their harmonic mean (F).

After the benchmark of Martin, Fowlkes and Malik (2004), but without a one-to-one assignment: a pixel is a match if
the other map has one within the tolerance. Maps are thinned first.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

THRESHOLDS = 24
"""number of thresholds"""


def f_measure(precision: np.ndarray, recall: np.ndarray) -> np.ndarray:
    """Harmonic mean; 0 where both are 0."""
    return np.asarray(2 * precision * recall / np.maximum(precision + recall, 1e-12))


@dataclasses.dataclass(frozen=True)
class Counts:
    """Pixel counts of one image at every threshold."""

    true_positives: np.ndarray
    """detected pixels near a true one"""
    detected: np.ndarray
    recalled: np.ndarray
    """true pixels near a detected one"""
    true: int

    def at(self, index: int) -> Counts:
        """The counts at one threshold."""
        here = slice(index, index + 1)
        return Counts(self.true_positives[here], self.detected[here], self.recalled[here], self.true)

    @property
    def f(self) -> np.ndarray:
        """F at every threshold."""
        return f_of([self])


def f_of(pictures: Sequence[Counts]) -> np.ndarray:
    """F of several images together at every threshold."""
    positives, detected, recalled = (
        np.sum([getattr(counts, name) for counts in pictures], axis=0)
        for name in ("true_positives", "detected", "recalled")
    )
    true = sum(counts.true for counts in pictures)
    return f_measure(positives / np.maximum(detected, 1), recalled / max(true, 1))


def ods(pictures: Sequence[Counts]) -> float:
    """F at the threshold that is best for all images together."""
    return float(f_of(pictures).max())


def ois(pictures: Sequence[Counts]) -> float:
    """F with the best threshold of each image; images without contours are ignored."""
    return ods([counts.at(int(counts.f.argmax())) for counts in pictures if counts.true])


def distance_to(mask: Bool[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Distance to the nearest true pixel; infinite where there is none."""
    import cv2

    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def count(
    maps: Sequence[Bool[np.ndarray, "h w"]], contours: Bool[np.ndarray, "h w"], tolerances: Sequence[float]
) -> list[Counts]:
    """Compare maps, one a threshold, with the true contours at several tolerances, px."""
    to_true = distance_to(contours)
    to_detected = [distance_to(detected)[contours] for detected in maps]
    totals = np.array([int(detected.sum()) for detected in maps])
    return [
        Counts(
            np.array([int((to_true[detected] <= tolerance).sum()) for detected in maps]),
            totals,
            np.array([int((distances <= tolerance).sum()) for distances in to_detected]),
            int(contours.sum()),
        )
        for tolerance in tolerances
    ]


def thinned(strength: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Non-maximum suppression across contours within 5 pixels."""
    import cv2

    soft = cv2.GaussianBlur(strength, (0, 0), 1.5)
    down2, across2 = cv2.Sobel(soft, cv2.CV_32F, 0, 2), cv2.Sobel(soft, cv2.CV_32F, 2, 0)
    both = cv2.Sobel(soft, cv2.CV_32F, 1, 1)
    # The second derivative is largest across a contour: negative on its crest, positive on its flanks.
    most = 0.5 * np.arctan2(2 * both, across2 - down2)
    across = most + np.where(across2 + down2 < 0, np.float32(np.pi / 2), np.float32(0))
    rows, columns = np.indices(strength.shape, np.float32)
    sine, cosine = np.sin(across).astype(np.float32), np.cos(across).astype(np.float32)
    keep = np.ones(strength.shape, bool)
    for step in (-2, -1, 1, 2):
        beside = cv2.remap(
            strength, columns + step * cosine, rows + step * sine, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        keep &= strength * np.float32(1.001) >= beside
    return np.where(keep, strength, np.float32(0))
