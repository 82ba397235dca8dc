"""The examples in docstrings of what a user meets first, and the notebook in docs."""

from __future__ import annotations

import doctest
import importlib
import operator
import warnings
from pathlib import Path

import pytest

from tests.conftest import ROOT

EXAMPLES = [
    "texloom.pipelines.api:synthesize",
    "texloom.pipelines.api:run",
    "texloom.pipelines.api:plan",
    "texloom.pipelines.results:Result",
    "texloom.pipelines.results:Texture.save",
    "texloom.stages.vocabulary.arrays:Image.of",
    "texloom.stages.lookup.direct:direct_call",
    "texloom.stages.interactive.canvas:Canvas",
    "texloom.stages.interactive.lattice_session:LatticeSession",
    "texloom.stages.interactive.photo_session:PhotoSession",
    "texloom.stages.analysis.structure.edges:edges",
    "texloom.stages.synthesis.stitching.quilting:quilting",
    "texloom.stages.synthesis.optimisation.optimise:optimise",
    "texloom.stages.evaluation.metrics:metrics",
]


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stores of the tests' own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXLOOM_STORE", str(tmp_path / "store"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs_as_shown(name: str) -> None:
    module = importlib.import_module(name.partition(":")[0])
    shown = operator.attrgetter(name.partition(":")[2])(module)
    tests = doctest.DocTestFinder(recurse=False).find(shown, name, module=module)
    assert [test for test in tests if test.examples], f"{name} has no example"
    assert not any(doctest.DocTestRunner().run(test).failed for test in tests), "see the output"


def test_notebook_runs(tmp_path: Path) -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    notebook = nbformat.read(ROOT / "docs" / "tour.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are stripped before a commit"
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Jupyter's own
        client.execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert not [output for output in outputs if output.output_type == "stream" and output.name == "stderr"]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert outputs[-1].text.endswith("did you mean 'occurrence'?\n")
