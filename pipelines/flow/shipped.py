"""The flows that ship with texloom, and what each says of itself; imports nothing."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

_FOLDER = Path(__file__).parents[2] / "configs"


def shipped_flows() -> dict[str, Path]:
    """Name to file."""
    return {path.stem: path for path in sorted(_FOLDER.glob("*.yaml"))}


def flow_catalogue() -> dict[str, str]:
    """Name to the first sentence of its comment."""
    heads = {name: flow_head(path).partition("\n\n")[0] for name, path in shipped_flows().items()}
    return {name: re.split(r"(?<=\.) ", head, maxsplit=1)[0] for name, head in heads.items()}


def flow_head(path: Path) -> str:
    """The comment that a flow file begins with; lines of a sentence are joined."""
    lines = itertools.takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    text = "\n".join(line.removeprefix("#").removeprefix(" ") for line in lines).strip()
    return re.sub(r"(?<=\S)\n(?=\S)", " ", text)
