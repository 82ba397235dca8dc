"""Pictures, tables of scores, and what is read back from pages."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import skimage.data

from tests.synthetic import picture
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb

EVIL = "<script>alert(1)</script><img src=http://example.invalid/x onerror=alert(1)>\"'&\udcff"

Table = dict[str, Any]
Tables = dict[str, list[Table | None]]


def encoded(values: np.ndarray) -> Image:
    """A picture of sRGB values in 0..1, grey or colour."""
    return picture(linear_from_srgb(np.clip(values, 0, 1)))


def tinted(name: str) -> np.ndarray:
    """A grey photograph of scikit-image in colours that depend on its lightness, sRGB."""
    grey = getattr(skimage.data, name)().astype(np.float64) / 255
    return grey[..., None] ** np.array([0.8, 1.0, 1.3])


def score_line(axis: str, score: float | None, value: float | None, floor: float | None = 0.0) -> Table:
    """A line of a table of scores."""
    return {"what": axis.title(), "axis": axis, "value": value, "floor": floor, "ceiling": 1.0, "score": score}


def pictures(html: str) -> list[np.ndarray]:
    """The pictures of a page, in its order."""
    sources = re.findall(r'src="data:image/webp;base64,([^"]+)"', html)
    return [np.asarray(PIL.Image.open(io.BytesIO(base64.b64decode(source))).convert("RGB")) for source in sources]


def load(tab: Any, html: str, folder: Path) -> None:
    """Open a page, which must show all its pictures without requests."""
    path = folder / "page.html"
    path.write_bytes(html.encode())
    requests: list[str] = []
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto(path.as_uri())
    tab.evaluate("for (const one of document.images) one.loading = 'eager'")  # also what is off screen
    tab.evaluate("Promise.all([...document.images].filter(one => one.src).map(one => one.decode())).then(() => 0)")
    assert [url for url in requests if not url.startswith("data:")] == [path.as_uri()]
    assert tab.evaluate("[...document.images].filter(one => one.src).every(one => one.naturalWidth > 0)")
