"""The processes of a Dask cluster of this machine, which serve nobody but each other and the run."""

from __future__ import annotations

from typing import Any

import distributed


class Scheduler(distributed.Scheduler):  # type: ignore[misc]
    """Dask's, without the HTTP server, which answers anybody."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Start none."""


class Worker(distributed.Worker):  # type: ignore[misc]
    """Dask's, without the HTTP server, which answers anybody."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Start none."""
