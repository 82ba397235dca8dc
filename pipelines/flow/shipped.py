"""The flows that ship with texloom and those of plug-ins, and what each says of itself."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

_FOLDER = Path(__file__).parents[2] / "configs"


def shipped_flows() -> dict[str, Path]:
    """Name to file."""
    return {path.stem: path for path in sorted(_FOLDER.glob("*.yaml"))}


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


def flow_catalogue() -> dict[str, str]:
    """Name to the first sentence of its comment; of plug-ins with their origin."""
    own = {name: _sentence(path) for name, path in shipped_flows().items()}
    return own | {name: f"{_sentence(path)} [{origin}]" for name, (path, origin) in plugin_flows().items()}


def _sentence(path: Path) -> str:
    return re.split(r"(?<=\.) ", flow_head(path).partition("\n\n")[0], maxsplit=1)[0]


def flow_head(path: Path) -> str:
    """The comment that a flow file begins with; lines of a sentence are joined."""
    lines = itertools.takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    text = "\n".join(line.removeprefix("#").removeprefix(" ") for line in lines).strip()
    return re.sub(r"(?<=\S)\n(?=\S)", " ", text)
