"""Pictures that no matrix with curves describes, to sRGB by littleCMS: CMYK, Lab, and profiles with tables.

Pillow's littleCMS has 8 bits a channel; colours beyond sRGB are clipped. The intent is relative colorimetric with
compensation of the black point, as photograph editors have it.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

_MODES = {"CMYK": "CMYK", "LAB": "Lab"}


def conversion_of(image: Any, profile: bytes | None) -> tuple[Callable[[Any], Any], str]:
    """What converts a Pillow image to sRGB, with its alpha, and what the user is told.

    Parameters
    ----------
    image : of mode CMYK, LAB, L, LA, RGB or RGBA.
    profile : an ICC profile; of CMYK and Lab there need be none.

    Raises
    ------
    ValueError
        The profile is broken, or of another kind of colour; in words.
    """
    from PIL import ImageCms

    mode = image.mode.removesuffix("A") if image.mode in ("LA", "RGBA") else image.mode
    known = _MODES.get(image.mode, "its colour")
    if profile is None and mode == "CMYK":
        return lambda picture: picture.convert("RGB"), (
            "is CMYK without a profile, so its colours are rough: each is (1 - ink) (1 - black)"
        )
    flags = ImageCms.Flags.BLACKPOINTCOMPENSATION | ImageCms.Flags.HIGHRESPRECALC
    try:
        space = ImageCms.createProfile("LAB") if profile is None else ImageCms.ImageCmsProfile(io.BytesIO(profile))
        target = ImageCms.createProfile("sRGB")
        intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
        transform = ImageCms.buildTransform(space, target, mode, "RGB", intent, flags)
    except (ImageCms.PyCMSError, OSError):
        raise ValueError("has an ICC profile that littleCMS cannot use; convert it to sRGB") from None

    def converted(picture: Any) -> Any:
        plain = picture if picture.mode == mode else picture.convert(mode)
        result = ImageCms.applyTransform(plain, transform)
        if mode == "L":
            result = result.getchannel(0)
        if picture.mode != mode:
            result.putalpha(picture.getchannel("A"))
        return result

    how = "without a profile, taken as CIE Lab (D50)" if profile is None else "by its ICC profile"
    return converted, f"{known} is converted {how} to sRGB of 8 bits by littleCMS; colours beyond sRGB are clipped"
