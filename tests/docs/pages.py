"""The pages of the documentation: their code blocks, commands, links and headings."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from tests.conftest import ROOT

DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    ROOT / "CHANGELOG.md",
    ROOT / "artifacts" / "README.md",
    *sorted(path for path in DOCS.rglob("*.md") if "reference" not in path.relative_to(DOCS).parts),
]
"""all but the reference, which is written from docstrings and help"""

_FENCE = re.compile(r"^( *)```(\S*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def label(path: Path) -> str:
    """The name of a page in the output of tests."""
    return path.relative_to(ROOT).as_posix()


def script(path: Path) -> ModuleType:
    """A script beside the documentation, as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block: its language and text."""

    language: str
    text: str


def blocks(path: Path) -> list[Block]:
    """The fenced blocks of a page; those in lists are taken without their indentation."""
    text = path.read_text(encoding="utf-8")
    return [Block(match[2], textwrap.dedent(match[3])) for match in _FENCE.finditer(text)]


def shell_lines(path: Path) -> list[str]:
    """The commands of a page: the lines of its blocks marked ``bash``, with continued lines joined."""
    return [
        line
        for block in blocks(path)
        if block.language == "bash"
        for line in re.sub(r"\\\n\s*", "", block.text).splitlines()
    ]


def commands(path: Path) -> list[str]:
    """The commands of texloom among `shell_lines`, each by itself."""
    parts = [part for line in shell_lines(path) for part in line.split(" && ")]
    return [part.replace(".venv/bin/", "") for part in parts if re.match(r"(\.venv/bin/)?texloom ", part)]


def links(path: Path) -> Iterator[str]:
    """The targets of links and pictures, outside of code."""
    text = re.sub(r"`[^`\n]+`", "", _FENCE.sub("", path.read_text(encoding="utf-8")))
    yield from re.findall(r"\]\(([^)\s]+)\)", text)


def anchors(path: Path) -> set[str]:
    """The anchors that a code host gives the headings of a page."""
    text = _FENCE.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
