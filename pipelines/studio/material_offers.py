"""How the page offers the flows that estimate the maps of a picture or of a photograph."""

from __future__ import annotations

from texloom.pipelines.studio.messages.catalogue import Picker
from texloom.pipelines.studio.offer import Offer, number, setting

_SHADOWS = Picker(
    label="Shadows",
    settings=(
        setting("removed where sure"),
        setting("kept", **{"light.strength": 0.0}),
        setting("removed", **{"light.strength": 1.0}),
    ),
    card="light",
)
_DARK = Picker(
    label="Dark is",
    settings=(
        setting("deep, if in doubt"),
        setting("deep", **{"height.dark": "deep"}),
        setting("high", **{"height.dark": "high"}),
    ),
    card="maps",
)
_MAPS = (
    number("relief", "Relief", 0.002, 0.05, 0.015, ("flat", "deep"), "maps"),
    number("height.joints", "Joints", -0.5, 1, 0.3, ("raised", "deep"), "maps"),
    number("roughness.level", "Roughness", 0, 1, 0.7, ("glossy", "matt"), "maps"),
)
_PLANES = ("seen from the front", "first found", "second found", "third found")
_SURFACE = Picker(
    label="Surface",
    settings=(setting("the clearest"), *(setting(name, plane=index) for index, name in enumerate(_PLANES))),
    card="region",
)
_FOREIGN = Picker(
    label="Foreign parts", settings=(setting("left out"), setting("kept", unlike=1000.0)), card="region"
)

MATERIAL_SYNTHESIS = Offer(
    "Height, normals, occlusion and roughness are estimated from the colour",
    choices=(_SHADOWS, _DARK),
    controls=_MAPS,
)
PHOTO_MATERIAL = Offer(
    "The surface is found and straightened, its light evened, what is foreign left out, and the maps are estimated",
    choices=(_SURFACE, _FOREIGN, _SHADOWS, _DARK),
    controls=_MAPS,
    surface="light",
)
