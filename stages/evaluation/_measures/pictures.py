"""The pictures that measures compare: exemplar and result, the exemplar's halves, and a bad result."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.common.grids.working_size import MOST_PIXELS, reduction
from texloom.stages.vocabulary.arrays import ColorField, Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import count_excluded, fill_excluded, valid_pixels
from texloom.stages.vocabulary.scratch import bands

FLAT = 1e-3
"""CIELAB units; a picture that varies less has one colour, the rest is rounding"""

_MIN_SHARE = 0.1  # of a half's pixels that must count
_MAX_LIGHT = np.float32(65504)  # the largest half float; brighter light is clipped, or squares would overflow


class UnmeasurableError(Exception):
    """The pictures do not allow a measure, for the reason in the text."""


@dataclasses.dataclass(frozen=True)
class MeasuredPicture:
    """A picture as measures read it."""

    lab: Float32[np.ndarray, "h w 3"]
    """CIELAB (D65)"""
    tone: Float32[np.ndarray, "h w"]
    """CIELAB along the direction in which the exemplar varies most; the exemplar's mean is 0, its deviation 1"""
    valid: Mask | None = None
    """true at pixels that are not masked; None is all. Others hold the value of the nearest such pixel"""
    made: Mask | None = None
    """true at pixels that were made, not given; None is all. What holds none of them does not count"""
    is_grey: bool = False
    """neither exemplar nor result has colour"""

    @property
    def shorter(self) -> int:
        """The shorter side, px."""
        return int(min(self.tone.shape))

    @property
    def counted(self) -> Mask | None:
        """True at the pixels that count; None where all do."""
        if self.valid is None or self.made is None:
            return self.made if self.valid is None else self.valid
        return self.valid & self.made

    @property
    def colors(self) -> Float32[np.ndarray, "n 3"]:
        """CIELAB of the pixels that count."""
        counted = self.counted
        return self.lab.reshape(-1, 3) if counted is None else self.lab[counted]

    @functools.cached_property
    def compared(self) -> Float32[np.ndarray, "h w c"]:
        """What patches are compared by: CIELAB, or L alone without colour, as a and b are rounding errors then."""
        return np.ascontiguousarray(self.lab[..., :1]) if self.is_grey else self.lab

    @functools.cached_property
    def variances(self) -> Float64[np.ndarray, "3"]:
        """Variances of L, a and b at the pixels that count."""
        return channel_variances(self.colors)

    def windows(self, height: int, width: int) -> Bool[np.ndarray, "p q"] | None:
        """True for boxes, by their top-left pixel, that count: all valid, some made. None is all."""
        whole = None if self.valid is None else count_excluded(self.valid, height, width) == 0
        if self.made is None:
            return whole
        touched = count_excluded(~self.made, height, width) > 0
        return touched if whole is None else whole & touched


def any_true(mask: Bool[np.ndarray, "*n"] | None) -> bool:
    """Whether anything counts; None is all."""
    return mask is None or bool(mask.any())


def prepare(exemplar: Image, image: Image, keep: Mask | None = None) -> tuple[MeasuredPicture, MeasuredPicture]:
    """The exemplar and the result as measures read them; masked pixels are filled, and only colour counts.

    A grey texture's tone is its lightness; one of equal lightness still has a tone.

    Parameters
    ----------
    keep : true where the result was given and not made.
    """
    labs = [_lab(fill_excluded(picture)) for picture in (exemplar, image)]
    valid = [valid_pixels(picture) for picture in (exemplar, image)]
    values = labs[0].reshape(-1, 3) if valid[0] is None else labs[0][valid[0]]
    values = values[:: reduction(exemplar.height, exemplar.width) ** 2].astype(np.float64)
    mean = values.mean(axis=0)
    variances, directions = np.linalg.eigh(np.cov(values, rowvar=False, bias=True))
    axis = directions[:, -1] * np.sign(directions[np.argmax(np.abs(directions[:, -1])), -1])
    deviation = max(float(np.sqrt(max(variances[-1], 0.0))), FLAT)
    tones = [_tone(lab, mean, axis, deviation) for lab in labs]
    made = None if keep is None else ~keep
    grey = all(picture.channels[0] == "Y" for picture in (exemplar, image))
    source = MeasuredPicture(labs[0], tones[0], valid[0], None, grey)
    return source, MeasuredPicture(labs[1], tones[1], valid[1], made, grey)


def _lab(image: Image) -> ColorField:
    """CIELAB of light that is clipped to `_MAX_LIGHT`; in bands, as color spaces need copies."""
    lab = np.empty((image.height, image.width, 3), np.float32)
    for band in bands(image.height, image.pixels):
        lab[band] = lab_from_linear(np.minimum(image.elsewhere(image.pixels[band]).color, _MAX_LIGHT))
    return lab


def _tone(lab: ColorField, mean: np.ndarray, axis: np.ndarray, deviation: float) -> Float32[np.ndarray, "h w"]:
    """See `MeasuredPicture.tone`; in bands, as double precision takes twice the picture's memory."""
    tone = np.empty(lab.shape[:2], np.float32)
    for band in bands(len(lab)):
        tone[band] = (lab[band] - mean) @ axis / deviation
    return tone


def channel_variances(lab: Float32[np.ndarray, "*n c"]) -> Float64[np.ndarray, "*c"]:
    """Variances of L, a and b; in double precision, for the mean of large plain pictures."""
    import cv2

    return np.asarray(cv2.meanStdDev(lab.reshape(-1, 1, lab.shape[-1]))[1].ravel() ** 2)


def require_variation(picture: MeasuredPicture, name: str = "the exemplar") -> None:
    """`UnmeasurableError` where the picture has one colour."""
    if not any_true(picture.counted):
        raise UnmeasurableError(f"{name} has no pixel that counts")
    if float(picture.variances.max()) <= FLAT**2:
        raise UnmeasurableError(f"{name} has one colour")


def require_side(side: int, *measured: MeasuredPicture) -> None:
    """`UnmeasurableError` where a picture is narrower or lower than ``side`` px."""
    shorter = min(picture.shorter for picture in measured)
    if shorter < side:
        raise UnmeasurableError(f"needs {side} px on the shorter side, got {shorter}")


def halves(picture: MeasuredPicture) -> list[tuple[MeasuredPicture, MeasuredPicture]]:
    """Left and right, top and bottom: disjoint parts of the same texture.

    Pairs of which masks leave too little are omitted; `UnmeasurableError` where none is left.
    """
    rows, columns = picture.tone.shape[0] // 2, picture.tone.shape[1] // 2
    cuts = ((np.s_[:, :columns], np.s_[:, columns:]), (np.s_[:rows], np.s_[rows:]))
    pairs = [(_part(picture, one), _part(picture, other)) for one, other in cuts]
    measurable = [pair for pair in pairs if all(_share(part.counted) >= _MIN_SHARE for part in pair)]
    if not measurable:
        raise UnmeasurableError("the exemplar's mask leaves too little to compare its halves")
    return measurable


def between_halves(
    picture: MeasuredPicture, distance: Callable[[MeasuredPicture, MeasuredPicture], float]
) -> float:
    """Mean distance between the two halves of each cut; 0 where masks leave too little of them."""
    try:
        return float(np.mean([distance(one, other) for one, other in halves(picture)]))
    except UnmeasurableError:
        return 0.0


def _part(picture: MeasuredPicture, place: tuple[slice, ...] | slice) -> MeasuredPicture:
    valid, made = (None if mask is None else mask[place] for mask in (picture.valid, picture.made))
    return MeasuredPicture(picture.lab[place], picture.tone[place], valid, made, picture.is_grey)


def _middle(picture: MeasuredPicture) -> MeasuredPicture:
    """The middle of a picture that is larger than `MOST_PIXELS`, with as many pixels; all of a masked one."""
    height, width = picture.tone.shape
    if height * width <= MOST_PIXELS or picture.counted is not None:
        return picture
    factor = float(np.sqrt(MOST_PIXELS / (height * width)))
    rows, columns = (
        slice((side - round(side * factor)) // 2, (side + round(side * factor)) // 2) for side in (height, width)
    )
    return _part(picture, (rows, columns))


def _share(counted: Mask | None) -> float:
    return 1.0 if counted is None or not counted.size else float(counted.mean())


def shuffled_blocks(picture: MeasuredPicture, side: int) -> MeasuredPicture:
    """Squares of ``side`` px in random order; what does not fill a square is dropped.

    Squares with masked pixels are replaced by repeating others. Of a large picture, a part of the middle is taken.
    """
    picture = _middle(picture)
    rows, columns = picture.tone.shape[0] // side, picture.tone.shape[1] // side
    rng = np.random.default_rng(0)
    order = rng.permutation(rows * columns)
    if picture.valid is not None:
        whole = count_excluded(picture.valid, side, side)[::side, ::side][:rows, :columns] == 0
        order = np.resize(rng.permutation(np.flatnonzero(whole)), rows * columns) if whole.any() else order

    def shuffled(plane: np.ndarray) -> np.ndarray:
        depth = plane.shape[2:]
        blocks = plane[: rows * side, : columns * side].reshape(rows, side, columns, side, *depth).swapaxes(1, 2)
        mixed = blocks.reshape(rows * columns, side, side, *depth)[order].reshape(blocks.shape)
        return np.ascontiguousarray(mixed.swapaxes(1, 2).reshape(rows * side, columns * side, *depth))

    return MeasuredPicture(shuffled(picture.lab), shuffled(picture.tone), is_grey=picture.is_grey)
