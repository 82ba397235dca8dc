"""Objects of a shared store: few requests to an object storage, each tried again within a bounded time.

Any protocol of fsspec will do, such as S3; nothing is ever listed. A storage that does not answer is not asked for
a while, so that a run without a network goes on at its own pace.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import importlib.util
import os
import re
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from texloom.pipelines.errors import one_line, refused

T = TypeVar("T")

_URL = re.compile(r"([a-z][a-z0-9+.-]*)://([^\s?#]+)")
_TRIES = 3
_SECONDS = 5.0  # of a try
_RATE = 2**20  # bytes a second; a try that moves more takes so much longer
_PAUSE = 0.5  # seconds before the second try; twice as long before each later one
_REST = 60.0  # seconds in which a storage that has not answered is not asked
_PIECE = 2**25  # bytes of a request
_LOCAL = ("file", "local")


class RemoteError(Exception):
    """The storage does not answer, or permits no access; in words."""


class RestingError(RemoteError):
    """It has not been asked, as it did not answer before."""


class Remote:
    """A folder of an object storage."""

    def __init__(self, url: str):
        self.url = url
        self._rests_until = 0.0
        self._problem = ""

    @functools.cached_property
    def _opened(self) -> tuple[Any, str]:
        """The file system of fsspec, and the folder there."""
        import fsspec.core

        options = {"auto_mkdir": True} if self.url.partition(":")[0] in _LOCAL else {}
        files, path = fsspec.core.url_to_fs(self.url, **options)
        return files, path.rstrip("/")

    def read(self, name: str, start: int, end: int, size: int = 0) -> bytes | None:
        """The bytes of an object from ``start`` to before ``end``, or to its end; None if it is not there.

        ``size``: how many are expected, where they may take longer.
        """

        def request() -> bytes:
            files, path = self._opened
            try:
                return bytes(files.cat_file(f"{path}/{name}", start=start, end=end))
            except OSError as error:
                if error.errno == errno.EINVAL:  # of s3fs, where an object ends before the range
                    return b""
                raise

        try:
            return self._tried(request, size)
        except FileNotFoundError:
            return None

    def download(self, name: str, size: int, file: BinaryIO) -> str | None:
        """Write the first ``size`` bytes of an object into a file; their SHA-256, None if they are not there."""
        digest = hashlib.sha256()
        for start in range(0, size, _PIECE):
            end = min(size, start + _PIECE)
            piece = self.read(name, start, end, end - start)
            if piece is None or len(piece) != end - start:
                return None
            digest.update(piece)
            file.write(piece)
        return digest.hexdigest()

    def write(self, name: str, content: bytes, replace: bool = False) -> bool:
        """Write an object unless there is one, or in its place; whether it holds ``content`` now."""

        def request() -> None:
            files, path = self._opened
            files.pipe_file(f"{path}/{name}", content, mode="overwrite" if replace else "create")

        try:
            self._tried(request, len(content))
        except FileExistsError:  # perhaps by a try whose answer was lost
            return self.read(name, 0, len(content) + 1) == content
        except FileNotFoundError as error:  # as a bucket that is not there
            raise self._failed(error) from None
        return True

    def upload(self, name: str, path: Path, size: int, replace: bool = False) -> None:
        """Write a file of ``size`` bytes as an object named by its digest, unless there is one, or in its place."""

        def request() -> None:
            files, folder = self._opened
            files.put_file(str(path), f"{folder}/{name}", mode="overwrite" if replace else "create")

        try:
            self._tried(request, size)
        except FileExistsError:
            pass
        except FileNotFoundError as error:
            raise self._failed(error) from None

    def _tried(self, request: Callable[[], T], size: int) -> T:
        """What a request returns, on the second or third try if need be.

        Raises
        ------
        RemoteError : none has come to an end in time, or access is denied.
        FileNotFoundError, FileExistsError : the answer of the storage.
        """
        if self.outage:
            raise RestingError(self.outage)
        for number in range(_TRIES):
            try:
                return _within(_SECONDS + size / _RATE, request)
            except (FileNotFoundError, FileExistsError):
                raise
            except Exception as error:
                if number == _TRIES - 1 or isinstance(error, (PermissionError, ImportError)):
                    raise self._failed(error) from None
                time.sleep(_PAUSE * 2**number)
        raise AssertionError

    def _failed(self, error: Exception) -> RemoteError:
        """The error of a request that has failed for good."""
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        self.rest(one_line(f"{self.url}: {reason}"))
        return RemoteError(self._problem)

    @property
    def outage(self) -> str:
        """Why it is not asked now; empty where it is."""
        return self._problem if time.monotonic() < self._rests_until else ""

    def rest(self, problem: str) -> None:
        """Do not ask it for a while, as it has not answered here or in another process of the run."""
        self._problem, self._rests_until = problem, time.monotonic() + _REST


def _within(seconds: float, request: Callable[[], T]) -> T:
    """What ``request`` returns; `TimeoutError` after so many seconds, when nobody waits for it any longer."""
    future: Future[T] = Future()

    def work() -> None:
        try:
            future.set_result(request())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=work, name="texloom-remote", daemon=True).start()
    try:
        return future.result(seconds)
    except TimeoutError:
        if future.done():
            raise
        raise TimeoutError("no answer") from None


def remote_at(url: str) -> Remote:
    """The storage at ``url``, whose tasks in this process share whether it answers."""
    return _remote_of(url, os.getpid())


@functools.cache
def _remote_of(url: str, _process: int) -> Remote:
    return Remote(url)


def check_url(url: str, option: str) -> None:
    """`InputError` unless ``url`` names a folder of a storage that what is installed can reach; asks nobody."""
    if not url:
        raise refused(f"{option}: the value is empty")
    found = _URL.fullmatch(url)
    if "@" in url:  # it would be in reports and logs
        raise refused(f"{option}: an address holds no user or password; give those as the storage's variables say")
    if found is None or "::" in url:
        raise refused(f"{option} {url}: must be like s3://BUCKET/PREFIX")
    if importlib.util.find_spec("fsspec") is None:
        raise refused(f"{option} {url}: fsspec is not installed; pip install 'texloom[remote]'")
    from fsspec.registry import known_implementations, registry

    protocol = found[1]
    if protocol in registry:
        return
    if protocol not in known_implementations:
        raise refused(f"{option} {url}: fsspec knows no protocol {protocol}")
    module = known_implementations[protocol]["class"].partition(".")[0]
    if importlib.util.find_spec(module) is None:
        remedy = "texloom[remote]" if module == "s3fs" else module
        raise refused(f"{option} {url}: {module} is not installed; pip install '{remedy}'")
