"""Settings of the documentation site: ``sphinx-build -W docs build/docs``."""

from __future__ import annotations

import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from make_reference import COPIES, write_reference  # noqa: E402

project = "texloom"
author = "the texloom authors"
project_copyright = f"{author}. MIT licence"
version = release = version_of("texloom")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["tour.ipynb", "gallery/*"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]
autodoc_typehints = "description"
default_role = "literal"
nitpicky = False

html_theme = "furo"
html_title = f"texloom {version}"
html_static_path = ["site.css"]
html_css_files = ["site.css"]

write_reference(HERE / "reference")


def link_copies(_app: Sphinx, page: str, content: list[str]) -> None:
    """Lead links to pages outside of docs to their copies."""
    up = "../" * page.count("/")
    for source, copy in COPIES.items():
        content[0] = content[0].replace(f"({up}../{source}", f"({up}reference/{copy}")


def move_descriptions(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Put the text after a parameter's name on a line of its own, where napoleon expects types after names."""
    moved: list[str] = []
    for line in lines:
        parameter = re.fullmatch(r"(\w+(?:, \w+)*) : (.+)", line)
        moved += [parameter[1], f"    {parameter[2]}"] if parameter else [line]
    lines[:] = moved


def setup(app: Sphinx) -> None:
    """Connect to Sphinx."""
    app.connect("source-read", link_copies)
    app.connect("autodoc-process-docstring", move_descriptions, priority=400)
