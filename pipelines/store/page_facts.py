"""What a page says of the run that exports it."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping

_SLOT = re.compile(r'(<(\w+)[^<>]* data-run="(\w+)"[^<>]*>)[^<]*(?=</\2>)')


def with_run(page: str, facts: Mapping[str, str]) -> str:
    """Replace the text of each element with ``data-run="NAME"`` by the fact of that name, if it is known.

    A page is the same for all runs that lead to it, so that it is computed once; what differs between them, such as
    the picture's name and the command, is known when it is exported.
    """

    def filled(slot: re.Match[str]) -> str:
        fact = facts.get(slot[3])
        # names of files may have bytes that UTF-8 has not
        return slot[0] if fact is None else slot[1] + html.escape(fact).encode("utf-8", "replace").decode()

    return _SLOT.sub(filled, page)
