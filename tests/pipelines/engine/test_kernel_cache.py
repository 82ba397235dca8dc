"""Compiled kernels are kept on disk: a second process compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

RUN = """
import numpy as np
from texloom.stages.kernels.patchmatch import search
pixels = np.zeros((6, 12), np.int16)
match, found = np.zeros((3, 3), np.int32), np.zeros((3, 3), np.int64)
target = search.Target(pixels, match, match, found, found > 0)
search.match_distances(search.PatchShape.of(4, 2), target, pixels, 0, 3)
print(len(search.match_distances.stats.cache_hits), len(search.match_distances.stats.cache_misses))
"""


def test_a_second_process_compiles_nothing(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-c", RUN], env=environment, check=True, capture_output=True, text=True
        ).stdout
        for _ in range(2)
    ]
    assert [line.split() for line in said] == [["0", "1"], ["1", "0"]]
