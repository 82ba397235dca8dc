"""The file that the name of a flow means."""

from __future__ import annotations

from pathlib import Path

from texloom.pipelines.errors import closest, refused
from texloom.pipelines.flow.gone import FLOWS
from texloom.pipelines.flow.shipped import plugin_flows, shipped_flows
from texloom.pipelines.media.material_set import is_picture


def find_flow(name: str, folder: Path = Path()) -> Path:
    """The file called ``name`` in a folder, or the flow of that bare name that ships with texloom or a plug-in.

    Raises
    ------
    InputError : there is none, or it is a picture or a folder.
    """
    path = folder / name
    try:
        if path.is_file() and not is_picture(path):
            return path
    except OSError as error:
        raise refused(f"{name}: cannot be read: {error.strerror}") from None
    shipped = shipped_flows()
    if name in shipped:
        return shipped[name]
    others = plugin_flows() if "/" not in name else {}
    if name in others:
        return others[name][0]
    if name in FLOWS:
        raise refused(f"{name}: is another flow now, as in: texloom run {FLOWS[name]}")
    if is_picture(path):
        raise refused(f"{name}: is a picture, not a flow, as in: texloom run self_tuning {name}")
    if path.is_dir():
        raise refused(f"{name}: is a folder, not a flow file")
    stem = name.removesuffix(".yaml").removesuffix(".yml")
    file = file_called(stem, folder) or (stem if stem in shipped or stem in others else None)
    near = f"; did you mean '{file}'?" if file else closest(name, [*shipped, *others])
    raise refused(f"{name}: no such flow{near or '; `texloom flows` lists those that ship'}")


def file_called(name: str, folder: Path = Path()) -> str | None:
    """The name of a flow file in a folder that would be meant by a name without its ending, if there is one."""
    names = (name + suffix for suffix in (".yaml", ".yml"))
    return next((file for file in names if (folder / file).is_file()), None)
