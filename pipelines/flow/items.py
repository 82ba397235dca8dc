"""Items of a flow over a set: every combination of files and a seed, by name."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.model import Each, Flow
from texloom.pipelines.flow.source_files import is_pattern, matching
from texloom.pipelines.media import udim
from texloom.pipelines.media.material_set import holds_maps

MOST_NAMES = 3
"""of pictures, in the name of what is made of several"""

_MAX_ITEMS = 100_000
_MAX_NAME = 255  # bytes of a folder's name
_UNSAFE = ("Cc", "Cs", "Zl", "Zp")  # control characters, what is not Unicode, ends of lines


@dataclasses.dataclass(frozen=True)
class Item:
    """A combination of files and a seed, for which the steps of scope ``item`` run."""

    name: str
    """of its file or folder, and the seed if there are several; valid as a folder's name, whatever case counts"""
    seed: int
    sources: Mapping[str, str]
    """name to file, for the sources that stand for sets"""

    def described(self) -> dict[str, Any]:
        """As stages receive it: files without folders, so that a set may move."""
        return {
            "name": self.name,
            "seed": self.seed,
            "sources": {name: Path(path).name for name, path in self.sources.items()},
        }


def items_of(flow: Flow) -> list[Item]:
    """All items, in the order of their file names, or in that of an ordered source, and then of the seeds.

    Files of a source with ``pair`` go with those of the other source whose wildcards match the same words. Other
    sources are combined in every way.

    Raises
    ------
    InputError : a pattern that no file or map set matches, files without partner, too many items.
    """
    sets = {name: source for name, source in flow.sources.items() if isinstance(source, Each)}
    leaders = {name: source for name, source in sets.items() if source.pair is None}
    files = {name: _matching(flow, name, source) for name, source in sets.items()}
    for name, source in sets.items():
        if source.pair is not None:
            _check_partners(flow, name, files[name], source.pair, files[source.pair])
    count = len(flow.seeds) * math.prod(len(files[name]) for name in leaders)
    if count > _MAX_ITEMS:
        raise refused(f"{flow.where('sources')}: {count} items, at most {_MAX_ITEMS}")

    own = {name: own_names([*files[name].values()]) for name in leaders}
    items = []
    orders = (list(files[name]) if source.is_ordered else sorted(files[name]) for name, source in leaders.items())
    for words in itertools.product(*orders):
        chosen = dict(zip(leaders, words, strict=True))
        paths = {name: files[name][chosen[source.pair or name]] for name, source in sets.items()}
        stem = "-".join(own[name][files[name][word]] for name, word in chosen.items())
        for seed in flow.seeds:
            parts = [part for part in (stem, str(seed) if len(flow.seeds) > 1 else "") if part]
            items.append(Item("-".join(parts) or flow.name, seed, paths))
    _check_names(flow, [item.name for item in items])
    return items


def _check_names(flow: Flow, names: Sequence[str]) -> None:
    """Names of items must be different ones that folders can have."""
    for name in names:
        if len(name.encode()) > _MAX_NAME:
            problem = f"an item would be called '{name[:40]}...', which is too long for a folder's name"
            raise refused(f"{flow.where('sources')}: {problem}")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise refused(f"{flow.where('sources')}: two items would be called '{twice[0]}'")


def _matching(flow: Flow, name: str, source: Each) -> dict[str, str]:
    """The files and map sets of a set by what the wildcards match, or the file's own name."""
    words: dict[str, str] = {}
    for pattern in source.patterns:
        found = _matching_pattern(pattern) if is_pattern(pattern) else {pattern: ""}
        if not found:
            problem = f"no file or map set matches {pattern}{_own_sets(flow, name)}"
            raise refused(f"{flow.where('sources', name)}: {problem}")
        words |= found
    words |= _unlike([path for path, word in words.items() if not word])
    words = {path: _safe(word) for path, word in _without_suffix(words).items()}
    files: dict[str, str] = {}
    for path, word in words.items():
        if word in files:
            problem = f"{files[word]} and {path} would both be called '{word}'"
            raise refused(f"{flow.where('sources', name)}: {problem}")
        files[word] = path
    return files


def _without_suffix(words: Mapping[str, str]) -> Mapping[str, str]:
    """Words of files without their suffixes, unless these tell files apart."""
    shorter = {
        path: word.removesuffix(Path(path).suffix) if _is_file(path) or udim.is_tiled(path) else word
        for path, word in words.items()
    }
    return shorter if len(set(shorter.values())) == len(words) else words


def own_names(paths: Sequence[str]) -> dict[str, str]:
    """The name of each file's folder of results, whatever pattern has found it."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for path, word in _without_suffix(_unlike(paths)).items():
        safe = _safe(word)
        numbers = (f"{safe}-{number}" for number in itertools.count(2))
        # where case does not count, Moss and moss would be one folder
        is_alike = safe not in names.values() and safe.lower() in taken
        names[path] = next(one for one in numbers if one.lower() not in taken) if is_alike else safe
        taken.add(names[path].lower())
    return names


def _is_file(path: str) -> bool:
    """As `Path.is_file`, which takes three times as long, for thousands of files."""
    return os.path.isfile(path)  # noqa: PTH113


def _own_sets(flow: Flow, name: str) -> str:
    """What to add to a command that left the flow's own pattern of a source."""
    given = {*flow.overrides.sources, *([next(iter(flow.sources))] if flow.overrides.pictures else [])}
    if name in given:
        return ""
    sets = [one for one, source in flow.sources.items() if isinstance(source, Each) and one not in given]
    patterns = [f"--source '{one}=FOLDER/{f'*_{one}' if len(flow.sources) > 1 else '*'}.png'" for one in sets]
    return f"; give yours, as with {' '.join(patterns)}"


def _matching_pattern(pattern: str) -> dict[str, str]:
    """The files and map sets that match a pattern, with what the wildcards match."""
    expression = re.compile(_groups(pattern))
    words: dict[str, str] = {}
    for path in matching(pattern).files:
        match = expression.fullmatch(path)
        if match is not None and (_is_file(path) or _is_map_set(Path(path))):
            words[path] = "-".join(word.strip("/").replace("/", "-") for word in match.groups() if word)
    return words


def _unlike(paths: Sequence[str]) -> dict[str, str]:
    """Names of files: their own; those of their folders if all have the same; else both."""
    names = {path: udim.plain_name(path) for path in paths}
    stems = {Path(name).stem for name in names.values()}
    if len(stems) == len(names):
        return names
    common = os.path.commonpath([Path(path).parent for path in paths])
    relative = {path: Path(path).relative_to(common) for path in paths}
    if len(stems) == 1 and len({path.parent for path in relative.values()}) == len(names):
        relative = {path: place.parent for path, place in relative.items()}
    return {path: str(place).replace("/", "-") for path, place in relative.items()}


def _safe(word: str) -> str:
    """``word`` as a folder's name, which is neither ``.`` nor ``..``."""
    kept = "".join("_" if c == "\\" or unicodedata.category(c) in _UNSAFE else c for c in word)
    return kept if kept.strip(".") else "_" * len(kept)


def _is_map_set(path: Path) -> bool:
    """Whether it is a folder of maps; others among the files are passed over."""
    try:
        return path.is_dir() and holds_maps(path)
    except OSError:
        return False


def _groups(pattern: str) -> str:
    """A pattern as a regular expression with a group for each wildcard."""
    pieces = re.split(r"(\*\*/|\*\*|\*|\?|\[[^\]]+\])", pattern)
    wildcards = {"**/": "((?:.*/)?)", "**": "(.*)", "*": "([^/]*)", "?": "([^/])"}
    return "".join(
        wildcards.get(piece) or (f"({piece.replace('[!', '[^')})" if piece.startswith("[") else re.escape(piece))
        for piece in pieces
    )


def _check_partners(
    flow: Flow, name: str, files: Mapping[str, str], other: str, partners: Mapping[str, str]
) -> None:
    for words in sorted(set(files) ^ set(partners)):
        here, there = (name, other) if words not in files else (other, name)
        path = {**files, **partners}[words]
        problem = f"no file goes with {there} {path}"
        if not set(files) & set(partners):  # as of a pattern without quotes, which the shell makes a list of files
            own = min(files if here == name else partners)
            problem += (
                f", called '{words}'; {here} has '{own}'. An item's name is what * matches in a quoted pattern"
            )
        raise refused(f"{flow.where('sources', here)}: {problem}")
