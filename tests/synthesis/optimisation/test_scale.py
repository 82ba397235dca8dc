"""Iterations of several results at one scale."""

from collections.abc import Callable

import numpy as np
import pytest

from texloom.stages.synthesis.optimisation.scale import Rounds, Scale, improve_all
from texloom.stages.vocabulary.arrays import Image

SCALE = Scale(1, 1.0, (8, 8), (5, 5), (8, 8), (5, 5), iterations=7)


def rounds(settled: int, closed: list[int]) -> Rounds:
    """Iterations that change nothing from the ``settled``-th on."""
    try:
        for number in range(1, 100):
            yield 10.0 / number, float(number), 0.0 if number >= settled else 0.5
    finally:
        closed.append(settled)


@pytest.mark.parametrize("threads", ["1", "2", "5"])
@pytest.mark.parametrize("settled", [[3], [3, 4, 99], [99, 1, 2, 6]])
def test_results_end_each_by_itself(settled: list[int], threads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", threads)
    closed: list[int] = []
    previews: list[Callable[[], Image]] = [lambda: Image(np.zeros((8, 8, 3), np.float32))] * len(settled)
    records = improve_all([rounds(one, closed) for one in settled], SCALE, [SCALE], 0.1, previews)
    last = [min(one, SCALE.iterations) for one in settled]
    assert [record["rounds"] for record in records] == last
    assert [record["energy"] for record in records] == [10.0 / number for number in last]
    assert sorted(closed) == sorted(settled)
