"""What the commands print."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, TextIO

import click


def text_stream(as_json: bool) -> TextIO:
    """Where text goes: with ``as_json``, standard output is for the JSON alone."""
    return sys.stderr if as_json else sys.stdout


def say(text: str | Path, as_json: bool = False) -> None:
    """Print one line; names of files may hold line breaks and what a terminal would obey."""
    from texloom.pipelines.errors import one_line

    click.echo(one_line(str(text)), file=text_stream(as_json))


def print_json(value: Any) -> int:
    """Print a report, a list with a line an entry, of which there may be a million; returns exit code 0."""
    if isinstance(value, list) and value:
        click.echo("[\n  " + ",\n  ".join(map(json.dumps, value)) + "\n]")
    else:
        click.echo(json.dumps(value, indent=2))
    return 0


def complain(text: str) -> None:
    """Print one line on standard error."""
    from texloom.pipelines.errors import one_line

    click.echo(one_line(text.replace("\n", " ")), err=True)
