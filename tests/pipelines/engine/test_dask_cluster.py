"""Workers of a Dask cluster of this machine."""

from __future__ import annotations

import os
import signal
import time

import pytest

from texloom.pipelines.engine.dask_cluster import local_cluster


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
