"""The name of a material, with which the files of a layout begin."""

from pathlib import Path

import numpy as np
import pytest

from texloom.pipelines.engine.opening import open_request
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.request import request
from texloom.stages.vocabulary.declare import InputError

FLOW = """
flow: part
sources:
  exemplar: FILE
steps:
  part: {stage: analysis.crop, inputs: {image: exemplar}, params: {size: 16}}
exports:
  maps/: part.image
"""
CODES = np.random.default_rng(3).integers(0, 256, (20, 20, 3)).astype(np.uint8)


def exported(folder: Path, source: str, **options: str) -> list[str]:
    """The names of the maps that a run with these options exports."""
    flow = folder / "flow.yaml"
    flow.write_text(FLOW.replace("FILE", source))
    run, out = open_request(request(flow=str(flow), out=folder / "out", store=folder / "store", **options))
    Preflight(run).check(out)
    execute(run, lambda _: None, out)
    return sorted(path.name for path in (folder / "out" / "maps").iterdir())


def test_files_of_a_layout_begin_with_the_name_that_is_given(tmp_path: Path) -> None:
    source = file_source(CODES, tmp_path)
    assert exported(tmp_path, source, layout="unreal", material="Old wall") == ["T_Old_wall_BC.png"]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"material": "wall"}, "^--material: needs a layout"),
        ({"material": "wall", "layout": "same"}, "^--material: needs a layout"),
        ({"material": "--", "layout": "unreal"}, "^--material: must have a letter or digit"),
    ],
)
def test_a_name_of_no_use_is_refused(tmp_path: Path, options: dict[str, str], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        exported(tmp_path, file_source(CODES, tmp_path), **options)
    assert not (tmp_path / "out").exists()


def test_one_name_for_a_set_is_refused(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        file_source(CODES, tmp_path / name)
    with pytest.raises(InputError, match=r"^--material: names one material"):
        exported(tmp_path, f"{{each: {tmp_path}/*/**.png}}", layout="unreal", material="wall")
