"""Interactive painting of a control map: after every stroke only the affected pixels are synthesised again."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8, UInt32

from texloom.stages.analysis.similarity.appearance_stack import (
    AppearanceStack,
    AppearanceStackParams,
    appearance_stack,
)
from texloom.stages.common.features.control import check_aspect, check_control, painted_values
from texloom.stages.common.per_pixel.device import Device, levels_on, target_on
from texloom.stages.common.per_pixel.levels import Rect
from texloom.stages.common.per_pixel.tables import CONTROLS
from texloom.stages.common.per_pixel.target import normalised
from texloom.stages.interactive.painted_colours import CoarseColours, PaintedColours, check_coarse
from texloom.stages.synthesis.control_maps.coarse_choice import difference
from texloom.stages.synthesis.per_pixel.coarse_colours import CoarsePlanes
from texloom.stages.synthesis.per_pixel.per_pixel import (
    ArrangementParams,
    check_divisible,
    fitted_control,
    style_of,
    tables_with,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import parse_tileable

__all__ = ["Canvas", "CoarseColours", "Rect", "colours_help"]

_TRIED = 512  # px, the side of the part of a texture that is made again to decide


class Canvas:
    """A texture of a fixed size that follows a control map.

    The control map holds the exemplar's control values as they were painted: 0..1 for 0..255 of an 8-bit image, one
    plane for each of ``channels``. The texture is always bit-identical to that of a new canvas with the same map;
    `per_pixel` also adapts a map of rare values, and the exemplar's to a smooth one. A canvas must be used by one
    thread at a time.

    Parameters
    ----------
    image : the exemplar, such as a compaction; an image, or an array as `Image.of` takes it.
    control : its control map, likewise.
    size : height and width of the texture, px.
    values : the initial control map, (height, width, planes) float32, or a constant.
    seed : seed of the random numbers.
    tileable : whether the texture is tileable, or along which axis, ``x`` or ``y``; the control map should be too.
    params : parameters of the synthesis.
    stack : the exemplar's analysis; computed here if not given, which takes a second or more.
    device : ``cpu``, ``gpu``, or ``auto``, a GPU where there is one; results are bit-identical. None uses the
        environment variable TEXLOOM_DEVICE, default ``cpu``.
    coarse : for a compaction, the colours of the texture that it was made from, by which places are compared too;
        see `colours_help`.

    Raises
    ------
    InputError
        control does not match the exemplar, a side of a tileable texture is not divisible as required, or there is
        no GPU.
    ValueError
        ``values`` have another shape or are not finite.

    Examples
    --------
    >>> import skimage.data
    >>> grass = skimage.data.grass()[:64, :64]
    >>> canvas = Canvas(grass, grass, (64, 96), values=0.2)
    >>> changed = canvas.paint(np.full((16, 16, 1), 0.9, np.float32), top=8, left=40)
    >>> canvas.picture(changed[0]).dtype
    dtype('uint8')
    """

    def __init__(
        self,
        image: Image | np.ndarray,
        control: Image | np.ndarray,
        size: tuple[int, int],
        *,
        values: Float32[np.ndarray, "H W k"] | float = 0.0,
        seed: int = 7,
        tileable: bool | str = False,
        params: ArrangementParams | None = None,
        stack: AppearanceStack | None = None,
        device: Device | None = None,
        coarse: CoarseColours | None = None,
    ):
        image, control = (Image.of(one) if isinstance(one, np.ndarray) else one for one in (image, control))
        check_aspect(control, "control", (image.height, image.width), "image")
        check_control(control, "control")
        if min(size) < 1:
            raise InputError(f"size: {format_size(size)} has no pixel")
        params = params or ArrangementParams()
        stack = stack or appearance_stack(image, AppearanceStackParams())
        scale, own = fitted_control(image, control, linear=True)
        assert scale is not None
        assert own is not None
        self.size = size
        self.channels = tuple(control.channels[channel] for channel in scale.control)
        lows, highs = np.array(list(scale.control.values()), np.float32).T.copy()
        self._limits = lows, highs
        weight, fitted = params.control_weight, None
        if coarse is not None and own.shape[2] + coarse.guide.shape[2] <= CONTROLS:
            check_coarse(coarse, image, control)
            fitted = CoarsePlanes.of(own, weight, image, coarse.guide)
            own, weight = np.concatenate([own, _raised(fitted, coarse.guide)], axis=2), fitted.weight
        tables = tables_with(image, stack, own, None, weight)
        self._tables = tables
        # Values of all places, so that one index selects them.
        pixels = tables.pixels_of(np.arange(tables.places, dtype=np.int32).reshape(-1, tables.pitch))
        rows, columns = (np.clip(part, 0, side - 1) for part, side in zip(pixels, tables.shape, strict=True))
        self._pixels = image.pixels[rows, columns].reshape(tables.places, -1)
        colours = image.srgb
        self._colours = colours[rows, columns].reshape(tables.places, 3)
        try:
            wrap = parse_tileable(tileable)
        except ValueError as error:
            raise InputError(f"tileable: {error}") from None
        check_divisible(size, tables.levels, wrap)
        self._levels = levels_on(
            device, tables, style_of(params, tables.levels, seed), Rect(0, size[0], 0, size[1]), wrap
        )
        initial = values if isinstance(values, np.ndarray) else np.full((*size, self.planes), values, np.float32)
        self._check(initial, 0, 0)
        if initial.shape[:2] != size:
            raise ValueError(f"values of shape {initial.shape} for a canvas of {size}")
        self._painted: PaintedColours | None = None
        planes = normalised(initial, self._limits)
        if coarse is not None and fitted is not None:
            texture = painted_values(coarse.control)[..., list(scale.control)]
            colours = _raised(fitted, lab_from_linear(coarse.level.color))
            self._painted = PaintedColours(normalised(texture, self._limits), colours, size, wrap)
            self._painted.paint(planes, 0, 0)
            self._target = target_on(self._levels, self._painted.planes)
        else:
            self._target = target_on(self._levels, planes, self._limits)
        self._levels.run()

    @property
    def planes(self) -> int:
        """Planes of the control map: the exemplar's control channels that are not constant."""
        return len(self.channels)

    def paint(self, values: Float32[np.ndarray, "h w k"], top: int = 0, left: int = 0) -> list[Rect]:
        """Replace a rectangle of the control map and update the texture.

        Parameters
        ----------
        values : (h, w, planes), clipped to the exemplar's range.
        top, left : row and column of the rectangle, px; it must be inside the canvas.

        Returns
        -------
        the changed rectangle of the texture, px: rows ``top`` to ``bottom`` and columns ``left`` to ``right``; an
        empty list where nothing has changed.
        """
        self._check(values, top, left)
        if self._painted is not None:
            area = self._painted.paint(normalised(values, self._limits), top, left)
            values, top, left = (
                self._painted.planes[area.top : area.bottom, area.left : area.right],
                area.top,
                area.left,
            )
        changed = self._levels.update(self._target.paint(values, top, left))
        return [] if changed.empty else [changed]

    def control(self, area: Rect | None = None) -> Float32[np.ndarray, "h w k"]:
        """A copy of the control map, or of a part."""
        lows, highs = self._limits
        planes = self._target.planes(self._inside(area))[..., : self.planes]
        return np.asarray(planes * (highs - lows) + lows, np.float32)

    def match(self, area: Rect | None = None) -> UInt32[np.ndarray, "h w 2"]:
        """Row and column of the exemplar pixel of each pixel."""
        return np.stack(self._tables.pixels_of(self._places(area)), axis=2).astype(np.uint32)

    def pixels(self, area: Rect | None = None) -> Float32[np.ndarray, "h w c"]:
        """The texture, or a part: all channels of the exemplar, linear light."""
        return self._pixels.take(self._places(area), axis=0)

    def picture(self, area: Rect | None = None) -> UInt8[np.ndarray, "h w 3"]:
        """The texture for display, or a part: sRGB, 0..255."""
        return self._colours.take(self._places(area), axis=0)

    def _places(self, area: Rect | None) -> np.ndarray:
        places: np.ndarray = self._levels.finest(self._inside(area))
        return places

    def _inside(self, area: Rect | None) -> Rect:
        whole = Rect(0, self.size[0], 0, self.size[1])
        part = whole if area is None else area.within(whole)
        return Rect(part.top, max(part.top, part.bottom), part.left, max(part.left, part.right))

    def _check(self, values: np.ndarray, top: int, left: int) -> None:
        height, width = self.size
        if values.ndim != 3 or values.shape[2] != self.planes:
            raise ValueError(f"values of shape {values.shape}, not (h, w, {self.planes})")
        if min(top, left) < 0 or top + values.shape[0] > height or left + values.shape[1] > width:
            raise ValueError(
                f"values of shape {values.shape} at row {top}, column {left} "
                f"on a canvas of {format_size((height, width))}"
            )
        if not np.isfinite(values).all():
            raise ValueError("a value is not finite")


def colours_help(
    texture: Image,
    image: Image,
    control: Image,
    coarse: CoarseColours,
    params: ArrangementParams | None = None,
    stack: AppearanceStack | None = None,
    seed: int = 7,
) -> bool:
    """Whether the colours bring a canvas, under the texture's own control map, nearer to the texture.

    Parameters
    ----------
    texture : the original, of the size of ``coarse.control``.
    image, control, params, stack, seed : as of `Canvas`.
    """
    size = min(texture.height, _TRIED), min(texture.width, _TRIED)
    part = np.s_[: size[0], : size[1]]
    scale = fitted_control(image, control, linear=True)[0]
    assert scale is not None
    values = painted_values(coarse.control)[part][..., list(scale.control)]
    stack = stack or appearance_stack(image, AppearanceStackParams())
    wanted = Image(np.ascontiguousarray(texture.color[part]), ("R", "G", "B"))
    errors = []
    for one in (None, coarse):
        made = Canvas(image, control, size, values=values, seed=seed, params=params, stack=stack, coarse=one)
        errors.append(difference(wanted, image.elsewhere(made.pixels())))
    return errors[1] < errors[0]


def _raised(fitted: CoarsePlanes, colours: np.ndarray) -> np.ndarray:
    """Planes of colours in 0..1, the range in which a canvas holds control."""
    raised: np.ndarray = fitted.planes(colours, 0.5) + np.float32(0.5)
    return raised
