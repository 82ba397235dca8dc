from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.browser import Tab, opened


@pytest.fixture(scope="package")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    """A browser, started once for all pages."""
    with opened(tmp_path_factory.mktemp("chromium")) as tab:
        yield tab
