"""What the plug-ins ask of texloom for one picture."""

from __future__ import annotations

from typing import Any

from .controller import Request
from .texloom_client import TexloomError

METHODS = ("self_tuning", "auto", "near_regular", "quilting", "graph_cut", "patch_based")
PRESETS = ("default", "fast")
_WITH_PRESETS = ("self_tuning", "auto")  # among the methods; others have one speed
_MOST_VARIATIONS = 64


def run_options(seed: int, preset: str, **others: Any) -> dict[str, Any]:
    """How a run is made; the default preset is not named."""
    chosen = {"seed": seed, **others}
    return chosen if preset == "default" else {**chosen, "preset": preset}


def make_tileable(picture: Any, axes: str, keep_size: bool, preset: str, seed: int) -> list[Request]:
    """A picture that repeats; only its borders change."""
    params = {"keep_size": keep_size}
    return [Request("make_tileable", {"picture": picture}, params, run_options(seed, preset, tileable=axes))]


def larger(
    picture: Any, width: int, height: int, tileable: str, method: str, preset: str, seed: int, count: int = 1
) -> list[Request]:
    """A larger texture, or so many, each with the next seed; ``preset`` is of self-tuning and auto alone."""
    if not 1 <= count <= _MOST_VARIATIONS:
        raise TexloomError(f"count: {count} variations; 1 to {_MOST_VARIATIONS} can be made at once")
    sizes = {"size": f"{width}x{height}", "tileable": tileable}
    preset = preset if method in _WITH_PRESETS else "default"
    return [
        Request(method, {"exemplar": picture}, {}, run_options(seed + number, preset, **sizes))
        for number in range(count)
    ]


def fill(picture: Any, holes: Any, preset: str, seed: int) -> list[Request]:
    """Holes of a picture, filled from the rest of it."""
    return [Request("fill", {"picture": picture, "holes": holes}, {}, run_options(seed, preset))]


def revise(texture: Any, exemplar: Any, region: Any, tileable: str, preset: str, seed: int) -> list[Request]:
    """A region of a texture, made again like the exemplar."""
    sources = {"texture": texture, "exemplar": exemplar, "region": region}
    return [Request("revise", sources, {}, run_options(seed, preset, tileable=tileable))]
