"""The page on platforms has what its script writes."""

from __future__ import annotations

import runpy

import pytest

from tests.conftest import ROOT

SCRIPT = runpy.run_path(str(ROOT / "docs" / "resolve_platforms.py"))


@pytest.mark.parametrize("platform", SCRIPT["PLATFORMS"])
def test_every_platform_and_version_of_python_is_told(platform: str) -> None:
    rows = (ROOT / "docs" / "platforms.md").read_text().splitlines()
    told = [row.split("|")[2].split(",") for row in rows if row.startswith(f"| {platform} |")]
    assert sorted(version.strip() for versions in told for version in versions) == sorted(SCRIPT["VERSIONS"])
