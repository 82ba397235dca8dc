"""How a browser is let in, and that nobody else is who reads command lines."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.printed import next_line
from tests.studio.conftest import ENVIRONMENT, TEXLOOM

LINE = r"http://127\.0\.0\.1:\d+/\?code=([\w-]{43})"


class Opened:
    """A studio that has opened a browser, which only notes what it is to open."""

    def __init__(self, folder: Path):
        self.temporary, noted = folder / "temporary", folder / "noted"
        self.temporary.mkdir()
        browser = folder / "browser"
        browser.write_text(f'#!/bin/sh\necho "$@" > {noted}.new && mv {noted}.new {noted}\n')
        browser.chmod(0o700)
        environment = {**ENVIRONMENT, "BROWSER": f"{browser} %s", "TMPDIR": str(self.temporary)}
        self.process = subprocess.Popen(
            [*TEXLOOM, "studio", str(folder), "--store", str(folder / "store")],
            stdout=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        self.printed = next_line(self.process).strip()
        deadline = time.monotonic() + 60
        while not noted.exists():
            assert time.monotonic() < deadline
            time.sleep(0.02)
        self.told = noted.read_text().strip()
        self.page = Path(self.told.removeprefix("file://"))


@pytest.fixture
def opened(page: None, tmp_path: Path) -> Iterator[Opened]:
    studio = Opened(tmp_path)
    with studio.process:
        yield studio
        studio.process.terminate()
    assert list(studio.temporary.iterdir()) == []


def command_lines() -> str:
    """Those of all processes, as any user of the machine can read them."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            lines.append(path.read_text(errors="replace"))
        except OSError:  # it has ended
            continue
    return "\n".join(lines)


@pytest.mark.skipif(os.name != "posix", reason="needs modes of files")
def test_nobody_can_read_what_the_browser_is_told(opened: Opened) -> None:
    codes = {match[1] for match in re.finditer(LINE, opened.page.read_text())}
    printed = re.fullmatch(LINE, opened.printed)
    assert printed
    assert len(codes) == 1
    assert stat.S_IMODE(opened.page.stat().st_mode) == 0o600
    assert stat.S_IMODE(opened.page.parent.stat().st_mode) == 0o700
    with urllib.request.urlopen(opened.printed) as answer:
        cookie = answer.headers["set-cookie"].partition(";")[0].partition("=")[2]
    lines = opened.told + command_lines()
    assert "texloom" in lines
    assert not [secret for secret in (*codes, printed[1], cookie) if secret in lines]
    assert opened.page.exists()  # for the browser, which may be slow


def test_a_browser_is_let_in_once(opened: Opened, chromium: Any) -> None:
    base = opened.printed.partition("?")[0]
    address = re.search(LINE, opened.page.read_text())
    assert address
    contexts = [chromium.new_context() for _ in range(3)]
    try:
        page = contexts[0].new_page()
        for start in (opened.told, base):  # the file that it was told; then reloaded, or in another tab
            page.goto(start)
            page.wait_for_url(base)
            page.get_by_role("tab", name="Make").wait_for()
        assert not opened.page.exists()
        [cookie] = contexts[0].cookies()
        assert (cookie["httpOnly"], cookie["sameSite"], cookie["path"]) == (True, "Strict", "/")
        assert cookie["expires"] == -1
        page.goto(opened.printed)  # though it needs none
        page.wait_for_url(base)

        other = contexts[1].new_page()
        other.goto(address[0])
        other.get_by_text("open the newest address in the terminal").wait_for()
        other.goto(opened.printed)
        other.wait_for_url(base)
        other.get_by_role("tab", name="Make").wait_for()

        third = contexts[2].new_page()
        newest = next_line(opened.process).partition("another browser: ")[2].strip()
        assert newest != opened.printed
        for start in (opened.printed, newest):
            answer = third.goto(start)
            assert answer.status == (200 if start == newest else 401)
        third.wait_for_url(base)
        third.get_by_role("tab", name="Make").wait_for()
    finally:
        for context in contexts:
            context.close()
