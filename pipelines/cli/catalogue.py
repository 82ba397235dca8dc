"""The commands ``flows``, ``stages`` and ``check-stage``: what there is, and whether it keeps its contract."""

from __future__ import annotations

import dataclasses

import click

from texloom.pipelines.cli.exits import Exit
from texloom.pipelines.cli.options import complete, json_option
from texloom.pipelines.cli.output import print_json, say


@click.command(short_help="List the flows, or explain one: sources, steps, exports.")
@click.argument("name", required=False, shell_complete=complete("flow_names"))
@json_option
def flows(name: str | None, as_json: bool) -> int:
    """List the flows that ship with texloom, or explain the one called NAME: sources, steps, exports.

    \b
    texloom flows
    texloom flows self_tuning

    NAME may also be a YAML file. `texloom stages` explains the params of the steps.
    """
    from texloom.pipelines.flow.shipped import flow_catalogue

    if name is None:
        return _print_catalogue(flow_catalogue(), "flows", as_json)
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
        return _print_catalogue(catalogue(), "stages", as_json)
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


def _print_catalogue(entries: dict[str, str], command: str, as_json: bool) -> int:
    if as_json:
        return print_json(entries)
    width = max(map(len, entries))
    for name, summary in entries.items():
        click.echo(f"{name:{width}}  {summary}")
    click.echo(f"\ntexloom {command} NAME explains one.")
    return Exit.DONE
