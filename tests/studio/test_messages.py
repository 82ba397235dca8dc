"""The types of the page are those of the server."""

from __future__ import annotations

import pytest

from texloom.pipelines.studio.messages import PreviewFailed, packed, unpacked
from texloom.pipelines.studio.typescript import FILE, types


def test_the_types_of_the_page_are_current() -> None:
    assert FILE.read_text() == types(), "python -m texloom.pipelines.studio.typescript"


def test_messages_come_out_as_they_went_in() -> None:
    message = PreviewFailed(number=3, problem="é")
    header, payload = unpacked(packed(message, b"pixels"))
    assert PreviewFailed.model_validate_json(header) == message
    assert bytes(payload) == b"pixels"


@pytest.mark.parametrize("frame", [b"", b"\0\0", b"\x05\0\0\0{}"])
def test_cut_messages_are_refused(frame: bytes) -> None:
    with pytest.raises(ValueError, match="message"):
        unpacked(frame)
