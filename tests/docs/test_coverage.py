"""Nothing that a user meets is undocumented."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import click
import pytest
import yaml

import texloom
from tests.conftest import ROOT
from tests.docs.pages import DOCS, PAGES, blocks, script
from texloom.pipelines.cli.describe import catalogue, description, flow_description
from texloom.pipelines.cli.main import texloom as command_line
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.shipped import flow_catalogue, shipped_flows

_MODULES = ("vocabulary",)
"""of `texloom.stages`, whose modules stages of other packages import"""
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    return script(DOCS / "gallery" / "make_gallery.py")


def test_every_flow_is_in_the_gallery() -> None:
    listed = yaml.safe_load((DOCS / "gallery" / "gallery.yaml").read_text())["groups"]
    found = {flow["flow"]: group["group"] for group in listed for flow in group["flows"]}
    assert found == {name: entry.group for name, entry in flow_catalogue().items()}


def test_the_gallery_is_as_written_by_its_program(gallery: ModuleType) -> None:
    listed = yaml.safe_load((DOCS / "gallery" / "gallery.yaml").read_text())
    times = json.loads((DOCS / "gallery" / "times.json").read_text())
    page = (DOCS / "gallery.md").read_text()
    assert page == gallery.page(listed, times), "run: python docs/gallery/make_gallery.py --page"


@pytest.mark.parametrize("name", flow_catalogue())
def test_a_flow_says_what_it_does_and_how_to_run_it(name: str) -> None:
    flow = flow_description(name)
    assert f"texloom run {name}" in flow["description"]
    assert all(param["what"] for param in flow["params"].values())


@pytest.mark.parametrize("name", catalogue())
def test_a_stage_says_what_it_takes_and_gives(name: str) -> None:
    stage = description(name)
    assert stage["summary"]
    silent = [
        f"{kind}.{key}"
        for kind in ("inputs", "params", "outputs")
        for key, what in stage[kind].items()
        if not what["what"]
    ]
    assert not silent


def every_command(command: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        for name, below in command.commands.items():
            yield from every_command(below, f"{path} {name}")


@pytest.mark.parametrize(("path", "command"), list(every_command(command_line, "texloom")))
def test_a_command_is_explained_and_shown(path: str, command: click.Command) -> None:
    assert command.help
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    assert not [option.name for option in options if not option.help]
    assert path in TEXT


def test_every_environment_variable_is_documented() -> None:
    sources = [
        path.read_text(encoding="utf-8")
        for folder in ("pipelines", "stages")
        for path in (ROOT / folder).rglob("*.py")
    ]
    used = set(re.findall(r"\bTEXLOOM_[A-Z]+", "\n".join(sources)))
    table = (DOCS / "platforms.md").read_text()
    assert not {name for name in used if f"`{name}`" not in table}


def test_the_python_interface_is_documented() -> None:
    page = (DOCS / "api.md").read_text()
    assert not [name for name in texloom.__all__ if f"texloom.{name}" not in page]


def test_examples_in_python_use_what_exists() -> None:
    names: set[str] = set(texloom.__all__)
    stages = {name.rpartition(".")[2] for name in catalogue()}
    for page in PAGES:
        for block in blocks(page):
            if block.language == "python":
                compile(block.text, str(page), "exec")
                used: list[Any] = re.findall(r"(?<!bpy\.ops\.)\btexloom\.(\w+)(?:\.(\w+))?", block.text)
                assert {name for name, _ in used} <= names | {"stages", "pipelines"}
                assert {stage for name, stage in used if name == "stages" and stage} <= stages | {
                    "interactive",
                    *_MODULES,
                }


def test_flows_on_pages_are_valid(tmp_path: Path) -> None:
    shown = [block.text for page in PAGES for block in blocks(page) if block.language == "yaml"]
    flows = [text for text in shown if text.startswith("flow:")]
    assert flows
    for text in flows:
        (tmp_path / "shown.yaml").write_text(text)
        load_flow(tmp_path / "shown.yaml")


def test_params_in_running_text_exist() -> None:
    steps: dict[str, set[str]] = {}
    params: set[str] = set()
    for path in shipped_flows().values():
        flow = load_flow(path)
        params |= set(flow.params)
        for name, step in [*flow.steps.items(), *flow.skipped.items()]:
            steps.setdefault(name, set()).update(step.stage.params.model_fields)
    for name in re.findall(r"--set '?([a-z_.]+)=", TEXT):
        step, _, param = name.partition(".")
        assert param.partition(".")[0] in steps.get(step, ()) if param else step in params, name
