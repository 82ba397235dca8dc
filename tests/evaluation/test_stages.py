"""What stages ask of the runner."""

from __future__ import annotations

import pytest

from texloom.stages.lookup.registry import find_stage


@pytest.mark.parametrize(
    ("name", "optional"),
    [
        ("metrics", {"match", "copies", "keep", "generators"}),
        ("regularity", {"generators"}),
        ("compare", {"more"}),
        ("tabulate", {"more"}),
    ],
)
def test_scores_need_no_seed_and_little_besides_pictures(name: str, optional: set[str]) -> None:
    stage = find_stage(f"evaluation.{name}")
    assert stage.optional == optional
    assert not stage.uses_rng


@pytest.mark.parametrize(
    "name",
    ["compare", "tabulate", "timings", "comparison_report", "contour_report", "inverse_report"],
)
def test_what_gathers_a_set_takes_its_items_from_the_runner(name: str) -> None:
    stage = find_stage(f"evaluation.{name}")
    assert stage.uses_items
    assert "items" not in stage.inputs


@pytest.mark.parametrize("name", ["report", "comparison_report", "contour_report", "inverse_report", "timings"])
def test_reports_take_provenance_from_the_runner(name: str) -> None:
    assert find_stage(f"evaluation.{name}").uses_provenance
