"""Folders reached from a store's root without following a link, and files in them that are made exclusively.

Whoever can write into a folder can put a link there. Where the system has descriptors of folders, every step down
is opened by that of the folder above it and refuses links: nothing is read, written or removed elsewhere.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import importlib.util
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

CAN_LOCK = importlib.util.find_spec("fcntl") is not None
"""not on Windows, which moreover cannot rename an open file: there, its age tells that a file is abandoned"""
if CAN_LOCK:
    import fcntl

_HAS_HANDLES = (
    hasattr(os, "O_NOFOLLOW")
    and {os.open, os.mkdir, os.unlink, os.rmdir, os.rename, os.stat, os.link} <= os.supports_dir_fd
    and os.listdir in os.supports_fd
)
_CAN_TOUCH_LINKS = os.utime in os.supports_follow_symlinks
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_BINARY = getattr(os, "O_BINARY", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)
_FILE = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY | _NO_LINK
"""to open a pipe without O_NONBLOCK would wait for its writer"""
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | _BINARY | _NO_LINK
_LOCK = os.O_RDWR | os.O_CREAT | getattr(os, "O_NONBLOCK", 0) | _NO_LINK
_TEMPORARY = re.compile(r"\.new-[0-9a-f]{8}-.+")
_MAX_AGE = 7 * 86400  # seconds, of a temporary file where files are not locked
_TAIL = 32  # characters of a file's name that its temporary file has too, as programs look at the suffix
_PIECE = 2**20  # bytes that are read at a time


class LinkError(OSError):
    """A link, or another thing that is no folder, in place of a folder of the store."""

    def __init__(self, path: str):
        super().__init__(errno.ELOOP, "is a link, or no folder; texloom follows no links inside a store", path)


class Folder:
    """An open folder; close it, best by ``with``."""

    def __init__(self, path: str, handle: int | None):
        self.path = path
        self._handle = handle

    @classmethod
    def at(cls, root: str | Path, *names: str, create: bool = False) -> Folder:
        """The folder below ``root``, which may be a link itself; missing ones are made where ``create``.

        Raises
        ------
        LinkError : one of ``names`` is a link or no folder.
        OSError : there is no such folder.
        """
        if create:
            os.makedirs(root, exist_ok=True)  # noqa: PTH103 (as text, as there are thousands)
        folder = cls(os.fspath(root), os.open(root, _FOLDER) if _HAS_HANDLES else None)
        for name in names:
            with folder:
                folder = folder.child(name, create)
        return folder

    def child(self, name: str, create: bool = False) -> Folder:
        """A folder in this one; errors as of `at`."""
        if create:
            with contextlib.suppress(FileExistsError):
                self.mkdir(name)
        path = f"{self.path}/{name}"
        if _HAS_HANDLES:
            try:
                return Folder(path, os.open(name, _FOLDER | _NO_LINK, dir_fd=self._handle))
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.ENOTDIR):
                    raise LinkError(path) from None
                raise
        status = self.status(name)
        if status is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        if not stat.S_ISDIR(status.st_mode) or is_link(status):
            raise LinkError(path)
        return Folder(path, None)

    def __enter__(self) -> Folder:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _at(self, name: str) -> str:
        """How a file is called: by its name where there is a descriptor of this folder."""
        return name if _HAS_HANDLES else f"{self.path}/{name}"

    # -- looking

    def names(self) -> list[str]:
        """The names in this folder, of which there may be a million."""
        return os.listdir(self.path if self._handle is None else self._handle)  # noqa: PTH208

    def status(self, name: str) -> os.stat_result | None:
        """Of a file, folder or link itself; none where it is not there."""
        try:
            return os.stat(self._at(name), dir_fd=self._handle, follow_symlinks=False)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def time(self, name: str) -> float:
        """When it was written or touched, in seconds since 1970; 0 if it is not there."""
        status = self.status(name)
        return 0.0 if status is None else status.st_mtime

    def open(self, name: str) -> int:
        """A descriptor for reading a file; `ValueError` where it is something else."""
        handle = os.open(self._at(name), _FILE, dir_fd=self._handle)
        if stat.S_ISREG(os.fstat(handle).st_mode):
            return handle
        os.close(handle)
        raise ValueError("not a file")

    def read(self, name: str, most: int) -> bytes:
        """What a file holds; `ValueError` where it is larger than ``most`` bytes or no file."""
        with os.fdopen(self.open(name), "rb") as file:
            if os.fstat(file.fileno()).st_size > most:
                raise ValueError("too large")
            return file.read()

    def digest(self, name: str) -> str:
        """SHA-256 of what a file holds, 64 hexadecimal digits."""
        with os.fdopen(self.open(name), "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    # -- making

    def mkdir(self, name: str) -> None:
        """Make a folder; `FileExistsError` where something is there."""
        os.mkdir(self._at(name), dir_fd=self._handle)

    @contextlib.contextmanager
    def owned(self, tail: str, mode: int = 0o666) -> Iterator[tuple[str, int]]:
        """A new empty file for the ``with`` block, with a lock that the kernel gives back with the process.

        If the process is killed, `remove_abandoned` removes it. Its name and, where files are locked, a descriptor.
        """
        name, handle = self._owned(tail, mode)
        try:
            yield name, handle
        finally:
            self.unlink(name)
            if CAN_LOCK:
                os.close(handle)

    def _owned(self, tail: str, mode: int) -> tuple[str, int]:
        while True:
            name = f".new-{secrets.token_hex(4)}-{tail[-_TAIL:]}"
            handle = os.open(self._at(name), _NEW, mode, dir_fd=self._handle)
            if not CAN_LOCK:
                os.close(handle)
                return name, -1
            with contextlib.suppress(OSError):  # a file system without locks: then others cannot remove it either
                fcntl.flock(handle, fcntl.LOCK_EX)
            if os.fstat(handle).st_nlink:
                return name, handle
            os.close(handle)  # it was taken for abandoned before it was locked

    @contextlib.contextmanager
    def locked(self, name: str) -> Iterator[bool]:
        """Hold the lock that `filelock.FileLock` takes of a file, unless somebody has it; whether it is held.

        Only where `CAN_LOCK`. It takes a fifth of the time, which counts where a million results are removed.
        """
        handle = os.open(self._at(name), _LOCK, 0o644, dir_fd=self._handle)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
            try:
                yield os.fstat(handle).st_nlink > 0  # else its holder has just removed it
            finally:
                fcntl.flock(handle, fcntl.LOCK_UN)  # a process that was forked meanwhile has the handle too
        finally:
            os.close(handle)

    def write(self, name: str, content: bytes, durable: bool = False, beside: Folder | None = None) -> None:
        """Write a file, complete or not at all; if it is ``durable``, also after a power failure.

        Its temporary file is made here, or in the folder ``beside``, of the same file system.
        """
        folder = beside or self
        with named(f"{self.path}/{name}"), folder.owned(name) as (temporary, handle):
            folder.fill(temporary, handle, content, durable)
            folder.rename(temporary, name, self)

    def write_new(self, name: str, content: bytes, mode: int = 0o666) -> None:
        """Write a file, complete or not at all, unless there is one by now; then that stays."""
        with named(f"{self.path}/{name}"), self.owned(name, mode) as (temporary, handle):
            self.fill(temporary, handle, content, durable=True)
            try:
                os.link(
                    self._at(temporary), self._at(name), src_dir_fd=self._handle, dst_dir_fd=self._handle,
                    follow_symlinks=False,
                )  # fmt: skip
            except FileExistsError:
                pass
            except (OSError, NotImplementedError):  # a file system without hard links
                if self.status(name) is None:
                    self.rename(temporary, name)

    def fill(self, name: str, handle: int, content: bytes, durable: bool) -> None:
        """Write a file that `owned` has made."""
        handle = os.dup(handle) if CAN_LOCK else os.open(self._at(name), os.O_RDWR | _BINARY | _NO_LINK)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            if durable:
                os.fsync(file.fileno())

    def append(self, name: str, content: bytes) -> None:
        """Add to a file at once, which is made if need be."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | _BINARY | _NO_LINK
        handle = os.open(self._at(name), flags, 0o666, dir_fd=self._handle)
        try:
            os.write(handle, content)
        finally:
            os.close(handle)

    def rename(self, name: str, new: str, folder: Folder | None = None) -> None:
        """Rename a file or folder, also into another folder; a file or link of that name is replaced."""
        target = folder or self
        os.replace(self._at(name), target._at(new), src_dir_fd=self._handle, dst_dir_fd=target._handle)

    def touch(self, name: str, now: int | None = None) -> None:
        """Set the time of a file, in ns since 1970; by default to now."""
        now = time.time_ns() if now is None else now
        if _CAN_TOUCH_LINKS:
            os.utime(self._at(name), ns=(now, now), dir_fd=self._handle, follow_symlinks=False)
        else:
            os.utime(self._at(name), ns=(now, now))

    # -- removing

    def unlink(self, name: str) -> None:
        """Remove a file or link, if it is there."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self._at(name), dir_fd=self._handle)

    def unlink_file(self, name: str) -> None:
        """Remove a file, if it is there and nothing else than a file."""
        status = self.status(name)
        if status is not None and stat.S_ISREG(status.st_mode):
            self.unlink(name)

    def rmdir(self, name: str) -> bool:
        """Remove a folder if it is empty; whether it is gone."""
        with contextlib.suppress(OSError):
            os.rmdir(self._at(name), dir_fd=self._handle)
        return self.status(name) is None

    def remove(self, name: str) -> None:
        """Remove a file, a link, or a folder in which there is nothing, or only empty folders."""
        status = self.status(name)
        if status is None or not stat.S_ISDIR(status.st_mode):
            self.unlink(name)
            return
        with contextlib.suppress(OSError), self.child(name) as folder:
            for inner in folder.names():
                if not folder.rmdir(inner):
                    return
        self.rmdir(name)

    def remove_flat(self, name: str, is_ours: Callable[[str], object]) -> bool:
        """Remove of the files in a folder those that ``is_ours`` names, and the folder if it is empty then."""
        with contextlib.suppress(OSError), self.child(name) as folder:
            for file in folder.names():
                if is_ours(file):
                    folder.unlink_file(file)
        return self.rmdir(name)

    def remove_abandoned(self) -> list[str]:
        """Remove the temporary files that no living process holds; those that others hold are returned."""
        held = []
        for name in self.names():
            if _TEMPORARY.fullmatch(name):
                with contextlib.suppress(OSError):
                    if not self._remove_if_abandoned(name):
                        held.append(name)
        return held

    def _remove_if_abandoned(self, name: str) -> bool:
        if not CAN_LOCK:
            old = time.time() - self.time(name) > _MAX_AGE
            if old:
                self.unlink(name)
            return old
        handle = os.open(self._at(name), os.O_RDWR | _NO_LINK | os.O_NONBLOCK, dir_fd=self._handle)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.unlink(name)  # while it is locked, so that its owner cannot take it now
        except OSError:
            return False
        finally:
            os.close(handle)
        return True


def is_link(status: os.stat_result) -> bool:
    """Whether something is a link, or a junction of Windows, by its own status."""
    return stat.S_ISLNK(status.st_mode) or getattr(status, "st_reparse_tag", 0) != 0


@contextlib.contextmanager
def named(path: str | Path) -> Iterator[None]:
    """Name ``path`` in an `OSError` that names no file, as that of a full disk."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None
