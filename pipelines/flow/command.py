"""The command line that repeats a run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from texloom.pipelines.flow.items import Item
from texloom.pipelines.flow.model import Flow
from texloom.pipelines.flow.shipped import flow_word


def command_of(flow: Flow, item: Item | None = None) -> str:
    """The command that repeats a run, or makes one item of a set by itself, with the same random numbers.

    Omitted are the flow's own sources, and store, output folder and runner, which do not change results. Relative
    paths are relative to the working folder. Quoted for POSIX shells.
    """
    is_comparison = flow.compared or flow.against
    words = _compared(flow) if is_comparison else ["run", _flow_word(flow.path), *_pictures(flow, item)]
    for name, text in flow.overrides.texts.items():
        words += param_words(name, text)
    words += [word for file, name in flow.overrides.exports.items() for word in ("--export", f"{file}={name}")]
    words += option_words({**flow.overrides.part, **flow.overrides.delivery})
    words += _seed_words(flow, item)
    return shlex.join(["texloom", *words])


def option_words(options: Mapping[str, str]) -> list[str]:
    """Options that have a value each, by the names of their fields."""
    return [word for name, text in sorted(options.items()) for word in (f"--{name.replace('_', '-')}", text)]


def _compared(flow: Flow) -> list[str]:
    exemplars = _listed(next(iter(flow.overrides.sources.values()), ""))
    words = ["compare", *(_flow_word(path) for path in flow.compared), "--over", *exemplars]
    return words + [
        word for name, path in flow.against.items() for word in ("--against", f"{name}={_short(str(path))}")
    ]


def _pictures(flow: Flow, item: Item | None) -> list[str]:
    """The sources that were given, or those of an item; the first one needs no option."""
    first = next(iter(flow.sources), "")
    given = {name: _listed(value) for name, value in flow.overrides.sources.items()}
    if flow.overrides.pictures:
        given[first] = list(flow.overrides.pictures)
    if item is not None:
        given |= {name: [_short(path)] for name, path in item.sources.items()}
    options = [("--source", f"{name}={path}") for name, paths in given.items() if name != first for path in paths]
    return [*given.get(first, []), *(word for option in options for word in option)]


def _listed(value: str | Sequence[str]) -> list[str]:
    return [value] if isinstance(value, str) else list(value)


def _flow_word(path: Path) -> str:
    word = flow_word(path)
    return word if word == path.stem else _short(word)


def _short(path: str) -> str:
    """A path relative to the working folder if it is inside of it."""
    if ":" in path.partition("/")[0]:  # skimage:NAME
        return path
    whole = Path(path).absolute()
    return str(whole.relative_to(Path.cwd())) if whole.is_relative_to(Path.cwd()) else str(whole)


def param_words(name: str, text: str) -> list[str]:
    """The option that gives a param a value."""
    text = _plain(text)
    if name in ("size", "preset"):
        return [f"--{name}", text]
    if name == "tileable" and text in ("true", "x", "y"):
        return ["--tileable" if text == "true" else f"--tileable={text}"]
    return ["--set", f"{name}={text}"]


def _plain(text: str) -> str:
    """A word without the quotes that JSON has around it, where YAML needs none."""
    word = text[1:-1]
    return word if text == f'"{word}"' and re.fullmatch(r"[A-Za-z_]\w*|\d+x\d+", word) else text


def _seed_words(flow: Flow, item: Item | None) -> list[str]:
    if item is not None or len(flow.seeds) == 1:
        return ["--seed", str(flow.seeds[0] if item is None else item.seed)]
    count = ["--seeds", str(len(flow.seeds))]
    return (
        [*count, "--seed", str(flow.seeds[0])]
        if flow.compared or flow.against
        else ["--seeds", f"{flow.seeds[0]}-{flow.seeds[-1]}"]
    )
