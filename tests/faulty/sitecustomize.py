"""Makes a store's folder slow or unreachable, and the clock jump, for processes with this folder in their path.

``FAULTY`` names a folder with the faults that hold at the moment, each a file: ``slow`` with seconds for each call,
``gone`` with the number of the error that each call ends with, ``clock`` with seconds by which it is wrong.
``FAULTY_STORE`` is the store. What a library in C opens is not slow, and is not gone.
"""

import builtins
import contextlib
import functools
import io
import os
import time

_FAULTS, _STORE = os.environ.get("FAULTY", ""), os.environ.get("FAULTY_STORE", "")
_NAMES = (
    "access", "link", "listdir", "lstat", "mkdir", "open", "remove", "rename", "replace", "rmdir", "scandir",
    "stat", "unlink", "utime",
)  # fmt: skip
_open, _sleep, _readlink = builtins.open, time.sleep, os.readlink


def _fault(name):
    """What the file of a fault says; None where it does not hold."""
    try:
        with _open(f"{_FAULTS}/{name}") as file:
            return float(file.read() or 0)
    except (OSError, ValueError):
        return None


def _is_in_store(path, folder):
    with contextlib.suppress(OSError, TypeError, ValueError):
        if isinstance(path, int):
            path = _readlink(f"/proc/self/fd/{path}")
        elif folder is not None:
            path = f"{_readlink(f'/proc/self/fd/{folder}')}/{os.fspath(path)}"
        return os.fsdecode(path).startswith(_STORE)
    return False


def _faulty(function):
    @functools.wraps(function)
    def call(path=".", *arguments, **options):
        if _is_in_store(path, options.get("dir_fd", options.get("src_dir_fd"))):
            _sleep(_fault("slow") or 0)
            if (number := _fault("gone")) is not None:
                raise OSError(int(number), os.strerror(int(number)), str(path))
        return function(path, *arguments, **options)

    for kinds in (os.supports_dir_fd, os.supports_fd, os.supports_follow_symlinks, os.supports_effective_ids):
        if function in kinds:
            kinds.add(call)
    return call


if _STORE:
    for _name in _NAMES:
        setattr(os, _name, _faulty(getattr(os, _name)))
    builtins.open = io.open = _faulty(_open)
if _FAULTS:
    _time, _time_ns = time.time, time.time_ns
    time.time = lambda: _time() + (_fault("clock") or 0)
    time.time_ns = lambda: _time_ns() + int(1e9 * (_fault("clock") or 0))
