"""Texloom in ComfyUI. Beside this file belongs ``texloom_client.py``, which ``texloom client`` writes."""

from pathlib import Path

try:
    from .texloom_client import Client  # noqa: F401
except ImportError as error:  # there is none, or an empty one, as the shell leaves where it finds no texloom
    _HERE = Path(__file__).resolve().parent
    raise ImportError(f"run `texloom client > texloom_client.py` in {_HERE}, which needs that file") from error

from .nodes import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
