"""The page over contours, features and guidance of a set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.evaluation.helpers import EVIL, load, pictures
from tests.synthetic import picture
from texloom.stages.evaluation.contour_report import ContourReportParams, contour_report
from texloom.stages.vocabulary.declare import InputError


def page(count: int, failed: int | None = None, detectors: tuple[str, ...] = ("one", "other")) -> str:
    """Left half of every exemplar is features, at distances of -7 and 7 px."""
    left = np.zeros((40, 60), bool)
    left[:, :30] = True
    field = np.where(left, np.float32(-7), np.float32(7))

    def column(value: Any) -> list[Any]:
        return [None if index == failed else value for index in range(count)]

    return contour_report(
        column(picture(np.random.default_rng(1).random((40, 60)))),
        {name: column(left.astype(np.float32)) for name in detectors},
        {name: column(left) for name in detectors},
        {name: column(field) for name in detectors},
        {name: column(3.0) for name in detectors},
        ContourReportParams(title=f"Set {EVIL}"),
        items=[{"name": f"t{index}{EVIL}", "sources": {"exemplar": EVIL}} for index in range(count)],
        provenance=[{"step": "edges", "item": "t0", "stage": "analysis.edges", "seconds": 1.5, "params": {}}],
    ).page


def test_every_detector_has_contours_features_and_guidance() -> None:
    html = page(3)
    assert "<script>alert" not in html
    assert html.count('class="thumb"') == 3 * (1 + 2 * 3)
    assert html.count("50 %") == 3 * 2
    assert html.count("7 px, weight 3") == 3 * 2


def test_pictures_show_contours_features_and_guidance() -> None:
    _, contours, features, guidance = (plane[20].astype(int) for plane in pictures(page(1, detectors=("one",))))
    assert contours[10].min() > 250
    assert contours[50].max() < 5
    assert features[10].tolist() == [255] * 3
    assert features[50].tolist() == [0] * 3
    assert guidance[10][2] > guidance[10][0]  # blue inside
    assert guidance[50][0] > guidance[50][2]  # red outside


def test_an_item_that_failed_leaves_the_others() -> None:
    html = page(3, failed=1)
    assert html.count('class="thumb"') == 2 * (1 + 2 * 3)
    assert html.count(">failed<") == 2 * 3


def test_lists_of_other_detectors_or_lengths_are_refused() -> None:
    image = picture(np.zeros((8, 8)))
    flat = np.zeros((8, 8), np.float32)
    with pytest.raises(InputError, match=r"structures is of b, strengths of a"):
        contour_report([image], {"a": [flat]}, {"b": [flat > 1]}, {}, {}, ContourReportParams())
    with pytest.raises(InputError, match=r"strengths.a has 2 entries, exemplars has 1"):
        contour_report([image], {"a": [flat] * 2}, {"a": []}, {"a": []}, {"a": []}, ContourReportParams())


def test_pictures_open_in_a_browser(tab: Any, tmp_path: Path) -> None:
    load(tab, page(2), tmp_path)
    tab.evaluate("document.querySelectorAll('.thumb')[5].click()")
    assert "features by other" in tab.evaluate("document.querySelector('dialog [data-name]').textContent")
