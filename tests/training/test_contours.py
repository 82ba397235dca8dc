"""Training as a whole, with a tiny plan."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.training.contours import MODEL, Plan, corners_of, train, train_tree
from benchmarks.training.model_file import write_model
from benchmarks.training.trees import Growth
from texloom.stages.analysis.structure import edges
from texloom.stages.analysis.structure.forest_files import read_opencv_forest

TINY = Plan(trees=4, pictures=4, patches=40, side=96, features=0.02, growth=Growth(min_samples=8, candidates=30))


def test_the_same_plan_gives_the_same_model(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_model(train(TINY, processes=1), tmp_path / f"{name}.yml.gz")
    content = (tmp_path / "a.yml.gz").read_bytes()
    assert content == (tmp_path / "b.yml.gz").read_bytes()
    step = np.zeros((64, 64, 3), np.float32)
    step[:, 32:] = 0.7
    strength = read_opencv_forest(tmp_path / "a.yml.gz").detect(step)
    assert np.isfinite(strength).all()
    assert strength.max() > 0


def test_the_model_is_written_where_the_stage_reads_it() -> None:
    assert MODEL.resolve() == edges.MODEL.resolve()


def test_every_tree_has_pictures_of_its_own() -> None:
    first, second = (train_tree(number, TINY) for number in (0, 1))
    assert first.features.tolist() != second.features.tolist()


def test_a_share_of_the_patches_has_a_contour_in_the_middle(rng: np.random.Generator) -> None:
    contours = np.zeros((96, 96), bool)
    contours[:, 50] = True
    corners = corners_of(contours, 40, 0.5, rng)
    assert (corners % 2 == 0).all()
    assert corners.max() <= 64
    middle = np.abs(corners[:, 1] + 15.5 - 50) < 2
    assert middle.sum() == 20
    assert len(corners_of(np.zeros((96, 96), bool), 40, 0.5, rng)) == 40
