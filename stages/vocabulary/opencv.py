"""The part of OpenCV that only some of its distributions have."""

from __future__ import annotations

import importlib.metadata
from typing import Any

from texloom.stages.vocabulary.declare import InputError

WANTED = "opencv-contrib-python-headless"


def distributions() -> dict[str, str]:
    """The distributions of OpenCV that are installed, with their versions; all are imported by one name."""
    names = ((str(one.name).lower().replace("_", "-"), one.version) for one in importlib.metadata.distributions())
    return dict(sorted((name, version) for name, version in names if name.startswith("opencv-")))


def extra_part() -> Any:
    """`cv2.ximgproc`.

    Raises
    ------
    InputError : the OpenCV that is imported lacks it, as another one lies over that of texloom.
    """
    import cv2

    if not hasattr(cv2, "ximgproc"):
        raise InputError(problem())
    return cv2.ximgproc


def problem() -> str:
    """Why the OpenCV that is imported will not do, with the remedy; empty if it will."""
    import cv2

    if hasattr(cv2, "ximgproc"):
        return ""
    others = [name for name in distributions() if name != WANTED]
    over = f", of {' or '.join(others)}, which lies over {WANTED}" if others else ""
    remove = f"pip uninstall -y {' '.join([*others, WANTED])} && " if others else ""
    return f"OpenCV {cv2.__version__}{over}, has no ximgproc; {remove}pip install {WANTED}"
