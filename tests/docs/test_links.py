"""Links between pages lead somewhere, and pictures are small."""

from __future__ import annotations

import urllib.parse
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.pages import DOCS, PAGES, anchors, blocks, label, links, script

MOST = 2 * 1024 * 1024
"""bytes of all pictures"""

NAMES = ("changelog", "command_line", "contributing", "conventions", "flows", "security", "stages", "store")
WRITTEN = {f"reference/{name}.md" for name in NAMES}
"""pages that the site's build writes"""


def relative_links(page: Path) -> list[str]:
    return [link for link in links(page) if not urllib.parse.urlparse(link).scheme]


@pytest.mark.parametrize("page", PAGES, ids=label)
def test_relative_links_lead_somewhere(page: Path) -> None:
    for link in relative_links(page):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if target.is_relative_to(DOCS) and target.relative_to(DOCS).as_posix() in WRITTEN:
            continue
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link


def test_the_site_has_every_page_that_its_pages_link_to() -> None:
    copies = {(ROOT / name).resolve() for name in script(DOCS / "make_reference.py").COPIES}
    pages = [page for page in PAGES if page.is_relative_to(DOCS)]
    targets = {(page.parent / link.partition("#")[0]).resolve() for page in pages for link in relative_links(page)}
    outside = {path for path in targets if path.suffix == ".md" and not path.is_relative_to(DOCS)}
    assert outside <= copies


def test_the_index_lists_every_page() -> None:
    index = DOCS / "index.md"
    listed = {(DOCS / link).resolve() for link in relative_links(index)}
    in_site = {f"{line}.md" for block in blocks(index) for line in block.text.splitlines()}
    pages = [page for page in PAGES if page.is_relative_to(DOCS) and page != index]
    assert not [label(page) for page in pages if page not in listed]
    assert not [label(page) for page in pages if page.relative_to(DOCS).as_posix() not in in_site]


def test_pages_of_the_reference_link_to_each_other(tmp_path: Path) -> None:
    module = script(DOCS / "make_reference.py")
    folder = tmp_path / "docs" / "reference"
    module.write_reference(folder)
    assert {path.relative_to(tmp_path / "docs").as_posix() for path in folder.glob("*.md")} == WRITTEN
    for page in folder.rglob("*.md"):
        for link in relative_links(page):
            target = (page.parent / link.partition("#")[0]).resolve()
            outside = DOCS / target.relative_to(tmp_path / "docs")
            assert target.exists() or outside.exists(), f"{page}: {link}"


def test_pictures_are_small_and_shown() -> None:
    pictures = [path for path in (DOCS / "pictures").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in pictures) <= MOST
    shown = {(page.parent / link).resolve() for page in PAGES for link in links(page)}
    assert not [path.relative_to(ROOT) for path in pictures if path not in shown]
