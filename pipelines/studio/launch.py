"""Starting and ending the server: as a studio, or for other programs."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import socket
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import uvicorn

from texloom.pipelines.errors import one_line, refused
from texloom.pipelines.flow.runner import check_environment
from texloom.pipelines.store.location import passed_over
from texloom.pipelines.store.ownership import keeps_no_key
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.built_page import check_page
from texloom.pipelines.studio.host_server import host_application
from texloom.pipelines.studio.messages.hosts import PROTOCOL
from texloom.pipelines.studio.projects.files import ProjectFiles
from texloom.pipelines.studio.security import Codes, Guard, leading_to
from texloom.pipelines.studio.server import application
from texloom.pipelines.studio.work import Places

_HOST = "127.0.0.1"


class _Server(uvicorn.Server):
    """Calls a function as soon as it listens."""

    def __init__(self, config: uvicorn.Config, started: Callable[[], None]):
        super().__init__(config)
        self._started = started

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._started()


class _Entrance:
    """Tells addresses that open the page once: to the browser, and to whoever reads the terminal."""

    def __init__(self, port: int, page: Path | None):
        """Write the address for the browser into the new file ``page``.

        Anybody can read the browser's command line, so it names that file, which nobody else can read.
        """
        self.codes = Codes(self._used)
        self._address = f"http://{_HOST}:{port}/?code="
        self._page, self._printed = page, ""
        if page is not None:
            page.touch(0o600, exist_ok=False)
            page.write_text(leading_to(self._address + self.codes.new()))

    def tell(self) -> None:
        """Print an address, and open the other one in the browser."""
        self._print()
        if self._page is not None and not webbrowser.open(self._page.as_uri()):
            click.echo("no browser was found; open the address in one", err=True)

    def _used(self, code: str) -> None:
        """Print the next address for one that was, or remove what only the browser has read."""
        if code == self._printed:
            self._print("for another browser: ")
        elif self._page is not None:
            self._page.unlink(missing_ok=True)

    def _print(self, what: str = "") -> None:
        self._printed = self.codes.new()
        with contextlib.suppress(OSError):  # nobody reads any more
            click.echo(f"{what}{self._address}{self._printed}")


def launch(folder: Path, store: Path, port: int, browser: bool) -> None:
    """Serve the studio of a folder until Ctrl-C; port 0 takes a free one."""
    check_environment()
    check_page()
    if not folder.is_dir():
        raise refused(f"{folder}: is not a folder")
    files = ProjectFiles(folder.resolve())
    with files.locked(), _listening(port) as listener, _places(files.folder, store) as places:
        port = listener.getsockname()[1]
        entrance = _Entrance(port, Path(places.scratch, "open.html") if browser else None)
        _run(application(places, entrance.codes, port, files), entrance.tell, listener)


def serve(store: Path, port: int, attached: bool) -> None:
    """Serve other programs until Ctrl-C, or, if ``attached``, until standard input ends; port 0 takes a free one.

    The address and the token are printed as one line of JSON.
    """
    check_environment()
    with _listening(port) as listener, _places(Path.cwd(), store) as places:
        port = listener.getsockname()[1]
        guard = host_application(places, port)
        told = {
            "protocol": PROTOCOL, "version": importlib.metadata.version("texloom"),
            "address": f"http://{_HOST}:{port}", "token": guard.token,
        }  # fmt: skip
        _run(guard, lambda: click.echo(json.dumps(told)), listener, attached)


@contextlib.contextmanager
def _places(folder: Path, store: Path) -> Iterator[Places]:
    """The folders of a server; what is to be said of the store is printed."""
    opened = Store(store)
    opened.check_owned()
    for note in filter(None, (passed_over(opened.root), keeps_no_key())):
        click.echo(one_line(note), err=True)
    with tempfile.TemporaryDirectory(prefix="texloom-studio-") as scratch:
        yield Places(folder=str(folder), store=str(opened.root), scratch=scratch)


def _run(guard: Guard, started: Callable[[], None], listener: socket.socket, attached: bool = False) -> None:
    """Answer requests until the process is told to end."""
    # Without the access log, which would show the codes.
    config = uvicorn.Config(
        guard, log_level="warning", access_log=False, ws_max_size=2**24,
        timeout_graceful_shutdown=3, proxy_headers=False, server_header=False,
    )  # fmt: skip
    server = _Server(config, started)
    if attached:
        threading.Thread(target=_end_with_input, args=(server,), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        server.run([listener])


def _end_with_input(server: uvicorn.Server) -> None:
    """End the server when the program that holds the other end of standard input closes it or ends."""
    with contextlib.suppress(OSError):
        while os.read(sys.stdin.fileno(), 4096):
            pass
    server.should_exit = True


@contextlib.contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((_HOST, port))
        except OSError as error:
            raise refused(f"--port {port}: {error.strerror}; give another one") from None
        yield listener
