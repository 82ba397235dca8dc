"""The deployments of `prefect.yaml` on a server of their own, with a work pool and two workers."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import httpx
import numpy as np
import PIL.Image
import pytest

T = TypeVar("T")

ROOT = Path(__file__).parents[4]
SECONDS = 240
FLOW = """
flow: library
sources:
  exemplar: {each: "library/*.png"}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
exports:
  edges.png: edges.strength
"""


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
        self.started: list[subprocess.Popen[bytes]] = []
        self.start("server", "start", "--host", "127.0.0.1", "--port", str(port))
        wait_for(lambda: self.post("health", method="GET"))

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
            answer = httpx.request(method, f"{self.url}/{path}", json=body, timeout=120)
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


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    (tmp_path / "server").mkdir()
    made = Server(tmp_path / "server")
    yield made
    made.stop()


def test_two_workers_run_the_deployments(server: Server, tmp_path: Path, rng: np.random.Generator) -> None:
    place = tmp_path / "deployed"
    (place / "library").mkdir(parents=True)
    for name in ("a", "b"):
        PIL.Image.fromarray(rng.integers(0, 256, (32, 32, 3), np.uint8)).save(place / "library" / f"{name}.png")
    (place / "library.yaml").write_text(FLOW)
    shutil.copy(ROOT / "prefect.yaml", place)
    server.call("work-pool", "create", "--type", "process", "texloom", folder=place)
    server.call("deploy", "--all", "--no-prompt", folder=place)
    for name in ("one", "two"):
        server.start("worker", "start", "--pool", "texloom", "--name", name, "--limit", "1")
    known = {entry["name"]: entry for entry in wait_for(lambda: server.post("deployments/filter", {}))}
    assert set(known) == {"run", "nightly"}
    assert [entry["schedule"]["cron"] for entry in known["nightly"]["schedules"]] == ["0 2 * * *"]

    common = {"flow": str(place / "library.yaml"), "source": {}, "store": str(place / "store"), "runner": "local"}
    runs = [
        server.post(
            f"deployments/{known[name]['id']}/create_flow_run",
            {"parameters": {**common, "out": str(place / f"out_{name}")}, "state": {"type": "SCHEDULED"}},
        )["id"]
        for name in ("run", "nightly")
    ]

    def states() -> list[str] | None:
        found = server.post("flow_runs/filter", {"flow_runs": {"id": {"any_": runs}}}) or []
        over = [run for run in found if run["state_type"] in ("COMPLETED", "FAILED", "CRASHED")]
        return [run["state_type"] for run in over] if len(over) == 2 else None

    try:
        assert wait_for(states) == ["COMPLETED", "COMPLETED"], server.logs()
    except TimeoutError:
        pytest.fail(server.logs())
    for name in ("run", "nightly"):
        assert sorted(path.parent.name for path in (place / f"out_{name}").rglob("edges.png")) == ["a", "b"]
    workers = wait_for(lambda: server.post("work_pools/texloom/workers/filter", {}))
    assert {entry["name"] for entry in workers} == {"one", "two"}
    if not importlib.metadata.version("sqlalchemy").startswith("2.0."):
        return  # an environment that is older than the limit in pyproject.toml
    coming = {"deployment_id": {"any_": [known["nightly"]["id"]]}, "state": {"type": {"any_": ["SCHEDULED"]}}}
    assert wait_for(lambda: server.post("flow_runs/filter", {"flow_runs": coming}))
