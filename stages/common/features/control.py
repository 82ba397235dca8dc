"""Features of a controllable texture: colour, further maps and control in one unit.

Colour is CIELAB. Other planes are scaled to it: a further map of the texture to the variance of a plane of colour,
and all control planes together to the variance of the texture times a weight. Values of control are moved apart
where the texture changes with them, see `response_curve`. Constant planes are omitted. Of a frame stack the colour
of all frames is compared, by its principal planes, and so are the frames of a control map.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.common.features.principal_planes import (
    COLOR_PLANES,
    CONTROL_PLANES,
    KEPT,
    PrincipalPlanes,
    lab_of_frames,
)
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.grids.size_checks import Sized
from texloom.stages.kernels.core.elementary_functions import power
from texloom.stages.numerics.matrices import eigenvectors, matrix_product
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_srgb
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.frame_stacks import frame_count, name_in_frame
from texloom.stages.vocabulary.sizes import format_size

_LIGHT = ("R", "G", "B", "Y")
_MIN_RANGE = 1e-6  # of a plane that is not constant, as a share of its largest value
CONTROL_WEIGHT = 3.0
"""default ratio of the variance of all control planes to that of the texture"""

_MIN_RESPONSE_PIXELS = 1024  # from which a curve is fitted
_RESPONSE_KNOTS = 64  # quantiles of control between which a curve is fitted
_RESPONSE_REACH = 4  # quantiles below and above a knot whose means are compared
_RESPONSE_CHANCE = 0.05  # of the variance, which a curve may explain by chance
_MAX_STRENGTH = 150.0  # CIELAB units for the range of a control channel, within fixed-point limits


ResponseCurve: TypeAlias = tuple[Float64[np.ndarray, "knots"], Float64[np.ndarray, "knots"]]  # type: ignore[name-defined]
"""increasing values, and what they become; both 0..1"""


def check_finite(image: Image, name: str) -> None:
    """`InputError` where an image has values that are not finite."""
    if not np.isfinite(image.pixels).all():
        raise InputError(f"{name} has values that are not finite numbers")


def check_control(control: Image, name: str) -> None:
    """`InputError` where a control map has values that are not finite, or is constant."""
    check_finite(control, name)
    if not _varying(control.pixels).any():
        raise InputError(f"{name}: every channel is constant, so that it has no influence")


def check_aspect(control: Sized, name: str, size: tuple[int, int], of: str) -> None:
    """`InputError` where a control map cannot belong to a texture of ``size``.

    Parameters
    ----------
    name, of : names of the map and the texture in the message.
    size : height and width of the texture, px; the map may have another resolution, with the same factor along both
        sides to within a pixel of the map.
    """
    if abs(control.height * size[1] - control.width * size[0]) > max(size):
        raise InputError(f"{name}: {format_size(control)} has another aspect ratio than {of}, {format_size(size)}")


def check_pair(params: Any, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The control map must have the texture's aspect ratio; neither may be constant."""
    texture, control = known.get("texture"), known.get("control")
    if isinstance(texture, Image):
        check_finite(texture, "texture")
        if (np.ptp(texture.pixels, axis=(0, 1)) == 0).all():
            raise InputError("texture: every channel is constant, so there is nothing to summarise")
    if isinstance(control, Image):
        check_control(control, "control")
    if texture is not None and control is not None:
        check_aspect(control, "control", (texture.height, texture.width), "texture")


def _matching_channels(target: Sized, control: Sized) -> list[str]:
    """The channels of ``target`` that correspond to those of ``control``, see `match_channels`.

    Whether a target is grey is checked where its pixels are known.
    """
    channels = []
    for name in control.channels:
        channel = name
        if name not in target.channels:
            channel = "Y" if name in _LIGHT[:3] else "R" if name == "Y" else ""
            is_coloured = channel == "R" and isinstance(target, Image) and not _is_grey(target)
            if channel not in target.channels or is_coloured:
                raise InputError(
                    f"target: channels {' '.join(target.channels)} do not match those of control, "
                    f"{' '.join(control.channels)}"
                )
        channels.append(channel)
    return channels


def check_maps(known: Mapping[str, Any]) -> None:
    """Check the known ones of ``image``, ``control`` and ``target``.

    Raises
    ------
    InputError
        they do not fit each other; control is constant; a value is not finite.
    """
    image, control, target = (known.get(name) for name in ("image", "control", "target"))
    if isinstance(image, Image):
        check_finite(image, "image")
    if image is not None and control is not None:
        check_aspect(control, "control", (image.height, image.width), "image")
    if isinstance(control, Image):
        check_control(control, "control")
    if isinstance(target, Image):
        check_finite(target, "target")
    if target is not None and control is not None:
        _matching_channels(target, control)


def matched_target(control: Image | None, target: Image | None) -> Image | None:
    """The target with the channels of control, see `match_channels`; None where there is neither.

    Raises
    ------
    InputError
        only one is given; channels do not match.
    """
    if control is None and target is None:
        return None
    if control is None or target is None:
        raise InputError("control and target go together; give both or neither")
    return match_channels(target, control)


def match_channels(target: Image, control: Image) -> Image:
    """The planes of ``target`` that correspond to those of ``control``, by name; a grey one replaces R, G and B.

    Raises
    ------
    InputError
        ``target`` lacks a channel, or is coloured where ``control`` is grey.
    """
    channels = _matching_channels(target, control)
    planes = [target.pixels[..., target.channels.index(channel)] for channel in channels]
    return target.with_pixels(np.ascontiguousarray(np.stack(planes, axis=2)), control.channels)


def _is_grey(image: Image) -> bool:
    colour = image.pixels[..., :3]
    return image.channels[:3] == _LIGHT[:3] and bool((colour == colour[..., :1]).all())


def _varying(planes: Float32[np.ndarray, "h w c"]) -> np.ndarray:
    """Whether each plane is not constant."""
    rows = by_plane(planes, np.float32)
    low, high = rows.min(axis=1), rows.max(axis=1)
    return np.asarray(high - low > _MIN_RANGE * np.maximum(-low, high))


def by_plane(values: np.ndarray, dtype: type) -> np.ndarray:
    """A row for each plane, the last axis; statistics of rows take a fraction of the time of those of columns."""
    return values.reshape(-1, values.shape[-1]).T.astype(dtype, order="C")


def resize_control(control: Image, height: int, width: int) -> Image:
    """Resample a control map's values as they were painted, see `painted_values`; the result is linear light."""
    if (control.height, control.width) == (height, width):
        return control
    planes = resize(painted_values(control), height, width, bilinear=True)
    return from_painted(planes, control.channels)


def painted_values(image: Image) -> Float32[np.ndarray, "h w c"]:
    """The numbers of an image as they were painted.

    Linear light is encoded by the sRGB curve, which gives the values of an 8-bit file. The curve is continued above
    1, and below 0 as its mirror image.
    """
    planes = image.pixels.copy()
    for channel, name in enumerate(image.channels):
        if name_in_frame(name) in _LIGHT:
            size = np.abs(planes[..., channel])
            encoded = np.where(size <= 0.0031308, 12.92 * size, 1.055 * power(size, 1 / 2.4) - 0.055)
            planes[..., channel] = np.sign(planes[..., channel]) * encoded
    return planes


def painted_mean(image: Image) -> ScalarMap:
    """The mean of an image's colours as they were painted."""
    return np.asarray(painted_values(image)[..., : 1 if image.channels[0] == "Y" else 3].mean(axis=2))


def from_painted(planes: Float32[np.ndarray, "h w c"], channels: tuple[str, ...]) -> Image:
    """The image of numbers as they were painted, the inverse of `painted_values`."""
    values = planes.copy()
    for channel, name in enumerate(channels):
        if name_in_frame(name) in _LIGHT:
            values[..., channel] = np.sign(planes[..., channel]) * linear_from_srgb(np.abs(planes[..., channel]))
    return Image(values, channels)


@dataclasses.dataclass(frozen=True)
class ControlScale:
    """Scaling of texture and control to CIELAB units, fitted to a texture with its control."""

    further: dict[int, tuple[float, float]]
    """further channels of the texture that are not constant: mean and scale factor"""
    control: dict[int, tuple[float, float]]
    """channels of control that are not constant: minimum and maximum"""
    strength: float
    """scale of the range of a control plane, CIELAB units"""
    curves: dict[int, ResponseCurve]
    """of channels of control whose values do not count by their difference; see `response_curve`"""
    frames: PrincipalPlanes | None = None
    """of the colour of a frame stack; none of any other texture"""
    control_frames: PrincipalPlanes | None = None
    """of a stack of control maps"""

    @property
    def planes(self) -> int:
        """Number of planes of texture and control together."""
        own = 3 + len(self.further) if self.frames is None else self.frames.count
        return own + (len(self.control) if self.control_frames is None else self.control_frames.count)

    def of_texture(self, image: Image) -> Float32[np.ndarray, "h w c"]:
        """CIELAB and further maps; of a frame stack the principal planes of all frames' CIELAB."""
        if self.frames is not None:
            return self.frames.project(lab_of_frames(image))
        planes = [lab_from_linear(image.color)]
        for channel, (mean, factor) in self.further.items():
            planes.append((image.pixels[..., channel, None] - np.float32(mean)) * np.float32(factor))
        return np.concatenate(planes, axis=2)

    def of_control(self, control: Image, height: int, width: int) -> Float32[np.ndarray, "h w c"]:
        """Control at ``height`` x ``width`` px, (h, w, k), clipped to the fitted range."""
        planes = self._ranged(control, height, width)
        return planes if self.control_frames is None else self.control_frames.project(planes)

    def _ranged(self, control: Image, height: int, width: int) -> Float32[np.ndarray, "h w k"]:
        values = resize(painted_values(control), height, width, bilinear=True)
        planes = [
            _responses(values[..., channel], limits, self.curves.get(channel))
            for channel, limits in self.control.items()
        ]
        if not planes:
            return np.zeros((height, width, 0), np.float32)
        return np.stack(planes, axis=2) * np.float32(self.strength)

    def beyond(self, control: Image) -> float:
        """Share of the pixels of ``control`` outside the fitted range by more than 1 % of it."""
        values = painted_values(control)
        outside = np.zeros(values.shape[:2], bool)
        for channel, (low, high) in self.control.items():
            slack = 0.01 * (high - low)
            outside |= (values[..., channel] < low - slack) | (values[..., channel] > high + slack)
        return float(outside.mean())


def _responses(
    values: Float32[np.ndarray, "..."], limits: tuple[float, float], curve: ResponseCurve | None
) -> Float32[np.ndarray, "..."]:
    """Values of control between their limits, 0..1."""
    low, high = limits
    shares = np.clip((values - np.float32(low)) / np.float32(high - low), 0, 1)
    return shares if curve is None else np.interp(shares, *curve).astype(np.float32)


def response_curve(
    shares: Float32[np.ndarray, "n"],  # type: ignore[name-defined]
    rest: Float32[np.ndarray, "n c"],
    explained: float,
) -> ResponseCurve:
    """The curve that moves values of control apart where the texture changes with them, and not in proportion.

    Elevations from the deepest sea to the highest mountain hardly differ between water and shore, but the texture
    does. Pixels are sorted by control; the slope of the curve at a value is the squared difference of the means of
    ``rest`` over a sixteenth of the pixels below and above it, in excess of the median of all. The more variance
    a straight line explains, relative to the curve, the more of it is that line; at least half.

    Parameters
    ----------
    shares : of control's range, 0..1.
    rest : of the texture at the same pixels, what is not proportional to control.
    explained : variance of the texture that is.
    """
    line = np.array([0.0, 1.0])
    if len(shares) < _MIN_RESPONSE_PIXELS:
        return line, line
    order, reach = np.argsort(shares, kind="stable"), _RESPONSE_REACH
    ends = np.linspace(0, len(order), _RESPONSE_KNOTS + 1).astype(np.int64)
    sums = np.cumsum(np.pad(rest[order], ((1, 0), (0, 0))), axis=0, dtype=np.float64)[ends]
    means = (sums[reach:] - sums[:-reach]) / (ends[reach:] - ends[:-reach])[:, None]
    steps = ((means[reach:] - means[:-reach]) ** 2).sum(axis=1)
    rise = np.cumsum(np.pad(np.maximum(steps - np.median(steps), 0), (1, 0)))
    if rise[-1] == 0:
        return line, line
    # The step at a knot belongs between the middles of the two intervals beside it.
    middles = (ends[reach - 1 : -reach] + ends[reach : 1 - reach]) // 2
    known = np.concatenate([[0.0], shares[order[middles]], [1.0]])
    values, last = np.unique(known[::-1], return_index=True)
    moved = np.concatenate([[0.0], rise / rise[-1], [1.0]])[::-1][last]
    moved = (moved - moved[0]) / max(float(moved[-1] - moved[0]), 1e-9)
    gained = float((means**2).sum(axis=1).mean())
    total = explained + float(by_plane(rest, np.float64).var(axis=1).sum())
    weight = min(0.5, gained / max(gained + explained + _RESPONSE_CHANCE * total, 1e-9))
    return values, (1 - weight) * values + weight * moved


def _not_proportional(
    shares: Float32[np.ndarray, "n k"], texture: Float32[np.ndarray, "n c"]
) -> tuple[Float32[np.ndarray, "n c"], float]:
    """What a linear function of control does not explain of the texture, and the variance that it does."""
    centred, own = (part - part.mean(axis=0, dtype=np.float64) for part in (texture, shares))
    moments, products = (np.einsum("nk,nc->kc", own, part) for part in (own, centred))  # no threads, as BLAS has
    values, vectors = eigenvectors(moments)
    kept = vectors[:, values > 1e-12 * values.max(initial=0.0)]
    factors = matrix_product(kept.T, products) / values[-kept.shape[1] :, None] if kept.size else products[:0]
    proportional = np.einsum("nk,kc->nc", own, matrix_product(kept, factors))
    return (centred - proportional).astype(np.float32), float(by_plane(proportional, np.float64).var(axis=1).sum())


def fit_scale(image: Image, control: Image | None, weight: float, linear: bool = False) -> ControlScale:
    """Fit the scaling to a texture with its control.

    Parameters
    ----------
    control : of any size, or None.
    weight : ratio of the variance of all control planes to that of the texture, within fixed-point limits.
    linear : differences of control count alike at all values; always so for frame stacks.
    """
    is_stack = frame_count(image.channels) > 1
    light = lab_of_frames(image) if is_stack else lab_from_linear(image.color)
    colour = by_plane(light, np.float64).var(axis=1)
    first = 1 if image.channels[0] == "Y" else 3
    deviation = float(np.sqrt(colour.mean()))
    further = {}
    for channel in np.flatnonzero(_varying(image.pixels)):
        if channel >= first and not is_stack:
            plane = image.pixels[..., channel].astype(np.float64)
            further[int(channel)] = (float(plane.mean()), max(deviation, 1.0) / float(plane.std()))
    ranges: dict[int, tuple[float, float]] = {}
    curves: dict[int, ResponseCurve] = {}
    strength = 0.0
    if control is not None:
        values = painted_values(control).reshape(-1, len(control.channels))
        channels = np.flatnonzero(_varying(control.pixels)).tolist()
        ranges = {
            channel: (float(values[:, channel].min()), float(values[:, channel].max())) for channel in channels
        }
        shares = {channel: _responses(values[:, channel], ranges[channel], None) for channel in channels}
        if not linear and not is_stack and channels:
            texture = resize(light, control.height, control.width, bilinear=True).reshape(len(values), -1)
            rest, explained = _not_proportional(np.stack(list(shares.values()), axis=1), texture)
            curves = {channel: response_curve(shares[channel], rest, explained) for channel in channels}
        spread = sum(
            float(_responses(values[:, channel], ranges[channel], curves.get(channel)).astype(np.float64).var())
            for channel in channels
        )
        total = max(float(colour.sum()) + len(further) * max(deviation, 1.0) ** 2, 1.0)
        strength = min(_MAX_STRENGTH, float(np.sqrt(weight * total / spread)))
    frames = PrincipalPlanes.of(light, COLOR_PLANES, KEPT) if is_stack else None
    scale = ControlScale(further, ranges, strength, curves, frames)
    if control is None or frame_count(control.channels) == 1 or len(ranges) <= CONTROL_PLANES:
        return scale
    planes = PrincipalPlanes.of(scale._ranged(control, control.height, control.width), CONTROL_PLANES)
    return dataclasses.replace(scale, control_frames=planes)
