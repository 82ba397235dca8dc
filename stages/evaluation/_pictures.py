"""The two pictures that measures compare, and the pictures that show how far apart a good and a bad result are."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Float64

from stages.arrays import Image
from stages.color import lab_from_linear

FLAT = 1e-3
"""CIELAB units; a picture that varies less has one colour, the rest is rounding"""

_BRIGHTEST = np.float32(65504)  # what half floats hold; brighter light counts as that bright, or squares overflow


class UnmeasurableError(Exception):
    """The pictures do not allow a measure; the text says why."""


@dataclasses.dataclass(frozen=True)
class Picture:
    """What measures read of a picture."""

    lab: Float32[np.ndarray, "h w 3"]
    """CIELAB (D65)"""
    tone: Float32[np.ndarray, "h w"]
    """CIELAB along the direction in which the exemplar varies most; the exemplar's mean is 0, its deviation 1"""

    @property
    def shorter(self) -> int:
        """The shorter side, px."""
        return int(min(self.tone.shape))


def pictures(exemplar: Image, image: Image) -> tuple[Picture, Picture]:
    """The exemplar and the result as measures read them; only colour counts.

    A grey texture's tone is its lightness; one of equal lightness still has a tone.
    """
    labs = [lab_from_linear(np.minimum(picture.color, _BRIGHTEST)) for picture in (exemplar, image)]
    values = labs[0].reshape(-1, 3).astype(np.float64)
    mean = values.mean(axis=0)
    variances, directions = np.linalg.eigh(np.cov(values, rowvar=False, bias=True))
    axis = directions[:, -1] * np.sign(directions[np.argmax(np.abs(directions[:, -1])), -1])
    deviation = max(float(np.sqrt(max(variances[-1], 0.0))), FLAT)
    return (
        Picture(labs[0], ((labs[0] - mean) @ axis / deviation).astype(np.float32)),
        Picture(labs[1], ((labs[1] - mean) @ axis / deviation).astype(np.float32)),
    )


def channel_variances(lab: Float32[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "3"]:
    """Variances of L, a and b; in single precision the mean of a large plain picture would be off."""
    return np.asarray(lab.reshape(-1, 3).var(axis=0, dtype=np.float64))


def require_variation(picture: Picture, name: str = "the exemplar") -> None:
    """`UnmeasurableError` where the picture has one colour."""
    if float(channel_variances(picture.lab).max()) <= FLAT**2:
        raise UnmeasurableError(f"{name} has one colour")


def require_side(side: int, *measured: Picture) -> None:
    """`UnmeasurableError` where a picture is narrower or lower than ``side`` px."""
    shorter = min(picture.shorter for picture in measured)
    if shorter < side:
        raise UnmeasurableError(f"needs {side} px on the shorter side, got {shorter}")


def halves(picture: Picture) -> list[tuple[Picture, Picture]]:
    """Left and right, top and bottom: disjoint parts of the same texture."""
    rows, columns = picture.tone.shape[0] // 2, picture.tone.shape[1] // 2
    cuts = (
        (np.s_[:, :columns], np.s_[:, columns:]),
        (np.s_[:rows], np.s_[rows:]),
    )
    return [
        (Picture(picture.lab[one], picture.tone[one]), Picture(picture.lab[other], picture.tone[other]))
        for one, other in cuts
    ]


def shuffled_blocks(picture: Picture, side: int) -> Picture:
    """Cut into squares of ``side`` px and put together in random order; what does not fill a square is dropped."""
    rows, columns = picture.tone.shape[0] // side, picture.tone.shape[1] // side
    order = np.random.default_rng(0).permutation(rows * columns)

    def shuffled(plane: np.ndarray) -> np.ndarray:
        depth = plane.shape[2:]
        blocks = plane[: rows * side, : columns * side].reshape(rows, side, columns, side, *depth).swapaxes(1, 2)
        mixed = blocks.reshape(rows * columns, side, side, *depth)[order].reshape(blocks.shape)
        return np.ascontiguousarray(mixed.swapaxes(1, 2).reshape(rows * side, columns * side, *depth))

    return Picture(shuffled(picture.lab), shuffled(picture.tone))
