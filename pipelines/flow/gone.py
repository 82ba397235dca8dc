"""What flow files and commands may still name although it is gone, and how it is written now."""

from __future__ import annotations

FLOWS: dict[str, str] = {}
"""flow to the command that replaces it, after ``texloom run``"""

_WRAPS = "pictures say themselves whether they wrap; leave it out"
INPUTS = {"tileable": _WRAPS, "toroidal": _WRAPS}
"""input of a stage to what to do"""
OUTPUTS = {"tileable": _WRAPS}
"""output of a stage to what to do"""
