"""Compiled kernels are kept on disk: a second process compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

RUN = """
import numpy as np
from texloom.stages.kernels.patchmatch.search import count_moves
count_moves(np.zeros((1, 2), np.int64), np.zeros(4, np.int64))
print(len(count_moves.stats.cache_hits), len(count_moves.stats.cache_misses))
"""


def run(folder: Path, before: str = "", after: str = "") -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-c", before + RUN + after], env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done


def test_a_second_process_compiles_nothing_and_after_an_edit_of_any_kernel_all(tmp_path: Path) -> None:
    edited = "from texloom.stages.kernels.core import compiled\ncompiled.kernel_digest = lambda: 'of others'\n"
    counts = [run(tmp_path, before).stdout.split() for before in ("", "", edited)]
    assert counts == [["0", "1"], ["1", "0"], ["0", "1"]]


def test_processes_beside_one_another_share_what_they_compile(tmp_path: Path) -> None:
    """None adds to an entry of another."""
    beside = f"import subprocess, sys\nprint(subprocess.check_output([sys.executable, '-c', {RUN!r}], text=True))"
    taking = "from texloom.stages.kernels.core.kernel_folder import taken_folder\ntaken_folder()\n"
    assert run(tmp_path, before=taking + beside).stdout.split() == ["0", "1", "1", "0"]
    assert {path.relative_to(tmp_path).parts[0] for path in tmp_path.rglob("*.nbi")} == {"beside-1"}
    assert run(tmp_path, after=beside).stdout.split() == ["1", "0"] * 2


def test_where_nothing_can_be_kept_kernels_are_compiled_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = run(tmp_path / "file" / "kernels")
    assert done.stdout.split() == ["0", "1"]
    assert "compiled kernels cannot be kept in" in done.stderr
