"""Pages that open from a disk without a network: templates, pictures inside them, figures in words and colours."""

import base64
import dataclasses
import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.arrays import Image, Mask, Page
from texloom.stages.color import srgb_from_linear
from texloom.stages.evaluation._pages import templates

_WORST, _MIDDLE, _BEST = (213, 94, 0), (240, 228, 66), (0, 158, 115)
"""vermilion, yellow, bluish green: they differ for colour-blind eyes too"""


@dataclasses.dataclass(frozen=True)
class Shown:
    """A picture inside a page."""

    source: str
    """data URI"""
    height: int
    """px of the picture itself; what the page holds may be smaller"""
    width: int
    held: tuple[int, int]
    """height and width of what the page holds, px"""

    @property
    def is_reduced(self) -> bool:
        """Whether the page holds less than the picture."""
        return self.held != (self.height, self.width)


def writable(text: str) -> str:
    """Text without what UTF-8 cannot hold, as names of files may have."""
    return text.encode("utf-8", "replace").decode()


def render(template: str, **values: Any) -> Page:
    """Fill a template of `_templates`; all values are text, never markup, unless they say that they are."""
    from markupsafe import Markup

    digest = base64.b64encode(hashlib.sha256(templates.SCRIPT.encode()).digest()).decode()
    page: str = (
        _environment()
        .get_template(template)
        .render(style=Markup(templates.STYLE), script=Markup(templates.SCRIPT), digest=digest, **values)  # noqa: S704
    )
    return writable(page)


@cache
def _environment() -> Any:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.DictLoader(templates.TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "score_color": score_color, "seconds": seconds}
    return environment


# -- pictures


def shown(image: Image, largest: int, quality: int | None = None) -> Shown:
    """The colour of a picture in sRGB, clipped to 0..1.

    Parameters
    ----------
    largest : a longer side is reduced to this, px, by averaging light.
    quality : of lossy WebP, 0..100; without it not a bit is lost.
    """
    color = np.nan_to_num(image.color, nan=0.0, posinf=1.0, neginf=0.0)
    color = _reduced(color, largest)
    levels = np.rint(srgb_from_linear(color) * 255).astype(np.uint8)
    return Shown(_data_uri(levels, quality), image.height, image.width, (levels.shape[0], levels.shape[1]))


def shown_levels(values: Float32[np.ndarray, "h w c"], largest: int) -> Shown:
    """One or three planes as they are, from 0, black, to 1, white; without loss unless reduced."""
    three = np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values
    reduced = _reduced(np.clip(np.nan_to_num(three), 0, 1), largest)
    levels = np.rint(reduced * 255).astype(np.uint8)
    return Shown(_data_uri(levels), values.shape[0], values.shape[1], (levels.shape[0], levels.shape[1]))


def shown_mask(mask: Mask, largest: int) -> Shown:
    """White where the mask is true."""
    white = np.repeat(mask[..., None].astype(np.float32), 3, axis=2)
    levels = np.rint(_reduced(white, largest) * 255).astype(np.uint8)
    return Shown(_data_uri(levels), mask.shape[0], mask.shape[1], (levels.shape[0], levels.shape[1]))


def shown_field(field: Float32[np.ndarray, "h w"], centre: float, reach: float, largest: int) -> Shown:
    """Blue below ``centre``, white there, red above, darkest from a distance of ``reach`` on; NaN is black."""
    values = _reduced(np.repeat(field[..., None], 3, axis=2), largest)[..., 0]
    known = np.isfinite(values)
    share = np.where(known, (values - centre) / (2 * reach) + 0.5, 0.5)
    levels = _diverging()[np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)]
    levels[~known] = 0
    return Shown(_data_uri(levels), field.shape[0], field.shape[1], (levels.shape[0], levels.shape[1]))


def legend_colors() -> list[str]:
    """CSS colours of `shown_field`, from the lowest value to the highest."""
    return [_css(color) for color in _diverging()[:: 255 // 5].tolist()]


@cache
def _diverging() -> UInt8[np.ndarray, "256 3"]:
    import matplotlib

    colors = matplotlib.colormaps["RdBu_r"](np.arange(256))[:, :3]
    return np.rint(np.asarray(colors) * 255).astype(np.uint8)


def _reduced(values: Float32[np.ndarray, "h w 3"], largest: int) -> Float32[np.ndarray, "H W 3"]:
    factor = largest / max(values.shape[:2])
    if factor >= 1:
        return values
    import cv2

    height, width = (max(1, round(side * factor)) for side in values.shape[:2])
    return np.asarray(cv2.resize(np.ascontiguousarray(values), (width, height), interpolation=cv2.INTER_AREA))


def _data_uri(levels: UInt8[np.ndarray, "h w 3"], quality: int | None = None) -> str:
    """WebP: without loss it takes two thirds of a PNG's bytes, and every browser reads it."""
    import PIL.Image

    # without loss, quality is effort
    options = {"lossless": True, "quality": 30, "method": 1} if quality is None else {"quality": quality}
    buffer = io.BytesIO()
    PIL.Image.fromarray(levels).save(buffer, "WEBP", **options)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()


# -- figures


def number(value: Any) -> str:
    """A number in at most four digits; words as they are; a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return (f"{value:.4g}" if abs(value) >= 0.001 or value == 0 else f"{value:.1e}").replace("-", "−", 1)
    if isinstance(value, list | tuple):
        return ", ".join(number(part) for part in value)
    return str(value)


def seconds(value: Any) -> str:
    """A duration."""
    if not isinstance(value, int | float):
        return "–"
    return f"{value:.2f} s" if value < 10 else f"{value:.0f} s" if value < 120 else f"{value / 60:.1f} min"


def score_color(score: Any) -> str:
    """CSS colour of a score: bluish green for 1, yellow for a half, vermilion for 0, grey for None."""
    if not isinstance(score, int | float) or not np.isfinite(score):
        return "rgb(128 128 128)"
    place = min(max(float(score), 0.0), 1.0) * 2
    low, high = (_WORST, _MIDDLE) if place < 1 else (_MIDDLE, _BEST)
    share = place if place < 1 else place - 1
    return _css([round(one + (other - one) * share) for one, other in zip(low, high, strict=True)])


def _css(color: Iterable[int]) -> str:
    red, green, blue = color
    return f"rgb({red} {green} {blue})"


# -- provenance


def steps(provenance: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The steps of all items, those that differ by item alone on one line, in order of their first.

    Returns
    -------
    for each line ``step``, ``stage``, ``version``, ``program``, ``params`` (name to text), ``seconds`` (their sum),
    and ``runs``: ``item``, ``seed``, ``key``, ``created`` and ``seconds`` of each.
    """
    lines: dict[str, dict[str, Any]] = {}
    for entry in provenance:
        common = {name: entry.get(name) for name in ("step", "stage", "version", "program", "params")}
        line = lines.setdefault(
            json.dumps(common, sort_keys=True, default=str), {**common, "seconds": None, "runs": []}
        )
        params = entry.get("params") or {}
        line["params"] = {name: json.dumps(params[name], default=str).strip('"') for name in params}
        line["runs"].append({name: entry.get(name) for name in ("item", "seed", "key", "created", "seconds")})
        took = entry.get("seconds")
        if isinstance(took, int | float):
            line["seconds"] = (line["seconds"] or 0) + took
    return list(lines.values())
