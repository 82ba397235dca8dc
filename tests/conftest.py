"""Fixtures and settings of all tests."""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import settings

from tests.annotations import check_annotations

T = TypeVar("T")

ROOT = Path(__file__).parents[1]
# the first one shows no windows, and so takes less
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")
CHROMIUM = next(filter(None, map(shutil.which, BROWSERS)), None)

# Numba sees edits in a kernel's own file only, not in those it calls: a digest of all kernels names its cache.
_kernels = b"".join(path.read_bytes() for path in sorted((ROOT / "stages" / "kernels").rglob("*.py")))
_digest = hashlib.sha256(_kernels).hexdigest()[:16]
os.environ.setdefault("NUMBA_CACHE_DIR", str(ROOT / ".pytest_cache" / f"kernels-{_digest}"))

check_annotations()

# Kernels for CUDA run in Numba's simulator; NUMBA_ENABLE_CUDASIM=0 runs them on a GPU.
os.environ.setdefault("NUMBA_ENABLE_CUDASIM", "1")

# What is compiled is kept, whatever this environment says: all processes that tests start load it, and each
# worker of pytest-xdist all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The key by which texloom knows its stores is not that of whoever runs the tests.
os.environ["XDG_CONFIG_HOME"] = str(ROOT / ".pytest_cache" / "config")

# A shell's background ignores SIGINT, and so would all runs that tests interrupt.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples every time, and no time limit: kernels compile at first use.
settings.register_profile("texloom", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("texloom")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A file's tests run in one worker, so that kernels which no other file needs are compiled once.

    Files come in the order of their names: by the number of tests, as is usual, those of few and long tests would
    come last, and leave workers idle.
    """
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_sessionstart() -> None:
    """Look for no circles of objects until all tests are collected, of which looking takes two fifths."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Look for circles of objects less often: a compiler makes many that stay; looking takes an eighth of it."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


def pytest_unconfigure() -> None:
    """Thaw what runs in this process have frozen: OpenImageIO complains at exit about what is not collected."""
    gc.unfreeze()


@pytest.fixture
def on_threads(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], T]], list[T]]:
    """Computes something with one thread and with three."""
    from tests.runs import run_with_threads  # not at the top: texloom must not be imported before Numba is set up

    return lambda compute: run_with_threads(compute, monkeypatch)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20150501)


@pytest.fixture
def gpu() -> None:
    """Skip the test where there is neither a GPU nor the simulator of CUDA."""
    from numba import config, cuda

    if not (config.ENABLE_CUDASIM or cuda.is_available()):
        pytest.skip("neither a CUDA GPU nor the simulator (NUMBA_ENABLE_CUDASIM=1)")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A headless Chromium: that of the system, or the one that Playwright has installed.

    Not for the whole session, because Playwright's event loop would run during other tests.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with playwright.sync_playwright() as started:
        own = Path(started.chromium.executable_path)
        if CHROMIUM is None and not own.exists():
            pytest.skip("no Chromium: `playwright install chromium`, or that of the system")
        browser = started.chromium.launch(executable_path=CHROMIUM or str(own), args=["--no-sandbox"])
        with contextlib.closing(browser):
            yield browser
