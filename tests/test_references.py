"""Citations and the bibliography fit together."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for folder in ("stages", "pipelines") for path in (ROOT / folder).rglob("*.py"))
ENTRY = re.compile(r"^@(\w+)\{\s*([^,\s]+),(.*?)^\}", re.MULTILINE | re.DOTALL)
CITATION = re.compile(r"\[([A-Za-z]+\d{4}[a-z]?)\](_?)")

ENTRIES = {key: body for _, key, body in ENTRY.findall((ROOT / "stages" / "references.bib").read_text("utf-8"))}


@functools.cache
def cited(path: Path) -> set[str]:
    return {key for key, _ in CITATION.findall(path.read_text("utf-8"))}


def test_bibliography_is_read_whole() -> None:
    text = (ROOT / "stages" / "references.bib").read_text("utf-8")
    keys = re.findall(r"^@\w+\{\s*([^,\s]+),", text, re.MULTILINE)
    assert sorted(keys) == sorted(ENTRIES)
    assert len(keys) == len(set(keys)) > 0


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_citations_have_entries(path: Path) -> None:
    assert cited(path) <= set(ENTRIES)
    bare = [key for key, mark in CITATION.findall(path.read_text("utf-8")) if not mark]
    assert not bare, f"write [{bare[0]}]_" if bare else ""


@pytest.mark.parametrize("key", sorted(ENTRIES))
def test_entries_are_cited_and_complete(key: str) -> None:
    assert any(key in cited(path) for path in SOURCES)
    fields = set(re.findall(r"(\w+)\s*=\s*[{\d]", ENTRIES[key]))
    assert {"author", "title", "year"} <= fields
    assert fields & {"journal", "booktitle", "publisher", "institution", "school", "howpublished"}
    assert re.search(r"year\s*=\s*\{?(\d{4})", ENTRIES[key]).group(1) in key
