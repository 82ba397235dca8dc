"""Write the reference from what the program declares: ``python docs/make_reference.py``, or by building the site.

A page for each stage (docstrings of functions, params and results), for each flow (the YAML file with its comment),
the command line (its help), and copies of the repository's own pages.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from texloom.pipelines.cli import describe
from texloom.pipelines.cli.main import texloom
from texloom.pipelines.flow.shipped import GROUPS as FLOW_GROUPS
from texloom.pipelines.flow.shipped import CatalogueEntry, flow_catalogue
from texloom.pipelines.media.conventions import LAYOUTS

ROOT = Path(__file__).parents[1]
COPIES = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "artifacts/README.md": "store.md",
}
"""pages outside of docs, and their names in the reference"""
GROUPS = {
    "analysis": "Analysis: what is read from an exemplar",
    "synthesis": "Synthesis: what makes pictures",
    "evaluation": "Evaluation: how good a result is",
}


def write_reference(folder: Path) -> None:
    """Write all pages below ``folder``; pages of what is no longer there are removed."""
    pages = dict(reference_pages())
    for path in folder.rglob("*.md"):
        if path.relative_to(folder).as_posix() not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def reference_pages() -> Iterator[tuple[str, str]]:
    """Name and text of each page."""
    stages, flows = describe.catalogue(), flow_catalogue()
    yield "stages.md", stage_index(stages)
    yield "flows.md", flow_index(flows)
    yield "command_line.md", command_line()
    yield "conventions.md", conventions()
    for source, name in COPIES.items():
        yield name, (ROOT / source).read_text(encoding="utf-8").replace("](docs/", "](../")
    for name in stages:
        yield f"stages/{name.rpartition('.')[2]}.md", stage_page(describe.description(name))
    for name in flows:
        yield f"flows/{name}.md", flow_page(describe.flow_description(name))


# -- stages


def stage_index(stages: dict[str, str]) -> str:
    """The table of all stages."""
    parts = ["# Stages\n\nWritten from the docstrings; `texloom stages NAME` prints the same.\n"]
    for group, title in GROUPS.items():
        names = [name for name in stages if name.startswith(f"{group}.")]
        rows = [
            f"| [{name.rpartition('.')[2]}](stages/{name.rpartition('.')[2]}.md) | {stages[name]} |"
            for name in names
        ]
        parts.append("\n".join(["", f"## {title}", "", "| stage | result |", "|---|---|", *rows, ""]))
        toctree = [f"stages/{name.rpartition('.')[2]}" for name in names]
        parts.append("\n".join(["", "```{toctree}", ":hidden:", "", *toctree, "```", ""]))
    return "".join(parts)


def stage_page(stage: dict[str, Any]) -> str:
    """The page of one stage."""
    parts = [
        f"# {stage['name'].rpartition('.')[2]}",
        f"`{stage['name']}`, version {stage['version']}",
        prose(stage["summary"]),
    ]
    if stage["description"]:
        parts.append(prose(stage["description"]))
    for title, kind in (("Inputs", "inputs"), ("Parameters", "params"), ("Outputs", "outputs")):
        if stage[kind]:
            parts += [f"## {title}", "\n".join(entry(name, what) for name, what in stage[kind].items())]
    parts.append(f"Draws random numbers: {'yes, from the seed' if stage['uses_seed'] else 'no'}.")
    if stage["references"]:
        parts += ["## Sources", prose(stage["references"], "../")]
    return "\n\n".join(parts) + "\n"


def entry(name: str, what: dict[str, Any]) -> str:
    """A line on an input, parameter or output."""
    words = [f"`{what['type']}`"]
    if "default" in what:
        default = what["default"]
        words.append("required" if default == "required" else f"default `{json.dumps(default).strip(chr(34))}`")
    if what.get("range"):
        words.append(f"`{what['range']}`")
    if what.get("optional"):
        words.append("optional")
    text = " ".join(prose(what["what"]).split())
    return f"- **{name}** ({', '.join(words)}){': ' + text if text else ''}"


def prose(text: str, up: str = "../") -> str:
    """A docstring's text in Markdown: titles of sections, names, keys of papers, examples."""
    text = re.sub(r"^(\w[\w ]*)\n-{3,}$", r"**\1**\n", text, flags=re.MULTILINE)
    text = re.sub(r"``([^`]+)``", r"`\1`", text)
    text = re.sub(r"^(\w+Error)\n((?:    .*\n?)+)", term, text, flags=re.MULTILINE)
    text = re.sub(
        r"((?:^(?:>>>|\.\.\.) .*\n(?:[^\n>].*(?:\n|$))*)+)", r"```python\n\1\n```\n", text, flags=re.MULTILINE
    )
    return re.sub(
        r"\[([A-Za-z]+\d{4}[a-z]?)\]_?", lambda key: f"[{key[1]}]({up}../papers.md#{key[1].lower()})", text
    )


def term(match: re.Match[str]) -> str:
    """A list's line on an exception and when it is raised."""
    return f"- `{match[1]}`: {' '.join(match[2].split())}\n"


# -- flows


def flow_index(flows: dict[str, CatalogueEntry]) -> str:
    """The tables of all flows by group, as `texloom flows` shows them."""
    text = "Pictures and times are in the [gallery](../gallery.md); [flows](../flows.md) explains how to write one."
    parts = ["# Flows", "", text, ""]
    for group, title in (*FLOW_GROUPS.items(), (None, "Of plug-ins")):
        rows = [
            f"| [{name}](flows/{name}.md) | {prose(entry.about, '')} |"
            for name, entry in flows.items()
            if entry.group == group
        ]
        if rows:
            parts += [f"## {title}", "", "| flow | what it does |", "|---|---|", *rows, ""]
    toctree = ["```{toctree}", ":hidden:", "", *(f"flows/{name}" for name in flows), "```"]
    return "\n".join([*parts, *toctree, ""])


def flow_page(flow: dict[str, Any]) -> str:
    """The page of one flow."""
    blocks: list[str] = []
    for block in flow["description"].split("\n\n"):
        command = block.startswith("  ")
        blocks.append(f"```\n{textwrap.dedent(block)}\n```" if command else prose(block))
    parts = [f"# {flow['name']}", *blocks]
    if flow["params"]:
        lines = [entry(name, what) + f" (`{', '.join(what['targets'])}`)" for name, what in flow["params"].items()]
        parts += ["## Parameters", "\n".join(lines)]
    sources = [f"- **{name}**: `{default}`" for name, default in flow["sources"].items()]
    steps = []
    for name, step in flow["steps"].items():
        page = f"../stages/{step['stage'].rpartition('.')[2]}.md"
        steps.append(f"| `{name}` | [{step['stage']}]({page}) | {prose(step['summary'])} |")
    exports = [f"- `{name}`: `{reference}`" for name, reference in flow["exports"].items()]
    parts += ["## Sources", "\n".join(sources), "## Steps"]
    parts += ["\n".join(["| step | stage | what it does |", "|---|---|---|", *steps])]
    return "\n\n".join([*parts, "## Exports", "\n".join(exports)]) + "\n"


# -- conventions of materials


def conventions() -> str:
    """The table by which materials are read and written."""
    parts = [
        "# Conventions of materials",
        "The names by which folders of maps are read and, with `--layout`, written. Case and separators do not "
        "count on reading. Of packed files the maps in R, G, B and A are listed; `1-roughness` is gloss.",
    ]
    for name, layout in LAYOUTS.items():
        green = (
            f"Green of normals points {layout.green}."
            if layout.green
            else "Green may point up or down; written up."
        )
        head = f"## {layout.title}\n\n`{name}`, files `{layout.prefix}NAME_SUFFIX.{layout.kind}`. {green}"
        rows = ["| suffix | read as well | maps | bits |", "|---|---|---|---|"]
        for part in layout.parts:
            planes = ", ".join(plane or "white" for plane in part.planes)
            bits = (
                str(part.bits) if part.written else "only read, if others exclude it" if part.rare else "only read"
            )
            rows.append(f"| `{part.suffix}` | {', '.join(f'`{one}`' for one in part.also)} | {planes} | {bits} |")
        parts += [head, "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


# -- command line


def command_line() -> str:
    """The help of every command."""
    parts = ["# Command line", "The same as `texloom --help` and `texloom COMMAND --help`."]
    for command, context in commands(texloom, click.Context(texloom, info_name="texloom")):
        parts += [f"## {context.command_path}", f"```text\n{command.get_help(context)}\n```"]
    parts += ["Exit codes: 0 done, 1 a stage failed, 2 the request is wrong, 130 interrupted, 143 terminated."]
    return "\n\n".join(parts) + "\n"


def commands(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    """A command and those below it."""
    yield command, context
    if isinstance(command, click.Group):
        for name, below in sorted(command.commands.items()):
            if not below.hidden:
                yield from commands(below, click.Context(below, info_name=name, parent=context))


if __name__ == "__main__":
    write_reference(Path(__file__).parent / "reference")
