"""Self-contained HTML pages: templates, embedded pictures, provenance."""

import base64
import dataclasses
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.evaluation._pages.text import css_color, number, score_color, seconds, writable
from texloom.stages.vocabulary.animation import animated_webp
from texloom.stages.vocabulary.arrays import Image, Mask, Page
from texloom.stages.vocabulary.color import srgb_codes, srgb_from_linear
from texloom.stages.vocabulary.scratch import bands

_BLUE_TO_RED = (
    (5, 48, 97),
    (33, 102, 172),
    (67, 147, 195),
    (146, 197, 222),
    (209, 229, 240),
    (247, 247, 247),
    (253, 219, 199),
    (244, 165, 130),
    (214, 96, 77),
    (178, 24, 43),
    (103, 0, 31),
)  # fmt: skip  (ColorBrewer's RdBu)
_PARTS = ("page.html.j2", "page.parts.html.j2")
_LARGE = 4096
"""px; pictures of more than its square are reduced before anything else"""


@dataclasses.dataclass(frozen=True)
class PagePicture:
    """A picture inside a page."""

    source: str
    """data URI"""
    height: int
    """px of the picture itself; the page may hold a smaller one"""
    width: int
    held: tuple[int, int]
    """height and width in the page, px"""

    @property
    def is_reduced(self) -> bool:
        """Whether the page holds a smaller picture."""
        return self.held != (self.height, self.width)


@dataclasses.dataclass(frozen=True)
class ReportPage:
    """The page."""

    page: Page
    """with all pictures inside; it needs no network"""


def template_of(module: str) -> Any:
    """The template of a module, by its ``__file__``: that of ``report.py`` is ``report.html.j2`` beside it.

    Files of that name belong to the module's code, see `code_digest`. It and those that it uses are compiled.
    """
    path = Path(module)
    environment = _environment(path.parent)
    for part in _PARTS:
        environment.get_template(part)
    return environment.get_template(f"{path.stem}.html.j2")


def render(
    template: Any, title: str, provenance: Sequence[Mapping[str, Any]], is_titled: bool = True, **values: Any
) -> ReportPage:
    """Fill a template, see `template_of`. Values are escaped unless they are `Markup`.

    Parameters
    ----------
    provenance : the steps upstream, listed at the end of the page.
    is_titled : whether ``title`` stays; otherwise the run that exports the page replaces it by the picture's name.
    """
    html = template.render(title=title, is_titled=is_titled, steps=steps(provenance), **values)
    return ReportPage(writable(html))


@cache
def _environment(folder: Path) -> Any:
    """Templates of a folder, and ``page.*`` beside this module, which all of them use."""
    import jinja2
    from markupsafe import Markup

    here = Path(__file__)
    style, script = (f"\n{here.with_suffix(suffix).read_text('utf-8')}" for suffix in (".css", ".js"))
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, here.parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "score_color": score_color, "seconds": seconds}
    environment.globals |= {
        "style": Markup(style),  # noqa: S704
        "script": Markup(script),  # noqa: S704
        "legend_colors": _legend_colors(),
        "script_digest": base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    }
    return environment


# -- pictures


def shown(image: Image | None, largest: int, quality: int | None = None) -> PagePicture | None:
    """The colour of a picture in sRGB, clipped to 0..1; None for None.

    Parameters
    ----------
    largest : longest side, px; larger pictures are reduced by averaging linear light.
    quality : of lossy WebP, 0..100; lossless without it.
    """
    if image is None:
        return None
    color = _reduced(np.nan_to_num(image.color, nan=0.0, posinf=1.0, neginf=0.0), largest)
    return _embedded(srgb_from_linear(color), image.height, image.width, quality)


def overview(image: Image) -> Image:
    """A large picture by the means of square blocks, so that what is made of it needs little memory."""
    step = max(image.shape[:2]) // _LARGE if image.height * image.width > _LARGE**2 else 1
    if step < 2:
        return image
    height, width, count = image.height // step, image.width // step, len(image.channels)
    pixels = np.empty((height, width, count), np.float32)
    for band in bands(height, image.pixels):
        rows = image.pixels[band.start * step : band.stop * step, : width * step]
        pixels[band] = rows.reshape(-1, step, width, step, count).mean(axis=(1, 3))
    return image.elsewhere(pixels)


def shown_frames(frames: Sequence[Image], largest: int) -> PagePicture:
    """The frames of a stack as an animation; see `shown`."""
    levels = [srgb_codes(_reduced(frame.color, largest)) for frame in frames]
    held = (levels[0].shape[0], levels[0].shape[1])
    return PagePicture(_data_uri(animated_webp(levels)), frames[0].height, frames[0].width, held)


def shown_levels(values: Float32[np.ndarray, "h w c"], largest: int) -> PagePicture:
    """One or three planes without conversion, from 0, black, to 1, white; lossless unless reduced."""
    three = np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values
    return _embedded(_reduced(np.clip(np.nan_to_num(three), 0, 1), largest), values.shape[0], values.shape[1])


def shown_structure(structure: Mask, largest: int) -> PagePicture:
    """White on features."""
    return shown_levels(structure[..., None].astype(np.float32), largest)


def shown_field(field: Float32[np.ndarray, "h w"], centre: float, reach: float, largest: int) -> PagePicture:
    """Blue below ``centre``, white there, red above, darkest from a distance of ``reach`` on; NaN is black."""
    values = _reduced(np.repeat(field[..., None], 3, axis=2), largest)[..., 0]
    known = np.isfinite(values)
    share = np.where(known, (values - centre) / (2 * reach) + 0.5, 0.5)
    colors = _diverging()[np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)] / 255
    colors[~known] = 0
    return _embedded(colors, field.shape[0], field.shape[1])


def _legend_colors() -> list[str]:
    """CSS colours of `shown_field`, from the lowest value to the highest."""
    return [css_color(color) for color in _diverging()[:: 255 // 5].tolist()]


@cache
def _diverging() -> UInt8[np.ndarray, "256 3"]:
    places = np.arange(256) / 255 * (len(_BLUE_TO_RED) - 1)
    channels = [
        np.interp(places, np.arange(len(_BLUE_TO_RED)), channel) for channel in zip(*_BLUE_TO_RED, strict=True)
    ]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


def _reduced(values: Float32[np.ndarray, "h w 3"], largest: int) -> Float32[np.ndarray, "H W 3"]:
    factor = largest / max(values.shape[:2])
    if factor >= 1:
        return values
    import cv2

    height, width = (max(1, round(side * factor)) for side in values.shape[:2])
    return np.asarray(cv2.resize(np.ascontiguousarray(values), (width, height), interpolation=cv2.INTER_AREA))


def _embedded(values: np.ndarray, height: int, width: int, quality: int | None = None) -> PagePicture:
    """Values of 0..1 as WebP: lossless, it takes two thirds of a PNG's bytes, and every browser reads it."""
    import PIL.Image

    levels = np.rint(values * 255).astype(np.uint8)
    # for lossless pictures, quality is effort
    options = {"lossless": True, "quality": 30, "method": 1} if quality is None else {"quality": quality}
    buffer = io.BytesIO()
    PIL.Image.fromarray(levels).save(buffer, "WEBP", **options)
    return PagePicture(_data_uri(buffer.getvalue()), height, width, (levels.shape[0], levels.shape[1]))


def _data_uri(webp: bytes) -> str:
    return "data:image/webp;base64," + base64.b64encode(webp).decode()


# -- provenance


def steps(provenance: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The steps of all items in order; those that differ only by item share a line.

    Returns
    -------
    for each line ``step``, ``stage``, ``version``, ``program``, ``params`` (name to text), ``seconds`` (their sum),
    and ``runs``: ``item``, ``seed``, ``key``, ``created`` and ``seconds`` of each.
    """
    lines: dict[str, dict[str, Any]] = {}
    for entry in provenance:
        common = {name: entry.get(name) for name in ("step", "stage", "version", "program", "params")}
        group = json.dumps(common, sort_keys=True, default=str)
        line = lines.setdefault(group, {**common, "seconds": None, "runs": []})
        params = entry.get("params") or {}
        line["params"] = {name: json.dumps(params[name], default=str).strip('"') for name in params}
        line["runs"].append({name: entry.get(name) for name in ("item", "seed", "key", "created", "seconds")})
        if isinstance(entry.get("seconds"), int | float):
            line["seconds"] = (line["seconds"] or 0) + entry["seconds"]
    return list(lines.values())
