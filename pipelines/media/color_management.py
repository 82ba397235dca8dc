"""Pictures that no matrix with curves describes, to sRGB by littleCMS: CMYK, Lab, and profiles with tables.

Pillow's littleCMS has 8 bits a channel, and colours beyond sRGB are clipped; that of imagecodecs takes 16 and gives
floats. The intent is relative colorimetric with compensation of the black point, as photograph editors have it.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import io
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.stages.vocabulary.color import linear_from_srgb

MODES = {"CMYK": "CMYK", "LAB": "Lab"}
_SPACES = {1: "gray", 3: "rgb", 4: "cmyk"}  # of imagecodecs, by channels
_WHITE = 0.3127, 0.3290, 1.0
_REC709 = (0.64, 0.33, 1.0, 0.30, 0.60, 1.0, 0.15, 0.06, 1.0)
_RELATIVE, _BLACK_POINT = 1, 0x2000
_ROUGH = "is CMYK without a profile, so its colours are rough: each is (1 - ink) (1 - black)"


@dataclasses.dataclass(frozen=True)
class ColorTransform:
    """How codes of over 8 bits become linear Rec.709 light where no matrix with curves says it."""

    profile: bytes | None
    """without one, codes are those of CMYK"""

    def linear(self, codes: np.ndarray) -> Float32[np.ndarray, "h w c"]:
        """Linear light of codes, uint16, (h, w, 1, 3 or 4 of CMYK); 1 or 3 channels.

        Raises
        ------
        ValueError
            The profile is not one of so many channels; in words.
        """
        if self.profile is None:
            paper = 1 - codes.astype(np.float32) / np.float32(65535)
            return np.asarray(linear_from_srgb(paper[..., :3] * paper[..., 3:]), np.float32)
        import imagecodecs

        light = imagecodecs.cms_profile("rgb", whitepoint=_WHITE, primaries=_REC709, gamma=1.0)
        given = np.ascontiguousarray(codes if codes.shape[2] > 1 else codes[..., 0])
        found = imagecodecs.cms_transform(
            *(given, self.profile, light),
            colorspace=_SPACES[codes.shape[2]],
            outcolorspace="rgb",
            outdtype=np.float32,
            intent=_RELATIVE,
            flags=_BLACK_POINT,
        )
        return np.asarray(found, np.float32)[..., : min(codes.shape[2], 3)]


def of_tables(profile: bytes | None) -> tuple[ColorTransform, str]:
    """How codes of over 8 bits are decoded, and what the user is told; `ValueError` where they cannot be."""
    if profile is None:
        return ColorTransform(None), _ROUGH
    if importlib.util.find_spec("imagecodecs") is None:
        raise ValueError(
            "has an ICC profile of tables and over 8 bits, which needs imagecodecs; pip install 'texloom[photos]'"
        )
    return ColorTransform(profile), "its colour is converted by its ICC profile by littleCMS"


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
    known = MODES.get(image.mode, "its colour")
    if profile is None and mode == "CMYK":
        return lambda picture: picture.convert("RGB"), _ROUGH
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
