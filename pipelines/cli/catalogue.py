"""The commands ``flows``, ``stages`` and ``check-stage``: what there is, and whether it keeps its contract."""

from __future__ import annotations

import dataclasses
import itertools
import re
import shutil
import textwrap
from typing import TYPE_CHECKING

import click

from texloom.pipelines.cli.exits import Exit
from texloom.pipelines.cli.options import complete, json_option
from texloom.pipelines.cli.output import print_json, say

if TYPE_CHECKING:
    from texloom.pipelines.flow.shipped import CatalogueEntry

_PAPERS = re.compile(r"(?<! of) \[[A-Za-z]+\d{4}[^\]]*\]")
"""what a list of flows leaves out of a sentence"""


@click.command(short_help="List the flows, or explain one: sources, steps, exports.")
@click.argument("name", required=False, shell_complete=complete("flow_names"))
@click.option("--studies", is_flag=True, help="List the studies, which repeat experiments of papers.")
@json_option
def flows(name: str | None, studies: bool, as_json: bool) -> int:
    """List the flows that ship with texloom, or explain the one called NAME: sources, steps, exports.

    \b
    texloom flows
    texloom flows self_tuning

    NAME may also be a YAML file. `texloom stages` explains the params of the steps.
    With --json all flows are listed.
    """
    from texloom.pipelines.flow.shipped import flow_catalogue

    if name is None:
        entries = flow_catalogue()
        if as_json:
            return print_json({flow: dataclasses.asdict(entry) for flow, entry in entries.items()})
        return _print_flows(entries, studies)
    from texloom.pipelines.cli.describe import flow_description, flow_explained

    found = flow_description(name)
    if as_json:
        return print_json(found)
    click.echo(flow_explained(found))
    click.echo("\ntexloom stages STAGE explains the params of a step.")
    return Exit.DONE


@click.command(short_help="List the stages, or explain one: inputs, params, outputs, source.")
@click.argument("name", required=False, shell_complete=complete("stage_names"))
@json_option
def stages(name: str | None, as_json: bool) -> int:
    """List the stages, or explain the one called NAME: inputs, params with defaults, outputs, source.

    \b
    texloom stages
    texloom stages optimise
    """
    from texloom.pipelines.cli.describe import catalogue, description, explained

    if name is None:
        return _print_stages(catalogue(), as_json)
    found = description(name)
    if as_json:
        return print_json(found)
    click.echo(explained(found))
    return Exit.DONE


@click.command("check-stage", short_help="Test the properties that every stage must have, as of a plug-in.")
@click.argument("name", shell_complete=complete("stage_names"))
@json_option
def check_stage(name: str, as_json: bool) -> int:
    """Test a stage on small synthetic exemplars: documentation, equal bits, masks, tiling, maps, bad input.

    \b
    TEXLOOM_PLUGINS=~/my_method texloom check-stage my_method

    What does not apply to a stage is skipped. The exit code is 1 if a property does not hold.
    """
    from texloom.pipelines.cli import check_stage as checks

    outcomes = checks.check_stage(name)
    if as_json:
        print_json([dataclasses.asdict(one) for one in outcomes])
    else:
        for one in outcomes:
            say(f"{one.name:16}  {one.state:7}  {one.detail}".rstrip())
    return Exit.FAILED if any(one.state == "failed" for one in outcomes) else Exit.DONE


def _print_stages(entries: dict[str, str], as_json: bool) -> int:
    if as_json:
        return print_json(entries)
    width = max(map(len, entries))
    for name, summary in entries.items():
        click.echo(f"{name:{width}}  {summary}")
    click.echo("\ntexloom stages NAME explains one.")
    return Exit.DONE


def _print_flows(entries: dict[str, CatalogueEntry], studies: bool) -> int:
    """Print the flows that are listed, by group, and the names of others; or the studies."""
    from texloom.pipelines.flow.shipped import GROUPS, STUDIES

    if studies:
        shown = {name: entry for name, entry in entries.items() if entry.group == STUDIES}
    else:
        shown = {name: entry for name, entry in entries.items() if entry.listed}
    width = max(map(len, shown)) + 4
    columns = shutil.get_terminal_size().columns
    for group, members in itertools.groupby(shown, lambda name: shown[name].group):
        click.echo(GROUPS[group] if group else "Of plug-ins")
        for name in members:
            text = _PAPERS.sub("", shown[name].about)
            click.echo(_wrapped(f"  {name:{width - 2}}", text, " " * width, columns))
    if not studies:
        others = [name for name, entry in entries.items() if entry not in shown.values() and entry.group != STUDIES]
        click.echo("")
        click.echo(_wrapped("Also by name: ", ", ".join(sorted(others)), "  ", columns))
        click.echo("texloom flows --studies lists the studies.")
    click.echo(f"{chr(10) if studies else ''}texloom flows NAME explains one.")
    return Exit.DONE


def _wrapped(begin: str, text: str, indent: str, columns: int) -> str:
    return textwrap.fill(text, max(columns, 60), initial_indent=begin, subsequent_indent=indent)
