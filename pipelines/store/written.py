"""The files of runs without ``--out``: which ones texloom wrote, so that nothing else below ``runs/`` is removed.

``written/<folder of the run>`` has a line for each file: its digest and its path in that folder. A line is added
after its file is written, so that a file of a run that was killed in between stays until the user removes it.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path

from texloom.pipelines.store.folders import Folder

_FOLDER = "written"
_MOST = 2**28  # bytes
_LINE = re.compile(r"([0-9a-f]{64})  ([^\0\n]+)")


def add(root: Path, run: str, files: Mapping[str, str]) -> None:
    """Note files of a run's folder, by path in it to digest."""
    lines = "".join(f"{digest}  {path}\n" for path, digest in files.items() if "\n" not in path)
    with Folder.at(root, _FOLDER, create=True) as folder:
        folder.append(run, lines.encode())


def runs(root: Path) -> list[str]:
    """The folders of runs of which something is noted."""
    try:
        with Folder.at(root, _FOLDER) as folder:
            return folder.names()
    except OSError:
        return []


def read(root: Path, run: str) -> dict[str, str]:
    """What `add` noted of a run; a line that is no path inside of its folder is left out."""
    text = ""
    with contextlib.suppress(OSError, ValueError), Folder.at(root, _FOLDER) as folder:
        text = folder.read(run, _MOST).decode()
    found = {}
    for line in text.split("\n")[:-1]:  # the last one may be half of one
        match = _LINE.fullmatch(line)
        if match and all(part not in ("", ".", "..") for part in re.split(r"[/\\]", match[2])):
            found[match[2]] = match[1]
    return found


def forget(root: Path, run: str) -> None:
    """Remove the note of a run."""
    with contextlib.suppress(OSError), Folder.at(root, _FOLDER) as folder:
        folder.unlink_file(run)
