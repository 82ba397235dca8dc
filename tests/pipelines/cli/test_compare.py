"""``texloom compare``: what it writes."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from tests.pipelines.cli.test_main import blobs, save, texloom

METHOD = """
sources: {exemplar: pictures/a.png}
steps:
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: SIZE, method: METHOD}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image, match: start.match}}
params: {size: start.size}
exports: {texture.png: start.image, scores.json: scores.table}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with two pictures and two methods of different sizes."""
    monkeypatch.delenv("TEXLOOM_STORE", raising=False)
    (tmp_path / "pictures").mkdir()
    for name, side in (("a", 48), ("b", 40)):
        save(tmp_path / "pictures" / f"{name}.png", blobs(side, side))
    for method, size in (("pixels", 40), ("blocks", 64)):
        text = METHOD.replace("METHOD", method).replace("SIZE", str(size))
        (tmp_path / f"{method}.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_report_is_a_page_a_table_and_a_spreadsheet(folder: Path) -> None:
    """The same inputs make the same bytes, wherever and whenever."""
    options = ["pixels.yaml", "blocks.yaml", "--over", "pictures/*.png", "--out", "out"]
    assert texloom("compare", *options, "--report", "one/page.html").code == 0
    shutil.rmtree(folder / "artifacts")
    assert texloom("compare", *options, "--store", "elsewhere", "--report", "two/page.html").code == 0
    names = ["page.csv", "page.html", "page.json"]
    assert sorted(path.name for path in (folder / "one").iterdir()) == names
    for name in names:
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes()

    table = json.loads((folder / "one/page.json").read_text())
    rows = list(csv.DictReader((folder / "one/page.csv").read_text().splitlines()))
    assert [row["method"] for row in rows] == [line["method"] for line in table["leaderboard"]]
    assert {row["method"]: float(row["fidelity"]) for row in rows} == table["axes"]["fidelity"]["means"]
    for row in rows:
        assert f"{float(row['score']):.2f}</b>" in (folder / "one/page.html").read_text()


def test_a_report_is_a_page(folder: Path) -> None:
    refused = texloom("compare", "pixels.yaml", "blocks.yaml", "--over", "pictures/*.png", "--report", "page.pdf")
    assert refused.code == 2
    assert "--report page.pdf: must be the name of an .html file" in refused.err
    assert not (folder / "artifacts").exists()


@pytest.mark.usefixtures("folder")
def test_scores_are_those_of_each_run_by_itself() -> None:
    options = ("--over", "pictures/*.png", "--size", 40)
    assert texloom("compare", "pixels.yaml", "blocks.yaml", *options, "--report", "page.html").code == 0
    table = json.loads(Path("page.json").read_text())
    for method in ("pixels", "blocks"):
        run = ("run", f"{method}.yaml", "--source", "exemplar=pictures/b.png", "--size", 40, "--out", method)
        assert texloom(*run).code == 0
        alone = json.loads(Path(method, "scores.json").read_text())
        compared = table["scores"][method][table["items"].index("b")]
        measures = {name: line["score"] for name, line in alone["measures"].items()}
        assert measures.items() <= compared["measures"].items()
        assert alone["summary"].items() <= compared["axes"].items()
