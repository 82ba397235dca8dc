"""Workers of a Dask cluster of this machine."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.flows import open_run, write_flow
from texloom.pipelines.engine.dask_cluster import DaskExecutor, local_cluster


def test_a_worker_that_dies_is_replaced_however_long_that_takes() -> None:
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1ms"}),  # any worker takes longer to start
        local_cluster(1) as cluster,
        distributed.Client(cluster.scheduler_address, set_as_default=False) as client,
    ):
        client.wait_for_workers(1)
        [(before, pid)] = client.run(os.getpid).items()
        os.kill(pid, signal.SIGKILL)
        deadline = time.monotonic() + 150
        while not set(client.nthreads()) - {before}:
            assert time.monotonic() < deadline, "the worker was given up"
            time.sleep(0.05)


def test_nobody_waits_for_answers_after_the_end(tmp_path: Path) -> None:
    """A task that ends while the client is closed has no answer; its thread would keep the program from ending."""
    executor = DaskExecutor(open_run(write_flow(tmp_path)))
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
