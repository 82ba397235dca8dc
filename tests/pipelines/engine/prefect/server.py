"""A Prefect server, and what is started beside it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import httpx

T = TypeVar("T")

SECONDS = 240


class Server:
    """A Prefect server and what is started beside it."""

    def __init__(self, folder: Path):
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            port = found.getsockname()[1]
        self.folder = folder
        self.url = f"http://127.0.0.1:{port}/api"
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")},
            "PREFECT_HOME": str(folder / "home"),
            "PREFECT_API_URL": self.url,
            "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
            "PREFECT_WORKER_QUERY_SECONDS": "1",
            "PREFECT_SERVER_SERVICES_SCHEDULER_LOOP_SECONDS": "2",
            "DO_NOT_TRACK": "1",
        }
        # one: each reads the certificates of the system; no connection is kept that the server might close
        self.client = httpx.Client(timeout=120, limits=httpx.Limits(max_keepalive_connections=0))
        self.started: list[subprocess.Popen[bytes]] = []
        self._port = str(port)
        self.serve()

    def serve(self) -> subprocess.Popen[bytes]:
        """Start the server, once more after it was killed, and wait until it answers."""
        self.start("server", "start", "--host", "127.0.0.1", "--port", self._port)
        wait_for(lambda: self.post("health", method="GET"))
        return self.started[-1]

    def start(self, *arguments: str) -> None:
        """Start a command of Prefect that goes on."""
        with (self.folder / f"{len(self.started)}.log").open("wb") as log:
            command = self._command(arguments)
            self.started.append(subprocess.Popen(command, env=self.environment, stdout=log, stderr=log))

    def call(self, *arguments: str, folder: Path) -> None:
        """Run a command of Prefect."""
        command = self._command(arguments)
        done = subprocess.run(
            command, check=False, cwd=folder, env=self.environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr

    def _command(self, arguments: tuple[str, ...]) -> list[str]:
        return [sys.executable, "-m", "prefect", *arguments]

    def post(self, path: str, body: Any = None, method: str = "POST") -> Any:
        """The answer of the server's interface; none while it does not listen, or closes a connection."""
        try:
            answer = self.client.request(method, f"{self.url}/{path}", json=body)
        except httpx.TransportError:
            return None
        if answer.status_code == httpx.codes.SERVICE_UNAVAILABLE:  # its database is locked
            time.sleep(1)
            return self.post(path, body, method)
        assert answer.is_success, answer.text
        return answer.json()

    def logs(self) -> str:
        """What the commands have printed."""
        return "\n".join(path.read_text(errors="replace")[-3000:] for path in sorted(self.folder.glob("*.log")))

    def stop(self) -> None:
        """End all, the server last."""
        self.client.close()
        for process in reversed(self.started):
            process.terminate()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_for(answer: Callable[[], T | None]) -> T:
    """What is answered in time, if it is true."""
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        if found := answer():
            return found
        time.sleep(0.2)
    raise TimeoutError
