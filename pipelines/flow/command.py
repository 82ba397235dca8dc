"""The command line that repeats a run."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

from texloom.pipelines.flow.items import Item
from texloom.pipelines.flow.loader import shipped_flows
from texloom.pipelines.flow.model import Flow


def command_of(flow: Flow, item: Item | None = None) -> str:
    """The command that repeats a run, or makes one item of a set by itself, with the same random numbers.

    Omitted are the flow's own sources, and store, output folder and runner, which do not change results. Relative
    paths are relative to the working folder. Quoted for POSIX shells.
    """
    if flow.compared:
        words = ["compare", *(_flow_word(path) for path in flow.compared)]
    else:
        words = ["run", _flow_word(flow.path)]
    for name, given in flow.overrides.sources.items():
        if item is not None and name in item.sources:
            continue
        words += ["--over", given] if flow.compared else ["--source", f"{name}={given}"]
    if item is not None:
        words += [word for name, path in item.sources.items() for word in ("--source", f"{name}={_short(path)}")]
    for name, text in flow.overrides.params.items():
        words += _param_words(name, text)
    words += _seed_words(flow, item)
    return shlex.join(["texloom", *words])


def _flow_word(path: Path) -> str:
    shipped = shipped_flows().get(path.stem)
    is_shipped = shipped is not None and shipped.resolve() == path.resolve()
    return path.stem if is_shipped else _short(str(path))


def _short(path: str) -> str:
    """A path relative to the working folder if it is inside of it."""
    if ":" in path.partition("/")[0]:  # skimage:NAME
        return path
    whole = Path(path).absolute()
    return str(whole.relative_to(Path.cwd())) if whole.is_relative_to(Path.cwd()) else str(whole)


def _param_words(name: str, text: str) -> list[str]:
    if name == "size":
        return ["--size", _size(text)]
    if name == "preset":
        return ["--preset", text.strip('"')]
    if name == "tileable" and text == "true":
        return ["--tileable"]
    return ["--set", f"{name}={text}"]


def _size(text: str) -> str:
    """A size of two sides as ``HxW``, which needs no quotes."""
    try:
        sides = json.loads(text)
    except ValueError:
        return text
    return "x".join(map(str, sides)) if isinstance(sides, list) else str(sides)


def _seed_words(flow: Flow, item: Item | None) -> list[str]:
    if item is not None or len(flow.seeds) == 1:
        return ["--seed", str(flow.seeds[0] if item is None else item.seed)]
    count = ["--seeds", str(len(flow.seeds))]
    return (
        [*count, "--seed", str(flow.seeds[0])]
        if flow.compared
        else ["--seeds", f"{flow.seeds[0]}-{flow.seeds[-1]}"]
    )
