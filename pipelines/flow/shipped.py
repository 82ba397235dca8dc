"""The flows that ship with texloom and those of plug-ins, and what each says of itself."""

from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path

STUDIES = "studies"
GROUPS = {
    "larger": "Larger textures",
    "tileable": "Tileable textures",
    "materials": "Materials",
    "photographs": "Photographs",
    "control": "Textures under control",
    "meshes": "Meshes",
    "edits": "Edits",
    "comparison": "Comparison",
    STUDIES: "Studies",
}
"""where a flow stands in the catalogue, and the title there"""
_FOLDER = Path(__file__).parents[2] / "configs"


def shipped_flows() -> dict[str, Path]:
    """Name to file."""
    return {path.stem: path for path in sorted(_FOLDER.glob("*.yaml"))}


def flow_word(path: Path) -> str:
    """What names a flow in commands and errors: the name of one that ships, else the path."""
    # Links are followed only where that may matter: this is asked for every param.
    is_shipped = path.parent == _FOLDER or path.parent.resolve() == _FOLDER.resolve()
    return path.stem if is_shipped else str(path)


def plugin_flows() -> dict[str, tuple[Path, str]]:
    """Name to file and origin (distribution and version) of the flows of plug-ins; those that ship come first."""
    import importlib.util

    from texloom.stages.lookup.plugins import plugins
    from texloom.stages.vocabulary.interruption import raised_by_code

    found: dict[str, tuple[Path, str]] = {}
    for plugin in plugins("texloom.flows").values():
        try:
            spec = importlib.util.find_spec(plugin.module)
        except (Exception, SystemExit, KeyboardInterrupt) as error:  # whatever the package raises at its import
            if not isinstance(error, Exception) and not raised_by_code(error):
                raise
            spec = None
        for folder in (spec.submodule_search_locations or []) if spec is not None else []:
            for path in sorted(Path(folder).glob("*.yaml")):
                found.setdefault(path.stem, (path, plugin.origin))
    return {name: found[name] for name in found if name not in shipped_flows()}


@dataclasses.dataclass(frozen=True)
class CatalogueEntry:
    """A flow in the catalogue."""

    about: str
    """the first sentence of its comment; of a plug-in with its origin"""
    group: str | None
    """one of `GROUPS`; None for flows of plug-ins that name none"""
    listed: bool
    """whether lists of flows show it first, and not only by its name"""


def flow_catalogue() -> dict[str, CatalogueEntry]:
    """Name to entry, by group; flows that are listed come first, `STUDIES` and flows without a group last."""
    found = {name: _entry(path, "") for name, path in shipped_flows().items()}
    found |= {name: _entry(path, f" [{origin}]") for name, (path, origin) in plugin_flows().items()}
    order = [*GROUPS, None]
    return dict(sorted(found.items(), key=lambda item: (order.index(item[1].group), not item[1].listed)))


def _entry(path: Path, origin: str) -> CatalogueEntry:
    fields = dict(re.findall(r"^(group|listed): *(\w+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE))
    group = fields.get("group") if fields.get("group") in GROUPS else None
    about = re.split(r"(?<=\.) ", flow_head(path).partition("\n\n")[0], maxsplit=1)[0]
    return CatalogueEntry(about + origin, group, fields.get("listed") != "false" and group != STUDIES)


def flow_head(path: Path) -> str:
    """The comment that a flow file begins with; lines of a sentence are joined."""
    lines = itertools.takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    text = "\n".join(line.removeprefix("#").removeprefix(" ") for line in lines).strip()
    return re.sub(r"(?<=\S)\n(?=\S)", " ", text)
