"""Make textures from another program by `texloom serve`: one file for Python 3.9 and later, without dependencies.

    client = Client()                       # finds texloom; starts it when it is first needed
    run = client.submit("self_tuning", {"exemplar": "mine.png"}, size=1024, tileable="both")
    while not run.poll().has_ended:         # or submit(..., callback=tell), or nothing at all
        ...                                 # the host goes on
    picture = run.wait().maps["albedo"]     # Pixels; picture.numpy() where there is NumPy
    client.close()

Nothing here blocks but `wait` and `close`. MIT licence; `texloom client` writes this file.
"""

from __future__ import annotations

import atexit
import collections
import contextlib
import fnmatch
import http.client
import json
import os
import shutil
import subprocess
import sys
import threading
import time
import urllib.parse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Union

PROTOCOL = 1
_ATTEMPTS = 3  # at a run whose server ends, each with a new server
_STARTING = 120.0  # seconds until a server that was started has to answer
_ENDING = 5.0
_WAITING = 10.0  # seconds of a request that waits for changes
_ANSWERING = 60.0  # seconds of any other
_LINES = 20  # of what the server has printed, for a problem


class TexloomError(Exception):
    """What went wrong, in one line."""


class CancelledError(TexloomError):
    """The run was cancelled."""


class _LostError(Exception):
    """The server does not answer any more."""


class Pixels(NamedTuple):
    """A picture in memory: rows from the top, channels last, little-endian."""

    data: bytes
    shape: tuple[int, ...]
    """height, width, and 1, 3 or 4 channels, or none of these"""
    dtype: str
    """uint8, uint16 or float32"""
    color_space: str = ""
    """srgb of integers, linear of floats, which "" stands for; maps such as normals are data whatever this says"""

    @classmethod
    def of(cls, array: Any) -> Pixels:
        """The picture in a NumPy array, or in what has its ``shape``, ``dtype`` and ``tobytes``."""
        if isinstance(array, Pixels):
            return array
        if getattr(array.dtype, "byteorder", "=") == ">" or (sys.byteorder == "big" and array.dtype.itemsize > 1):
            array = array.astype(array.dtype.newbyteorder("<"))
        return cls(array.tobytes(), tuple(array.shape), str(array.dtype.name))

    def numpy(self) -> Any:
        """The same as a NumPy array."""
        import numpy as np

        return np.frombuffer(self.data, np.dtype(self.dtype).newbyteorder("<")).reshape(self.shape)


class Status(NamedTuple):
    """How far a run is."""

    state: str = "starting"
    """starting, waiting, running; done, failed, cancelled"""
    step: str = ""
    text: str = ""
    """for a person: how long it takes, or why it has failed"""
    done: float = 0.0
    """share of the step, 0..1"""

    @property
    def has_ended(self) -> bool:
        """Whether nothing will change any more."""
        return self.state in ("done", "failed", "cancelled")


class RunResult(NamedTuple):
    """What a run has made."""

    maps: dict[str, Pixels]
    """the main picture by ``albedo``, or all maps of a material, in the dtype of what was sent"""
    files: dict[str, bytes]
    """the exports that were asked for"""
    names: tuple[str, ...]
    """all exports"""
    notes: tuple[str, ...]
    """what a person is to be told: what was guessed, clipped or left out"""
    scores: dict[str, float]


Source = Union[str, os.PathLike, bytes, Pixels, Any, Mapping[str, Any]]
"""a path; `Pixels` or a NumPy array; (name, bytes) of a file; the maps of a material, name to one of the two; a
list of several, where a flow takes a set"""


class RunHandle:
    """A run, which goes on in a thread of its own."""

    def __init__(
        self, client: Client, asked: dict[str, Any], sources: Mapping[str, Source],
        before: threading.Event, asking: threading.Event, **how: Any,
    ):  # fmt: skip
        self._before, self._asking = before, asking
        self._client, self._asked, self._sources = client, asked, dict(sources)
        self._callback: Callable[[RunHandle], None] | None = how["callback"]
        self._files: Sequence[str] = how["files"]
        self._previews: bool = how["previews"]
        self._ended, self._is_cancelled = threading.Event(), threading.Event()
        self._status = Status()
        self._preview: Pixels | None = None
        self._result: RunResult | None = None
        self._id = ""
        threading.Thread(target=self._work, name="texloom run", daemon=True).start()

    def poll(self) -> Status:
        """How far it is, at once."""
        return self._status

    def preview(self) -> Pixels | None:
        """The latest picture of what it has made so far, R G B A, at once."""
        return self._preview

    def cancel(self) -> None:
        """Cancel it, which `poll` tells a little later; finished steps are kept."""
        self._is_cancelled.set()
        if self._id and not self._ended.is_set():
            threading.Thread(target=self._delete, daemon=True).start()

    def wait(self, timeout: float | None = None) -> RunResult:
        """The result, once it is there.

        Raises
        ------
        TimeoutError : it is not there after ``timeout`` seconds.
        CancelledError, TexloomError : it was cancelled, or has failed.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError("the texture is not there yet")
        if self._result is not None:
            return self._result
        raise (CancelledError if self._status.state == "cancelled" else TexloomError)(self._status.text)

    def _set(self, status: Status) -> None:
        self._status = status
        if status.has_ended:
            self._ended.set()
        if self._callback is not None:
            self._callback(self)

    def _work(self) -> None:
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                end = self._once()
                break
            except TexloomError as error:
                end = Status("failed", self._status.step, str(error))
                break
            except _LostError as error:
                end = Status("failed", self._status.step, f"the server has ended, {attempt} times: {error}")
                if self._is_cancelled.is_set():
                    end = Status("cancelled", text="cancelled")
                    break
                self._set(Status(text="the server has ended; it is started again"))
                time.sleep(0.2 * attempt)
            except Exception as error:
                end = Status("failed", self._status.step, " ".join(f"{type(error).__name__}: {error}".split()))
                break
            finally:
                self._asking.set()
        self._set(end)

    def _once(self) -> Status:
        """Do all of it with one server; how it ended."""
        sent = {name: self._sent(given) for name, given in self._sources.items()}
        if self._is_cancelled.is_set():
            return Status("cancelled", text="cancelled")
        body = json.dumps({**self._asked, "sources": sent}).encode()
        self._before.wait()  # runs are made in the order in which they were submitted
        now = self._client._json("POST", "/runs", body)
        self._id = now["id"]
        self._asking.set()
        if self._is_cancelled.is_set():
            self._delete()
        seen = 0
        while not (status := Status(now["state"], now["step"], now["text"], now["done"])).has_ended:
            if self._previews and now["previews"] > seen:
                seen, self._preview = now["previews"], self._client._pixels(f"/runs/{self._id}/preview")
            self._set(status)
            path = f"/runs/{self._id}?seen={now['changes']}&seconds={_WAITING}"
            now = self._client._json("GET", path)
        if status.state == "done":
            self._result = self._fetched(now)
        self._delete()  # the server need not keep it
        return status

    def _sent(self, given: Source) -> Any:
        """Send the pictures of a source; what stands for it in the request."""
        if isinstance(given, list):
            return [self._sent(one) for one in given]
        if isinstance(given, Mapping):
            return {"maps": {name: self._client._send(one) for name, one in given.items()}}
        if isinstance(given, (str, os.PathLike)):
            path = os.fspath(given)
            return os.path.abspath(path) if os.path.exists(path) else path  # noqa: PTH100, PTH110
        return {"picture": self._client._send(given)}

    def _fetched(self, now: Mapping[str, Any]) -> RunResult:
        place, quote = f"/runs/{self._id}", urllib.parse.quote
        wanted = {asked: fnmatch.filter(now["files"], asked) for asked in self._files}
        if lacking := [asked for asked, names in wanted.items() if not names]:
            raise TexloomError(f"{lacking[0]}: the run exports {', '.join(now['files']) or 'nothing'}")
        maps = {one["name"]: self._client._pixels(f"{place}/maps/{quote(one['name'])}") for one in now["maps"]}
        named = [name for names in wanted.values() for name in names]
        files = {name: self._client._request("GET", f"{place}/files/{quote(name)}")[1] for name in named}
        return RunResult(maps, files, tuple(now["files"]), tuple(now["notes"]), now["scores"])

    def _delete(self) -> None:
        with contextlib.suppress(TexloomError, _LostError):  # it is gone already
            self._client._request("DELETE", f"/runs/{self._id}")


class Client:
    """A connection to texloom, which is started when it is first needed, and again when it has ended."""

    def __init__(
        self, command: str | Sequence[str] | None = None, *, store: str | None = None, address: str = "",
        token: str = "",
    ):  # fmt: skip
        """Connect later.

        Parameters
        ----------
        command : texloom, where `find_texloom` would not find the right one.
        store : folder of its results; the default is texloom's.
        address, token : of a server that runs already, as `texloom serve` prints them; none is started then.
        """
        self._command, self._store = command, store
        self._server = (address, token)
        self._is_theirs = bool(address)
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = False
        self._lock = threading.Lock()
        self._order = threading.Lock()
        self._asking = threading.Event()  # set once the latest run was asked for
        self._asking.set()
        self._said: collections.deque[str] = collections.deque(maxlen=_LINES)
        atexit.register(self.close)

    def submit(
        self, flow: str, sources: Mapping[str, Source], params: Mapping[str, Any] | None = None, *,
        callback: Callable[[RunHandle], None] | None = None, files: Sequence[str] = (), previews: bool = True,
        **options: Any,
    ) -> RunHandle:  # fmt: skip
        """Begin a run, at once.

        Parameters
        ----------
        flow : its name, as ``texloom flows`` lists them, or the path of a YAML file.
        sources : name to `Source`. Arrays must not be changed until the run has ended.
        params : of the flow, or of a step: ``{"STEP.PARAM": value}``.
        callback : called with the run whenever its status changes, from another thread.
        files : the exports whose bytes are wanted, such as ``texture.exr``, or patterns, as ``maps/*``.
        previews : whether `RunHandle.preview` is wanted.
        options : size, tileable, preset, seed, crop, reduce, layout, texel_size, as of ``texloom run``.
        """
        asked = {"flow": flow, "params": dict(params or {}), **options}
        asking = threading.Event()
        with self._order:
            before, self._asking = self._asking, asking
        return RunHandle(self, asked, sources, before, asking, callback=callback, files=files, previews=previews)

    def hello(self) -> dict[str, Any]:
        """The version of texloom and its flows; this waits for the server."""
        try:
            return dict(self._json("GET", "/hello"))
        except _LostError as error:
            raise TexloomError(f"the server does not answer: {error}") from None

    def close(self) -> None:
        """End the server that was started here, with what it does."""
        atexit.unregister(self.close)
        with self._lock:
            self._is_closed = True
            process, self._process = self._process, None
            if process is not None:
                _end(process)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- the server

    def _ready(self) -> tuple[str, str]:
        """Address and token of a server that runs."""
        with self._lock:
            if self._is_closed:
                raise TexloomError("the client is closed")
            if not self._is_theirs and (self._process is None or self._process.poll() is not None):
                if self._process is not None:
                    _end(self._process)
                self._process = None
                self._server = self._started()
            return self._server

    def _started(self) -> tuple[str, str]:
        command = [*find_texloom(self._command), "serve", "--attached"]
        command += ["--store", self._store] if self._store else []
        # The host's Python is another one.
        environment = {
            name: value for name, value in os.environ.items() if name not in ("PYTHONHOME", "PYTHONPATH")
        }
        flags = 0x08000000 if os.name == "nt" else 0  # without a console window
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(  # noqa: S603
                command, stdin=pipe, stdout=pipe, stderr=pipe, env=environment, creationflags=flags
            )
        except OSError as error:
            raise TexloomError(f"{command[0]}: {error.strerror}") from None
        self._said.clear()
        lines: collections.deque[bytes] = collections.deque(maxlen=1)
        printed = threading.Event()

        def listen() -> None:
            assert process.stdout is not None
            with process.stdout:
                lines.append(process.stdout.readline())
                printed.set()
                collections.deque(process.stdout, 0)

        def read_problems() -> None:
            assert process.stderr is not None
            with process.stderr:
                for line in process.stderr:
                    self._said.append(line.decode(errors="replace").strip())

        threads = [threading.Thread(target=one, daemon=True) for one in (listen, read_problems)]
        for one in threads:
            one.start()
        printed.wait(_STARTING)
        try:
            told = json.loads(lines[0])
            protocol, server = told["protocol"], (told["address"], told["token"])
        except (ValueError, IndexError, KeyError, TypeError):
            _end(process, 0)
            threads[1].join(_ENDING)
            problem = next((line for line in reversed(self._said) if line), "it says nothing")
            raise TexloomError(f"{command[0]} serve does not start: {problem}") from None
        if protocol != PROTOCOL:
            _end(process, 0)
            raise TexloomError(
                f"texloom {told.get('version')} speaks protocol {protocol}, this file {PROTOCOL}; "
                "write it anew: texloom client > texloom_client.py"
            )
        self._process = process
        return server

    def _request(
        self, method: str, path: str, body: Any = None, kind: str = "application/octet-stream"
    ) -> tuple[Any, bytes]:
        """Headers and content of an answer."""
        address, token = self._ready()
        place = urllib.parse.urlsplit(address)
        connection = http.client.HTTPConnection(place.hostname or "", place.port, timeout=_ANSWERING)
        headers = {"Authorization": f"Bearer {token}", "X-Texloom-Protocol": str(PROTOCOL), "Content-Type": kind}
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            raise _LostError(" ".join(f"{type(error).__name__}: {error}".split())) from None
        finally:
            connection.close()
        if answer.status >= 400:
            raise TexloomError(_problem(content, answer.status))
        return answer.headers, content

    def _json(self, method: str, path: str, body: Any = None) -> Any:
        return json.loads(self._request(method, path, body, "application/json")[1])

    def _pixels(self, path: str) -> Pixels:
        headers, content = self._request("GET", path)
        told = json.loads(headers["x-texloom-pixels"])
        return Pixels(content, tuple(told["shape"]), told["dtype"], told["color_space"])

    def _send(self, given: Any) -> str:
        """Send a picture; its id."""
        if isinstance(given, (str, os.PathLike)):
            given = (Path(given).name, _content(given))
        if isinstance(given, tuple) and len(given) == 2:
            about, content = {"name": given[0]}, given[1]
        elif isinstance(given, Pixels) or hasattr(given, "tobytes"):
            pixels = Pixels.of(given)
            shape = ",".join(map(str, pixels.shape))
            about = {"shape": shape, "dtype": pixels.dtype, "color_space": pixels.color_space}
            content = pixels.data
        else:
            raise TexloomError(f"a source of type {type(given).__name__}: give a path, Pixels or a NumPy array")
        return str(self._json("POST", f"/pictures?{urllib.parse.urlencode(about)}", content))


def _end(process: subprocess.Popen[bytes], patience: float = _ENDING) -> None:
    """End a server; it waits for its standard input to be closed."""
    assert process.stdin is not None
    process.stdin.close()
    for end in (process.terminate, process.kill):
        try:
            process.wait(patience)
            return
        except subprocess.TimeoutExpired:
            end()
    process.wait()


def find_texloom(command: str | Sequence[str] | None = None) -> list[str]:
    """The command of texloom: ``command``, else that of the variable TEXLOOM, else on the PATH or of ``uv tool``.

    Raises
    ------
    TexloomError : there is none.
    """
    given = command or os.environ.get("TEXLOOM", "")
    if not isinstance(given, str):
        return list(given)
    if given:
        found = shutil.which(os.path.expanduser(given))  # noqa: PTH111
        if found is None:
            raise TexloomError(f"{given}: no such program; set TEXLOOM to the path of texloom")
        return [found]
    home = Path.home()
    tools = os.environ.get("UV_TOOL_DIR") or (
        Path(os.environ.get("APPDATA", home), "uv", "tools") if os.name == "nt"
        else Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share", "uv", "tools")
    )  # fmt: skip
    for folder in (None, home / ".local" / "bin", Path(tools, "texloom", "Scripts" if os.name == "nt" else "bin")):
        found = shutil.which("texloom", path=None if folder is None else str(folder))
        if found is not None:
            return [found]
    raise TexloomError(
        "texloom is not found; install it (in a clone: uv tool install .), or set TEXLOOM to its path"
    )


def _content(path: str | os.PathLike) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise TexloomError(f"{path}: {error.strerror}") from None


def _problem(content: bytes, status: int) -> str:
    text = content.decode(errors="replace").strip()
    with contextlib.suppress(ValueError, KeyError, TypeError):
        text = json.loads(text)["problem"]
    return text.splitlines()[0] if text else f"the server answers {status}"
