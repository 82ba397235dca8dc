"""``texloom compare``: what it writes."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.cli.test_main import blobs, save, texloom
from tests.pipelines.media.test_material_export import saved

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
    monkeypatch.setenv("TEXLOOM_STORE", "store")
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
    shutil.rmtree(folder / "store")
    assert texloom("compare", *options, "--store", "elsewhere", "--force", "--report", "two/page.html").code == 0
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
    assert not (folder / "store").exists()


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


# -- results of other programs


@pytest.fixture
def theirs(folder: Path) -> Path:
    """Results that another program made, and one more."""
    (folder / "theirs").mkdir()
    for seed, name in enumerate("abz"):
        save(folder / "theirs" / f"{name}.png", blobs(40, 50 + seed))
    (folder / "theirs" / "a.json").write_text("{}")
    return folder / "theirs"


OVER = ("--over", "pictures", "--size", 40, "--report", "page.html")


@pytest.mark.usefixtures("theirs")
def test_pictures_of_another_program_are_judged_alike() -> None:
    """By the scores that they have by themselves, in the same table and on the same page."""
    assert texloom("compare", "pixels.yaml", *OVER, "--against", "other=theirs", "--out", "out").code == 0
    table = json.loads(Path("page.json").read_text())
    assert table["methods"] == ["pixels", "other"]
    origins = {line["method"]: line["origin"] for line in table["leaderboard"]}
    assert origins == {"pixels": None, "other": "pictures in theirs"}
    assert "pictures in theirs" in Path("page.html").read_text()
    assert {"contents", "continuity"} <= set(table["partial"])  # pictures that are no copies
    assert table["estimated"] == {"other": ["copying"]}
    assert "For other, estimated from the pixels: copying." in Path("page.html").read_text()
    sources = ("--source", "exemplar=pictures/b.png", "--source", "picture=theirs/b.png")
    assert texloom("run", "score", *sources, "--size", 40, "--out", "b").code == 0
    np.testing.assert_array_equal(saved(Path("b/texture.png")), saved(Path("out/b/other.png")))
    alone = json.loads(Path("b/scores.json").read_text())
    compared = table["scores"]["other"][table["items"].index("b")]
    assert {name: line["score"] for name, line in alone["measures"].items()}.items() <= compared["measures"].items()
    assert "In 1 row" not in Path("page.html").read_text()


@pytest.mark.usefixtures("theirs")
@pytest.mark.parametrize("over", ["pictures", "pictures/a.png"])
def test_folders_alone_are_compared(over: str) -> None:
    shutil.copytree("theirs", "ours")
    pair = ("--against", "other=theirs", "--against", "ours=ours")
    assert texloom("compare", "--over", over, *pair, "--seeds", 2, "--report", "page.html").code == 0
    table = json.loads(Path("page.json").read_text())
    assert table["methods"] == ["other", "ours"]
    assert table["overall"]["pairs"][0]["ties"] == len(table["exemplars"]) == (2 if over == "pictures" else 1)


@pytest.mark.usefixtures("theirs")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--against", "other=gone"], "--against other=gone: gone is not a folder"),
        (["--against", "Other=theirs"], "--against Other=theirs: the name must begin with a small letter"),
        (["--against", "other=few"], "no picture called 'b'; there must be one for each exemplar"),
        (["--against", "other=twice"], "2 pictures called 'a'; there must be one for each exemplar"),
        (["--against", "pixels=theirs", "--against", "pixels=theirs"], "'pixels' is given twice"),
        (["theirs"], "theirs is a folder; give finished pictures with --against NAME=theirs"),
        ([], "at least two methods are needed"),
    ],
)
def test_folders_that_cannot_be_compared(folder: Path, options: list[str], message: str) -> None:
    shutil.copytree("theirs", "few", ignore=shutil.ignore_patterns("b.png"))
    shutil.copytree("theirs", "twice")
    shutil.copy("theirs/a.png", "twice/a.bmp")
    refused = texloom("compare", "pixels.yaml", *OVER, *options)
    assert refused.code == 2
    assert message in refused.err
    assert not (folder / "store").exists()


@pytest.mark.usefixtures("theirs")
@pytest.mark.parametrize(
    ("other", "over", "message"),
    [
        ("blocks.yaml", "gone", "gone: no such file"),
        ("blocks.yaml", "few", "few: is a folder without pictures"),
        ("blocks.yaml", "gone/*.png", "no file or map set matches"),
        ("--against=other=theirs", "gone/*.png", "no file or map set matches"),
    ],
)
def test_exemplars_that_are_not_there_are_named_by_the_option(other: str, over: str, message: str) -> None:
    Path("few").mkdir()
    refused = texloom("compare", "pixels.yaml", other, "--over", over)
    assert refused.code == 2
    assert refused.err.startswith("texloom: --over: ")
    assert message in refused.err


@pytest.mark.usefixtures("theirs")
@pytest.mark.parametrize(
    ("size", "message"),
    [("44", "the result must have at least 44 x 44 px"), ("51x40", "must have at least 51 x 40 px")],
)
def test_pictures_that_are_too_small_are_named(size: str, message: str) -> None:
    options = ("--over", "pictures", "--size", size, "--against", "other=theirs")
    failed = texloom("compare", "pixels.yaml", *options)
    assert failed.code == 1
    assert message in failed.err
    assert "theirs/a.png" in failed.err
