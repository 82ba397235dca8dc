"""Texloom in ComfyUI. Beside this file belongs ``texloom_client.py``, which ``texloom client`` writes."""

from .nodes import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
