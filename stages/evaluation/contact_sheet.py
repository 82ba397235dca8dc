"""All results of a run in one picture."""

import dataclasses
import logging
import math
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage

_GAP = 8  # px around pictures
_LABEL = 18  # px of a line of text
_INK = 0.6
_BACKGROUND = 0.02
_MOST_PIXELS = 2**27  # of a sheet, 1.6 GB; more than 1000 small pictures
_LOG = logging.getLogger(__name__)


class ContactSheetParams(Params):
    """How the pictures are laid out."""

    columns: int | None = Field(None, ge=1, le=1000)
    """pictures side by side; null makes the sheet about as wide as it is high"""


@dataclasses.dataclass(frozen=True)
class ContactSheet:
    """The sheet."""

    image: Image
    """R G B, linear light; each picture over its item's name"""


@stage(version=1)
def contact_sheet(
    images: list[Image | None], items: list[dict[str, Any]], params: ContactSheetParams
) -> ContactSheet:
    """Lay out pictures in rows, in the order of the items, each above its item's name.

    Those that are too many for a sheet of 2**27 px are left out, as a warning says.

    Parameters
    ----------
    images : one an item, as `thumbnail` makes them; None where the item failed, whose place stays empty.

    Raises
    ------
    InputError
        not as many pictures as items.
    """
    if len(images) != len(items):
        raise InputError(f"images: {len(images)} pictures for {len(items)} items")
    colors = [None if image is None else image.color for image in images]
    height = max((color.shape[0] for color in colors if color is not None), default=1) + _LABEL
    width = max((color.shape[1] for color in colors if color is not None), default=1)
    most = max(1, _MOST_PIXELS // ((height + _GAP) * (width + _GAP)))
    if len(items) > most:
        _LOG.warning("the first %d of %d pictures are on the sheet, as all would be too large", most, len(items))
        colors, items = colors[:most], items[:most]
    columns = min(max(1, len(items)), params.columns or math.ceil(math.sqrt(len(items) * height / width)))
    rows = math.ceil(len(items) / columns)
    sheet = np.full((rows * (height + _GAP) + _GAP, columns * (width + _GAP) + _GAP, 3), _BACKGROUND, np.float32)
    for index, (color, item) in enumerate(zip(colors, items, strict=True)):
        top = _GAP + index // columns * (height + _GAP)
        left = _GAP + index % columns * (width + _GAP)
        if color is not None:
            sheet[top : top + color.shape[0], left : left + color.shape[1]] = color
        _write(sheet[top + height - _LABEL : top + height, left : left + width], str(item["name"]))
    return ContactSheet(Image(sheet, ("R", "G", "B")))


def _write(place: np.ndarray, text: str) -> None:
    """Put text into a line of the sheet, as far as it fits."""
    import cv2

    line = np.zeros(place.shape[:2], np.uint8)
    cv2.putText(line, text, (0, _LABEL - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.42, 255, 1, cv2.LINE_AA)
    place += (line / np.float32(255))[..., None] * np.float32(_INK)
