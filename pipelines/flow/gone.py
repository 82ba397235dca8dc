"""What flow files and commands may still name although it is gone, and how it is written now."""

from __future__ import annotations

FLOWS = {
    "inverse_stationary": "inverse PICTURE",
    "masked": "self_tuning PICTURE --source mask=MASK",
    "self_tuning_guided": "self_tuning PICTURE --source exemplar_guide=LABELS --source target_guide=PAINTED",
    "self_tuning_oriented": "self_tuning PICTURE --source strokes=STROKES",
    "self_tuning_set": "self_tuning 'FOLDER/*.png'",
    "self_tuning_structured": "self_tuning PICTURE --source exemplar_structure=FEATURES",
    "self_tuning_tone": "self_tuning PICTURE --source control=TONE",
    "tile_variants": "vary PICTURE",
}
"""flow to the command that replaces it, after ``texloom run``"""

_WRAPS = "pictures say themselves whether they wrap; leave it out"
INPUTS = {"tileable": _WRAPS, "toroidal": _WRAPS}
"""input of a stage to what to do"""
OUTPUTS = {"tileable": _WRAPS}
"""output of a stage to what to do"""
