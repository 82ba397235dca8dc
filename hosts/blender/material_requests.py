"""What Blender asks of texloom for whole materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .controller import Request
from .requests import run_options
from .texloom_client import TexloomError

MAPS = "maps/*"
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".webp", ".bmp", ".heic", ".dng")


def material(path: str, size: int, tileable: str, texel_size: float, preset: str, seed: int) -> list[Request]:
    """All maps of a material, from a folder of maps, or estimated from a photograph; ``texel_size`` in mm."""
    place = Path(path).expanduser()
    sizes = {"size": str(size), "tileable": tileable, "texel_size": _mm(texel_size)}
    options = run_options(seed, preset, layout="blender", **sizes)
    if path and place.is_dir():
        return [Request("materials", {"exemplar": str(place)}, {}, options, (MAPS,))]
    if not place.is_file():
        raise TexloomError(f"path: {path or 'nothing'}: no such folder or picture")
    if place.suffix.lower() in (".yaml", ".yml"):
        return [Request("materials", {"exemplar": str(place)}, {}, options, (MAPS,))]
    if place.suffix.lower() not in PICTURES:
        raise TexloomError(f"path: {place.name} is neither a folder of maps nor one of {', '.join(PICTURES)}")
    return [Request("photo_material", {"photo": str(place)}, {}, options, (MAPS,))]


def on_mesh(
    exemplar: Any, mesh: str, size: int, texel_size: float, turn: float, seed: int, *, control: Any = None,
    has_control: bool = False, has_maps: bool = False,
) -> list[Request]:  # fmt: skip
    """A texture on a mesh that has texture coordinates; a ``texel_size`` of 0 mm is chosen by texloom."""
    if has_control and control is None:
        raise TexloomError("control: vertex paint controls it; choose the control picture of the exemplar, too")
    sources = {"exemplar": exemplar, "mesh": mesh, **({} if control is None else {"control": control})}
    params: dict[str, Any] = {"size": size, "charts": "own", "turn": turn}
    if has_control:
        params["geometry"] = "vertices"
    elif control is not None:
        raise TexloomError("control: a picture is given without vertex paint; choose the colours that control it")
    options: dict[str, Any] = {"seed": seed}
    if has_maps:
        options["layout"] = "blender"
    if texel_size:
        options["texel_size"] = _mm(texel_size)
    return [Request("on_mesh", sources, params, options, (MAPS,) if has_maps else ())]


def _mm(texel_size: float) -> str:
    if not texel_size > 0:
        raise TexloomError(f"texel_size: {texel_size:g} mm is not above 0")
    return f"{texel_size:.9g}mm"
