"""Starting and ending a studio."""

from __future__ import annotations

import contextlib
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path

import click
import uvicorn

from texloom.pipelines.errors import one_line, refused
from texloom.pipelines.flow.runner import check_environment
from texloom.pipelines.store.location import passed_over
from texloom.pipelines.store.ownership import keeps_no_key
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.page import check_page
from texloom.pipelines.studio.server import application
from texloom.pipelines.studio.work import Places

_HOST = "127.0.0.1"


class _Server(uvicorn.Server):
    """Says where it is as soon as it listens."""

    def __init__(self, config: uvicorn.Config, address: str, browser: bool):
        super().__init__(config)
        self._address, self._browser = address, browser

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        click.echo(self._address)
        if self._browser:
            webbrowser.open(self._address)


def launch(folder: Path, store: Path, port: int, browser: bool) -> None:
    """Serve the studio of a folder until Ctrl-C; port 0 takes a free one."""
    check_environment()
    check_page()
    if not folder.is_dir():
        raise refused(f"{folder}: is not a folder")
    opened = Store(store)
    opened.check_owned()
    for note in filter(None, (passed_over(opened.root), keeps_no_key())):
        click.echo(one_line(note), err=True)
    token = secrets.token_urlsafe(32)
    with _listening(port) as listener, tempfile.TemporaryDirectory(prefix="texloom-studio-") as scratch:
        port = listener.getsockname()[1]
        places = Places(folder=str(folder.resolve()), store=str(opened.root), scratch=scratch)
        # Without the access log, which would show the token.
        config = uvicorn.Config(
            application(places, token, port), log_level="warning", access_log=False, ws_max_size=2**24,
            timeout_graceful_shutdown=3, proxy_headers=False, server_header=False,
        )  # fmt: skip
        server = _Server(config, f"http://{_HOST}:{port}/?token={token}", browser)
        with contextlib.suppress(KeyboardInterrupt):
            server.run([listener])


@contextlib.contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((_HOST, port))
        except OSError as error:
            raise refused(f"--port {port}: {error.strerror}; give another one") from None
        yield listener
