"""What the page is told of a run at full size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.synthetic import tiles
from texloom.pipelines.studio import corrections, full_size_runs
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.work import InsightWork, Places, Ran, RunWork


@pytest.mark.parametrize(("fit", "of"), [("true", "exemplar.exr"), ("false", "")])
def test_corrections_take_what_was_scaled_and_origins_are_in_the_picture(
    fit: str, of: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    colors = tiles(rng)
    PIL.Image.fromarray(colors).save(tmp_path / "tiles.png")
    places = Places(folder=f"{tmp_path}", store=f"{tmp_path}/store", scratch=f"{tmp_path}/scratch")
    recipe = Recipe(
        flow="self_tuning", sources={"exemplar": "folder:tiles.png"}, size=(72, 72), tileable="both", seed=3,
        preset="fast", params={"scaled.fit": fit},
    )  # fmt: skip
    sent: list[tuple[Any, bytes]] = []

    def send(told: Any, payload: bytes = b"") -> None:
        sent.append((told, payload))

    full_size_runs.run(RunWork(recipe=recipe), places, lambda: None, send)
    ran = sent[-1][0]
    assert isinstance(ran, Ran)
    assert Path(ran.exemplar).name == of
    corrections.insight(InsightWork(recipe=recipe), places, send)
    row, column = np.moveaxis(np.frombuffer(sent[-1][1], np.uint16).reshape(72, 72, 2), 2, 0)
    made = np.asarray(PIL.Image.open(Path(ran.out) / "texture.png"))
    assert ((made[..., 0] < 90) == (colors[row, column, 0] < 90)).mean() > 0.85
