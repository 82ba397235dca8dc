"""Whether a picture is a photograph as its camera has written it."""

from __future__ import annotations

from pathlib import Path

_SUFFIXES = (".jpg", ".jpeg")
_MAKE, _MODEL = 0x010F, 0x0110  # EXIF tags of the camera


def is_of_a_camera(path: Path) -> bool:
    """Whether a JPEG names the camera that has taken it; False of all other files, and of broken ones."""
    if path.suffix.lower() not in _SUFFIXES:
        return False
    from PIL.JpegImagePlugin import JpegImageFile

    try:
        with JpegImageFile(path) as image:
            exif = image.getexif()
            return bool(exif.get(_MAKE) or exif.get(_MODEL))
    except Exception:  # whatever a broken file makes of the decoder
        return False
