"""``texloom show``: the contents and provenance of EXR files, and facts of pictures and materials."""

from __future__ import annotations

import contextlib
import os
import textwrap
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from texloom.pipelines.cli.exits import Exit
from texloom.pipelines.cli.options import memory_option
from texloom.pipelines.cli.output import print_json, say


@click.command(short_help="Show the contents and provenance of EXR files, and facts of pictures.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option(
    "--png",
    "folder",
    type=click.Path(path_type=Path),
    help="Write each layer as a PNG into this folder; those of several files into folders of their own there. "
    "Files that are there and hold something else are not replaced.",
)
@memory_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON; a list, if there are several files.")
def show(files: tuple[Path, ...], folder: Path | None, as_json: bool) -> int:
    """Show the contents of EXR files (layers, sizes, channels) and their provenance.

    Of these, of other pictures and of materials (a folder or YAML file of maps): whether they tile, and where no
    file says it, whether that is plausible; bits, ranges, roles; where green of normals points, and whether that
    fits the heights. Nothing is decided by what is measured.

    \b
    texloom show mine/texture.exr
    texloom show mine/texture.exr --png layers
    """
    from texloom.pipelines.media.about import about_material, about_picture
    from texloom.pipelines.media.material_set import is_map_set
    from texloom.pipelines.store import codec
    from texloom.pipelines.store.atomic import check_folder
    from texloom.stages.vocabulary.declare import InputError

    several = len(files) > 1
    folders: dict[Path, Path] = {}
    if folder is not None:
        check_folder("--png", folder)
        folders = _folders_of_pictures(files, folder) if several else {files[0]: folder}
        for file, place in folders.items():
            codec.check_pictures(file, place)
    reports = []
    for file in files:
        is_material = is_map_set(str(file))
        found = {} if is_material or _is_picture(file) else codec.describe(file)
        with contextlib.suppress(*[InputError] if found else []):  # an EXR may hold other things than a picture
            found["facts"] = (about_material if is_material else about_picture)(file)
        written = codec.pictures(file, folders[file]) if folders else []
        reports.append({**({"file": str(file)} if several else {}), **found, "pictures": list(map(str, written))})
        if not as_json:
            if several:
                say(f"{file}:")
            if is_material:
                click.echo(textwrap.indent(_table(found["facts"]), "  " if several else ""))
            click.echo(textwrap.indent(_described(_without_files(found)), "  " if several else ""))
            for path in written:
                say(path)
    if as_json:
        print_json(reports if several else reports[0])
    return Exit.DONE


def _is_picture(file: Path) -> bool:
    """Whether a file is a picture other than an EXR, by its name."""
    from texloom.pipelines.media.material_set import is_picture

    return is_picture(file) and file.suffix.lower() != ".exr"


def _folders_of_pictures(files: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """A folder inside of ``folder`` for each file, placed as the files are, whatever links and dots name them."""
    whole = {file: Path(os.path.realpath(file.parent), file.name) for file in files}
    common = Path(os.path.commonpath([path.parent for path in whole.values()]))
    # without what it ends in, where that leaves a name, and one of its own
    short = {path: path.with_name(path.stem) if path.stem.strip(".") else path for path in set(whole.values())}
    taken = Counter(short.values())
    return {
        file: folder / (short[path] if taken[short[path]] == 1 else path).relative_to(common)
        for file, path in whole.items()
    }


def _table(facts: dict[str, Any]) -> str:
    """The maps of a material, one a line: what is said of each, and what is plausible by measure."""
    rows = [("role", "file", "channel", "bits", "green", "tiling", "plausible")]
    for role, one in facts["files"].items():
        channel = f"{'1-' if one.get('inverted') else ''}{one.get('channel', 'all')}"
        green = one.get("green", "up, assumed") if role == "normal" else ""
        measured = ", ".join(f"{axis} {wraps}" for axis, wraps in one.get("plausible_wraps", {}).items())
        tiling = one.get("wraps") or f"measured: {measured}"
        rows.append((role, one["file"], channel, str(one["bits"]), green, tiling, one.get("plausible", "")))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def _without_files(found: dict[str, Any]) -> dict[str, Any]:
    facts = found.get("facts", {})
    return {**found, "facts": {name: value for name, value in facts.items() if name != "files"}} if facts else found


def _described(found: dict[str, Any]) -> str:
    import yaml

    provenance = found.get("provenance")
    if isinstance(provenance, dict) and isinstance(provenance.get("from"), dict):
        digests = dict(provenance.get("inputs") or {})
        inputs = {
            name: f"{label}, sha256 {str(digests.get(name))[:12]}" for name, label in provenance["from"].items()
        }
        rest = {name: value for name, value in provenance.items() if name != "from"}
        found = {**found, "provenance": {**rest, "inputs": {**digests, **inputs}}}
    return yaml.safe_dump(found, sort_keys=False, allow_unicode=True, width=100, default_flow_style=None).rstrip()
