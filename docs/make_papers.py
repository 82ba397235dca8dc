"""Write docs/papers.md, the papers and where the code follows them: ``python docs/make_papers.py``.

Read from the citations in docstrings and comments of `stages` and in the comments of flow files, the sections and
figures named after them, the steps of flows, and stages/references.bib; and from docs/figures.yaml, what shows the
figures of five papers.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import yaml

from texloom.pipelines.cli import describe
from texloom.pipelines.flow.shipped import flow_catalogue, flow_head, shipped_flows
from texloom.stages.lookup.registry import find_stage

ROOT = Path(__file__).parents[1]
FILE = ROOT / "docs" / "papers.md"
BIBLIOGRAPHY = ROOT / "stages" / "references.bib"
FIGURES = ROOT / "docs" / "figures.yaml"
FIELD = re.compile(r"(\w+)\s*=\s*\{((?:[^{}]|\{[^{}]*\})*)\}")
ACCENTS = {"'": "\u0301", '"': "\u0308", "`": "\u0300", "v": "\u030c", "~": "\u0303", "^": "\u0302", "c": "\u0327"}
CITATION = re.compile(r"\[([A-Za-z]+\d{4}[a-z]?)(?:\]_?|(?=, ))")
NUMBER = r"\(?(?:\d[\d.]*\d|\d|[A-Z]\b)[a-z]?\)?"
PLACE = re.compile(
    r"\b(?:sections?|[Ff]igures?|equations?|[Tt]ables?|appendix|chapter|algorithms?) "
    rf"{NUMBER}(?:(?:,| and|, and| to) {NUMBER})*"
)
MOST = 8
"""flows that are named; of more, how many there are"""

HEAD = """# Papers and where the code follows them

For each paper that docstrings cite by its key: the files that follow it, with the sections, equations and
figures that they name, the stage that a file declares (a file without one helps stages), and the flows with
that stage. What a file does otherwise is in its docstring, which `texloom stages NAME` prints. `python
docs/make_papers.py` writes this page from docstrings, flow files, `stages/references.bib` and `docs/figures.yaml`.

For five papers a second table has every figure and table, the command that shows it with pictures that ship with
texloom or scikit-image, and what differs: [Kaspar2015](#kaspar2015), [Wei2008](#wei2008),
[Eisenacher2008](#eisenacher2008), [Lin2004](#lin2004) and [Ding2014](#ding2014). Tests run these commands at small
size: the quick ones always, all with `TEXLOOM_FIGURES=1`.
"""

Row = tuple[str, str, str, str]


def page() -> str:
    """The page: a paragraph and a table for each paper, by key."""
    rows: dict[str, list[Row]] = {}
    for key, row in cited():
        rows.setdefault(key, []).append(row)
    parts, shown = [HEAD], figures()
    for key, paper in bibliography().items():
        parts += [f"## {key}\n", f"{paper}\n"]
        if key in rows:
            parts += ["| section or figure | file | stage | flows |", "|---|---|---|---|"]
            parts += [f"| {' | '.join(row)} |" for row in rows[key]] + [""]
        if key in shown:
            parts += ["| figure or table | shows | command | what differs |", "|---|---|---|---|"]
            parts += [f"| {' | '.join(figure_row(one))} |" for one in shown[key]] + [""]
    return "\n".join(parts)


def figures() -> dict[str, list[dict[str, str]]]:
    """What shows each figure and table, by paper; see docs/figures.yaml."""
    found: dict[str, list[dict[str, str]]] = yaml.safe_load(FIGURES.read_text(encoding="utf-8"))
    return found


def figure_row(one: dict[str, str]) -> Row:
    """The cells of a figure."""
    return one["figure"], one["shows"], f"`texloom run {one['run']}`" if "run" in one else "", one["differs"]


def smaller(one: dict[str, str]) -> list[str]:
    """What ``texloom run`` is given for a figure at small size: options replace those of the same name."""
    words, small = shlex.split(one["run"]), shlex.split(one["small"])
    named = [tuple(small[at : at + 2]) for at in range(0, len(small), 2)]
    keys = {(option, value.partition("=")[0] if option == "--set" else "") for option, value in named}
    kept = [words[0]]
    at = 1
    while at < len(words):
        width = 2 if words[at].startswith("--") else 1
        option, value = (words[at], words[at + 1]) if width == 2 else (words[at], "")
        if (option, value.partition("=")[0] if option == "--set" else "") not in keys:
            kept += words[at : at + width]
        at += width
    return kept + small


def cited() -> Iterator[tuple[str, Row]]:
    """Key and row of each paper in each file of `stages`, then of what flows name of papers themselves."""
    stage_of, flows_with = stage_files(), flows_by_stage()
    for path in sorted((ROOT / "stages").rglob("*.py")):
        if path.name == "__init__.py":  # says in general what the files of the room say exactly
            continue
        file = path.relative_to(ROOT).as_posix()
        stage = stage_of.get(file, "")
        flows = flows_with.get(stage, [])
        named = f"{len(flows)} flows" if len(flows) > MOST else ", ".join(f"`{name}`" for name in flows)
        for key, places in citations(path.read_text(encoding="utf-8")).items():
            yield key, ("; ".join(places), f"`{file}`", f"`{stage}`" if stage else "", named)
    for name, path in shipped_flows().items():
        for key, places in citations(flow_head(path)).items():
            if places:
                yield key, ("; ".join(places), f"`{path.resolve().relative_to(ROOT).as_posix()}`", "", f"`{name}`")


def citations(text: str) -> dict[str, list[str]]:
    """The papers that a text cites, and the places in them that it names before the next citation or paragraph."""
    found: dict[str, list[str]] = {}
    for paragraph in re.split(r'\n[ \t#]*\n|"""', text):
        line = re.sub(r"\s*\n\s*(#\s*)?", " ", paragraph)
        parts = CITATION.split(line)
        for key, after in zip(parts[1::2], parts[2::2], strict=True):
            places = found.setdefault(key, [])
            places += [place for place in PLACE.findall(after) if place not in places]
    return found


def stage_files() -> dict[str, str]:
    """The stage that a file declares, plug-ins excepted."""
    modules = {name: find_stage(name).function.__module__ for name in describe.catalogue()}
    return {
        f"{module.removeprefix('texloom.').replace('.', '/')}.py": name
        for name, module in modules.items()
        if module.startswith("texloom.stages.")
    }


def flows_by_stage() -> dict[str, list[str]]:
    """The flows that have a step of each stage, those of optional sources too."""
    found: dict[str, list[str]] = {}
    for name in flow_catalogue():
        flow = describe.flow_description(name)
        for stage in sorted({step["stage"] for step in (*flow["steps"].values(), *flow["steps_with"].values())}):
            found.setdefault(stage, []).append(name)
    return found


def bibliography() -> dict[str, str]:
    """Each paper's authors, title, place and year by its key."""
    entries = re.findall(r"@\w+\{(\w+),\n(.*?)\n\}", BIBLIOGRAPHY.read_text(encoding="utf-8"), flags=re.DOTALL)
    papers = {}
    for key, body in sorted(entries):
        field = {name: plain(value) for name, value in FIELD.findall(accented(body))}
        places = (field.get(name) for name in ("journal", "booktitle", "school", "publisher"))
        known = ["; ".join(field["author"].split(" and ")), f"*{field['title']}*", *filter(None, places)]
        papers[key] = ". ".join(part.removesuffix(".") for part in known[:3]) + f", {field['year']}."
    return papers


def accented(latex: str) -> str:
    """LaTeX's accents as letters."""
    return re.sub(r"\{\\(['\"`v~^c])\{?(\w)\}?\}", lambda at: at[2] + ACCENTS[at[1]], latex)


def plain(value: str) -> str:
    """A BibTeX value in one line, without braces."""
    return " ".join(re.sub(r"[{}\\]", "", value).replace("--", "-").split())


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
