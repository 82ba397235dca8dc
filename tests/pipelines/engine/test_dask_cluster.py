"""Workers of a Dask cluster of this machine."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import ssl
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.flows import open_run, write_flow
from texloom.pipelines.engine.executors.dask_cluster import DaskExecutor, local_cluster


def test_a_worker_that_dies_is_replaced_however_long_that_takes() -> None:
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1ms"}),  # any worker takes longer to start
        local_cluster(1) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        client.wait_for_workers(1)
        [(before, pid)] = client.run(os.getpid).items()
        os.kill(pid, signal.SIGKILL)
        deadline = time.monotonic() + 150
        while not set(client.nthreads()) - {before}:
            assert time.monotonic() < deadline, "the worker was given up"
            time.sleep(0.05)


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where this process and its workers put temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def answered_in_plain(port: int) -> bytes:
    """What a port answers to a request of HTTP."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as plain, contextlib.suppress(ConnectionError):
        plain.sendall(b"GET / HTTP/1.0\r\n\r\n")
        return plain.recv(100)
    return b""


def test_nobody_else_reaches_a_cluster_of_this_machine(temporary: Path) -> None:
    """Neither its scheduler, nor its worker and the process that watches it; and there is no dashboard."""
    psutil, distributed = pytest.importorskip("psutil"), pytest.importorskip("distributed")
    before = psutil.Process().net_connections()
    with local_cluster(1) as cluster:
        processes = [psutil.Process(), *psutil.Process().children()]
        opened = [one for process in processes for one in process.net_connections() if one not in before]
        listening = [one.laddr for one in opened if one.status == psutil.CONN_LISTEN]
        assert {address.ip for address in listening} == {"127.0.0.1"}
        assert len(listening) == 3
        anybody = ssl.create_default_context()
        anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
        for address in listening:
            assert not answered_in_plain(address.port).startswith(b"HTTP")
            with (
                pytest.raises((ssl.SSLError, ConnectionError)),
                socket.create_connection(address, timeout=10) as plain,
                anybody.wrap_socket(plain) as encrypted,
            ):
                encrypted.recv(1)
        own = cluster.scheduler_address
        for address, security in [
            (own.replace("tls:", "tcp:"), None),
            (own, distributed.Security.temporary()),
        ]:
            with pytest.raises(OSError):  # noqa: PT011
                distributed.Client(address, security=security, timeout="1s", set_as_default=False)

        # nor can another user read the credentials
        secret = cluster.security.tls_worker_key.splitlines()[1]
        for process in processes:
            assert secret not in " ".join(process.cmdline())
            assert secret not in " ".join(process.environ().values())
        [folder] = temporary.iterdir()
        assert folder.stat().st_mode & 0o777 == 0o700
        assert all(secret.encode() not in path.read_bytes() for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("problem", [None, KeyboardInterrupt])
def test_a_cluster_leaves_no_files(
    problem: type[BaseException] | None, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.chdir(temporary)
    with pytest.raises(problem) if problem else contextlib.nullcontext(), local_cluster(1):
        assert list(temporary.rglob("worker-*"))
        if problem:
            raise problem
    assert list(temporary.iterdir()) == []


def test_nobody_waits_for_answers_after_the_end(tmp_path: Path) -> None:
    """A task that ends while the client is closed has no answer; its thread would keep the program from ending."""
    executor = DaskExecutor(open_run(write_flow(tmp_path)), 1)
    asked = []

    class Unanswered:
        def exception(self, timeout: float) -> None:
            asked.append(timeout)
            if len(asked) == 2:
                executor.stop(at_once=True)
            raise TimeoutError

    task: Any = None
    assert "CancelledError" in repr(executor._outcome(Unanswered(), task, 0).error)
    assert len(asked) == 2


def test_an_answer_that_comes_late_is_waited_for(tmp_path: Path) -> None:
    executor = DaskExecutor(open_run(write_flow(tmp_path)), 1)
    answers: list[Any] = [TimeoutError(), {"record": "made", "seconds": 1.0}]

    class Late:
        def exception(self, timeout: float) -> None:
            return None

        def result(self, timeout: float) -> Any:
            answer = answers.pop(0)
            if isinstance(answer, Exception):
                raise answer
            return answer

    task: Any = None
    outcome = executor._outcome(Late(), task, 0)
    assert (outcome.record, outcome.error) == ("made", None)
