"""One request: every way to make one has the same fields."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import texloom
from texloom.pipelines import request_fields
from texloom.pipelines.cli import main as cli
from texloom.pipelines.cli.options import FlowCommand
from texloom.pipelines.engine.prefect.flow_run import run_flow
from texloom.pipelines.request import RunRequest, request
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.stages.vocabulary.declare import InputError

FIELDS = set(RunRequest.model_fields)
ABOUT = {name: option.help for name, option in request_fields.OPTIONS.items()}
OPTIONS = {"store": "store_folder"}
"""fields that click calls otherwise, as other commands have them too"""
PARAMETERS = {"sources": "source", "params": "set", "exports": "export"}
"""fields that Prefect has under the names of the options"""

# What a way to ask lacks, with the reason.
ONE_PICTURE = "makes one texture of one picture and writes no file"
IN_ONE_PROCESS = "computes in the process that asks"
NOT_OF = {
    "run": {},
    "plan": {},
    "commands": dict.fromkeys(("runner", "workers", "address", "item"), "a farm decides; the lines name the item"),
    "texloom.run": {"pictures": "sources name them"},
    "texloom.plan": {
        "pictures": "sources name them",
        **dict.fromkeys(
            ("exports", "out", "force", "keep", "layout", "texel_size", "color_space", "udim", "material"),
            "writes nothing",
        ),
        **dict.fromkeys(("runner", "workers", "address"), "computes nothing"),
    },
    "texloom.synthesize": {
        "flow": "is called method",
        **dict.fromkeys(("pictures", "sources", "seeds", "item"), ONE_PICTURE),
        **dict.fromkeys(
            ("exports", "out", "force", "keep", "layout", "texel_size", "color_space", "udim", "material"),
            ONE_PICTURE,
        ),
        **dict.fromkeys(("runner", "workers", "address"), IN_ONE_PROCESS),
    },
    "Prefect": {"pictures": "source names them"},
    "studio": {
        **dict.fromkeys(("pictures", "seeds", "item"), "the page makes one result at a time"),
        **dict.fromkeys(
            ("store", "remote", "out", "force", "exports", "keep"), "the page keeps its results in its store"
        ),
        **dict.fromkeys(
            ("crop", "reduce", "texel_size", "color_space"), "the page has no such form; the flow file has"
        ),
        **dict.fromkeys(("runner", "workers", "address"), IN_ONE_PROCESS),
    },
}


def options_of(command: str) -> set[str]:
    return {str(option.name) for option in cli.texloom.commands[command].params}


def arguments_of(function: Any) -> set[str]:
    return set(inspect.signature(function).parameters)


WAYS = {
    "run": (options_of("run"), OPTIONS),
    "plan": (options_of("plan"), OPTIONS),
    "commands": (options_of("commands"), OPTIONS),
    "texloom.run": (arguments_of(texloom.run), {}),
    "texloom.plan": (arguments_of(texloom.plan), {}),
    "texloom.synthesize": (arguments_of(texloom.synthesize), {}),
    "Prefect": (arguments_of(run_flow), PARAMETERS),
    "studio": (set(Recipe.model_fields), {}),
}
OF_THEIR_OWN = {"as_json", "only", "memory", "progress", "image", "method", "mask", "files", "lists"}
"""how a result is told, the limit of a process, and pictures and files that a program or the page holds"""


@pytest.mark.parametrize("way", WAYS)
def test_every_field_is_everywhere(way: str) -> None:
    names, renamed = WAYS[way]
    expected = {renamed.get(field, field) for field in FIELDS - set(NOT_OF[way])}
    assert names - OF_THEIR_OWN == expected
    assert set(NOT_OF[way]) <= FIELDS


def test_the_help_is_that_of_the_fields() -> None:
    assert {name: field.description for name, field in RunRequest.model_fields.items()} == ABOUT
    assert set(request_fields.OPTIONS) == FIELDS
    helped = {option.name: getattr(option, "help", None) for option in cli.texloom.commands["run"].params}
    for field in FIELDS - {"flow", "pictures"}:
        assert helped[OPTIONS.get(field, field)] == ABOUT[field]


def test_unknown_fields_and_values_of_a_wrong_type_are_refused() -> None:
    with pytest.raises(InputError, match=r"^--siez: extra inputs are not permitted$"):
        request(flow="quilting", siez=64)
    with pytest.raises(InputError, match=r"^--workers: input should be a valid integer"):
        request(flow="quilting", workers="many")
    with pytest.raises(InputError, match=r"^--tileable: .* valid boolean, .*'off', 'x', 'y' or 'both'$"):
        request(flow="quilting", tileable="z")
    asked = request(flow="quilting")
    with pytest.raises(ValueError, match="frozen"):
        asked.flow = "other"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"size": "64", "params": {"size": "64"}}, "--size and --set size=... say the same; give one of them"),
        ({"seeds": 1001}, "--seeds: must be from 1 to 1000 seeds"),
        ({"seeds": tuple(range(1001))}, "--seeds: must be from 1 to 1000 seeds"),
        ({"seed": 1, "seeds": (1, 2)}, "--seed and a range of --seeds say the same; give one of them"),
    ],
)
def test_what_is_said_twice_or_too_much_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        _ = request(flow="quilting", **fields).overrides
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("words", "pictures", "tileable"),
    [
        ("--tileable moss.png", ("moss.png",), "both"),
        ("--tileable=both moss.png", ("moss.png",), "both"),
        ("--tileable=x moss.png", ("moss.png",), "x"),
        ("--tileable=y moss.png", ("moss.png",), "y"),
        ("moss.png --tileable=off", ("moss.png",), "off"),
        ("moss.png", ("moss.png",), None),
        ("-- --tileable", ("--tileable",), None),
    ],
)
def test_the_value_of_tileable_follows_an_equals_sign(
    words: str, pictures: tuple[str, ...], tileable: str | None
) -> None:
    command = cli.texloom.commands["run"]
    assert isinstance(command, FlowCommand)
    found = command.make_context("run", ["quilting", *words.split()]).params
    assert (found["pictures"], found["tileable"]) == (pictures, tileable)


@pytest.mark.parametrize(
    ("value", "message"),
    [("z", "'z' is none of x, y, both"), ("true", "'true' is none of x, y, both")],
)
def test_other_values_of_tileable_are_refused(value: str, message: str) -> None:
    with pytest.raises(Exception, match=re.escape(message)):
        cli.texloom.commands["run"].make_context("run", ["quilting", f"--tileable={value}"])


def test_a_range_of_very_many_seeds_is_refused_at_once() -> None:
    with pytest.raises(InputError, match="seeds: must be from 1 to 1000 seeds"):
        texloom.plan("quilting", seeds=range(10**12))


def test_a_request_is_light() -> None:
    code = (
        "import sys, texloom.pipelines.request_fields; assert 'pydantic' not in sys.modules; "
        "import texloom.pipelines.request; print({'prefect', 'numba', 'cv2'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path("/"))
    assert done.stdout == "set()\n"
