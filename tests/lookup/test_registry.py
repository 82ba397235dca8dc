"""Stages are found by the names of their files, whatever their room."""

from __future__ import annotations

import ast
import collections
from pathlib import Path

import pytest

import texloom.pipelines
import texloom.stages
from texloom.stages.lookup.registry import find_stage, shipped_stages

STAGES = Path(texloom.stages.__path__[0])
PIPELINES = Path(texloom.pipelines.__path__[0])


def test_files_have_names_of_their_own() -> None:
    """The name of a file tells it from all others, as the name of a stage tells nothing of its room."""
    count = collections.Counter(path.stem for path in STAGES.rglob("*.py") if path.stem != "__init__")
    assert [name for name, times in count.items() if times > 1] == []


def test_classes_have_names_of_their_own() -> None:
    """One word for one thing: whoever reads the name of a class need not ask which one is meant."""
    places = collections.defaultdict(list)
    for path in [*PIPELINES.rglob("*.py"), *STAGES.rglob("*.py")]:
        if "node_modules" not in path.parts:
            for part in ast.walk(ast.parse(path.read_bytes())):
                if isinstance(part, ast.ClassDef):
                    places[part.name].append(f"{path.relative_to(STAGES.parent)}:{part.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_rooms_are_no_part_of_names() -> None:
    optimise = find_stage("synthesis.optimise")
    assert optimise.name == "synthesis.optimise"
    assert optimise.module == "texloom.stages.synthesis.optimisation.optimise"
    with pytest.raises(KeyError):
        find_stage("synthesis.optimisation.optimise")


@pytest.mark.parametrize("name", ["synthesis.vote", "analysis.vanishing"])
def test_helpers_are_no_stages(name: str) -> None:
    assert name not in shipped_stages()
    with pytest.raises(KeyError):
        find_stage(name)
