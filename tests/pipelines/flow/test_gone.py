"""Flow files of an earlier version: they load, or are refused by lines that say how they are written now."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.conftest import ROOT
from tests.pipelines.cli.test_main import assert_refused, texloom
from texloom.pipelines.flow.gone import FLOWS
from texloom.pipelines.flow.loader import check_flow, find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.stages.vocabulary.declare import InputError

EARLIER = sorted((Path(__file__).parent / "fixtures" / "flows_8744c2c").glob("*.yaml"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the pictures and documents that earlier flows name."""
    made = tmp_path_factory.mktemp("configs")
    for name in ("exemplars", "photographs"):
        shutil.copytree(ROOT / "configs" / name, made / name)
    return made


def corrected(document: dict[str, Any], place: str, problem: str) -> bool:
    """Do in a flow what the line of its refusal says; whether it says so."""
    *parents, last = place.split(".")
    value: Any = document
    for name in parents:
        value = value[name]
    if written := re.search(r"; write (\S+)$", problem):
        value[last] = yaml.safe_load(written[1])
        return True
    if problem.endswith("; leave it out"):
        del value[last]
        return True
    return False


@pytest.mark.parametrize("name", FLOWS)
def test_a_flow_that_is_gone_is_refused_with_the_command_that_replaces_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused(texloom("run", name, "my.png"), f"{name}: is another flow now, as in: texloom run ")
    flow, *words = shlex.split(FLOWS[name])
    sources = dict(word.split("=") for word in words if "=" in word)
    pictures = [word for word in words if "=" not in word and word != "--source"]
    load_flow(find_flow(flow), Overrides(sources=sources, pictures=pictures)).check_sources()
    (tmp_path / "mine.yaml").write_text(f"flow: mine\ninclude: {name}\n")
    with pytest.raises(InputError, match=f"mine.yaml: include: {name}: is another flow now"):
        load_flow(tmp_path / "mine.yaml")


@pytest.mark.parametrize("earlier", EARLIER, ids=lambda path: path.stem)
def test_an_earlier_flow_loads_or_says_how_it_is_written_now(earlier: Path, folder: Path) -> None:
    path = folder / earlier.name
    document = yaml.safe_load(earlier.read_text())
    for _ in range(5):
        try:
            check_flow(document, path)
        except InputError as error:
            line = str(error)
            assert "\n" not in line
            if "is another flow now, as in: texloom run" in line:
                return
            place, problem = line.removeprefix(f"{path}: ").split(": ", 1)
            assert corrected(document, place, problem), line
        else:
            return
    pytest.fail(f"still refused: {line}")


def test_an_output_that_is_gone(folder: Path) -> None:
    document = yaml.safe_load((ROOT / "configs" / "quilting.yaml").read_text())
    document["exports"]["wraps.json"] = "texture.tileable"
    with pytest.raises(InputError, match=r"exports.wraps.json: texture.tileable is gone: .*; leave it out"):
        check_flow(document, folder / "mine.yaml")
