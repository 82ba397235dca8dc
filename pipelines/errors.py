"""Words of errors: one line each, with the nearest right word."""

from __future__ import annotations

import difflib
import errno
from collections.abc import Iterable
from typing import Any

from texloom.stages.vocabulary.declare import InputError

_LONGEST = 80  # characters of a value in an error
_LONGEST_LINE = 2000  # characters of an error
_MOST_NAMED = 24  # of what there is
_INSUFFICIENT_MEMORY = -4  # of OpenCV
_UNREACHABLE = {
    errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.ENOTCONN, errno.ENODEV, errno.EHOSTDOWN, errno.EHOSTUNREACH,
}  # fmt: skip


def one_line(text: str) -> str:
    """``text`` with line breaks and whatever else cannot be printed as escapes, cut where it is very long."""
    text = text if len(text) <= _LONGEST_LINE else f"{text[:_LONGEST_LINE]}..."
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else ascii(character)[1:-1] for character in text)


def refused(problem: str) -> InputError:
    """The error of a wrong request."""
    return InputError(one_line(problem))


def shown(value: Any) -> str:
    """A value as it came, cut where it is long."""
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


class NoWorkersError(OSError):
    """The workers of a run do not start; in words."""


class UnreachableError(OSError):
    """A disk that does not answer, or a folder that was there and is not any more; in words."""


def is_unreachable(error: BaseException | None) -> bool:
    """Whether a disk or mount does not answer, which may pass."""
    return isinstance(error, UnreachableError) or (isinstance(error, OSError) and error.errno in _UNREACHABLE)


def is_resource_error(error: BaseException | None) -> bool:
    """Whether a disk, file or memory failed, and not the program: then a traceback helps nobody."""
    return isinstance(error, (OSError, MemoryError)) or _is_lack_of_memory(error)


def _is_lack_of_memory(error: BaseException | None) -> bool:
    """Whether it is that of OpenCV, which is no `MemoryError`; without importing that."""
    is_of_opencv = type(error).__module__ == "cv2"
    return is_of_opencv and (getattr(error, "code", 0) == _INSUFFICIENT_MEMORY or str(error) == "std::bad_alloc")


def format_error(error: BaseException | None) -> str:
    """An exception in words."""
    if isinstance(error, AttributeError) and getattr(error.obj, "__name__", "") == "cv2":
        return f"OpenCV is not whole ({error}); `texloom doctor` tells the remedy"
    if _is_lack_of_memory(error):
        return "not enough memory"
    return str(error) or "not enough memory" if is_resource_error(error) else repr(error)


def closest(word: str, known: Iterable[str]) -> str:
    """A hint at the nearest right word, or nothing."""
    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{found[0]}'?" if found else ""


def one_of(known: Iterable[str]) -> str:
    """A hint at all that there is, of many at the first of them."""
    names = list(known)
    if not names:
        return ""
    more = len(names) - _MOST_NAMED
    told = [*names[:_MOST_NAMED], f"{more} more"] if more > 1 else names
    return f"; there {'is' if len(names) == 1 else 'are'} {', '.join(told)}"


def hint(word: str, known: Iterable[str]) -> str:
    """A hint at the nearest right word, else at all that there is."""
    names = list(known)
    return closest(word, names) or one_of(names)
