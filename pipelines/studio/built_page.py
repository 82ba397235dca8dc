"""The page that the server serves: files that are built from ``client`` when texloom is installed."""

from __future__ import annotations

from pathlib import Path

from texloom.stages.vocabulary.declare import InputError

BUILT = Path(__file__).parent / "page"
_CLIENT = Path(__file__).parent / "client"


def check_page() -> None:
    """`InputError` where the page has not been built, with what to do."""
    if (BUILT / "index.html").is_file():
        return
    if _CLIENT.is_dir():
        raise InputError(
            "the page of the studio has not been built; `pip install -e .` in the clone builds it if npm packages "
            f"can be downloaded, and so does `npm ci && npm run build` in {_CLIENT}"
        )
    raise InputError("the page of the studio is missing from this installation; install texloom again")
