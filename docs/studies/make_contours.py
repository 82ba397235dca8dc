"""Make the figure of the study of contour detectors: ``python docs/studies/make_contours.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.structure.edges import EdgesParams, edges
from texloom.stages.analysis.structure.otsu import OtsuParams, otsu
from texloom.stages.vocabulary.arrays import Image as Exemplar
from texloom.stages.vocabulary.color import linear_from_srgb, srgb_from_linear

PICTURES = Path(__file__).parents[1] / "pictures"
GAP = 12  # px


def exemplar(name: str) -> Image.Image:
    """A texture that comes with scikit-image."""
    pixels = open_source("exemplar", name).read().color
    return Image.fromarray(np.rint(255 * srgb_from_linear(pixels)).astype(np.uint8)).convert("L")


def beside(pictures: list[Image.Image], scale: float) -> Image.Image:
    """Pictures in a row, top sides aligned, reduced by ``scale``."""
    smaller = [
        picture.resize((round(picture.width * scale), round(picture.height * scale)), Image.Resampling.LANCZOS)
        for picture in pictures
    ]
    width = sum(picture.width + GAP for picture in smaller) - GAP
    row = Image.new("L", (width, max(picture.height for picture in smaller)), 255)
    left = 0
    for picture in smaller:
        row.paste(picture, (left, 0))
        left += picture.width + GAP
    return row


def features(picture: Image.Image, detector: str) -> Image.Image:
    """The features that a detector's contours become."""
    grey = np.asarray(picture, np.float32)[..., None] / 255
    exemplar = Exemplar(np.asarray(linear_from_srgb(grey), np.float32), ("Y",))
    strength = edges(exemplar, EdgesParams.model_validate({"detector": detector})).strength
    return Image.fromarray(otsu(strength, OtsuParams()).structure.astype(np.uint8) * 255)


def contours() -> Image.Image:
    """An exemplar and its features by both detectors: gravel as it is, and at half its resolution."""
    whole = exemplar("skimage:gravel")
    low = whole.resize((256, 256), Image.Resampling.BOX)
    rows = []
    for picture in (whole, low):
        shown = [picture, features(picture, "structured"), features(picture, "gradient")]
        corner = (0, 0, picture.width // 2, picture.height // 2)
        parts = [part.crop(corner).resize((512, 512), Image.Resampling.NEAREST) for part in shown]
        rows.append(beside(parts, 0.375))
    both = Image.new("L", (rows[0].width, 2 * rows[0].height + GAP), 255)
    both.paste(rows[0], (0, 0))
    both.paste(rows[1], (0, rows[0].height + GAP))
    return both


if __name__ == "__main__":
    contours().save(PICTURES / "contours.webp", quality=45, method=6)
