"""How the progress of a step travels from a worker of a Dask cluster to the run: as events, which the scheduler of
the cluster passes on. Nobody waits for them, and they may be lost.
"""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Callable
from typing import Any

from texloom.pipelines.engine.events import Event, StepProgress, StepStarted
from texloom.pipelines.engine.executors.worker import Payload, compute_once
from texloom.stages.vocabulary.progress import Progress

_TOPIC = "texloom"
"""of all runs: a scheduler keeps the last events of each topic as long as it lives"""


class EventReceiver:
    """Receives events from the workers of a Dask cluster until `close`."""

    def __init__(self, client: Any, tell: Callable[[int, Event], None]):
        """``tell`` receives the number of a task and what it tells, from any thread."""
        self._client = client
        self.token = secrets.token_hex(16)
        """what tells the events of this run from those of others"""
        client.subscribe_topic(_TOPIC, lambda event: _pass_on(self.token, event[1], tell))

    def close(self) -> None:
        """Subscribe no longer."""
        with contextlib.suppress(Exception):  # the cluster may be gone
            self._client.unsubscribe_topic(_TOPIC)


def _pass_on(ours: str, told: Any, tell: Callable[[int, Event], None]) -> None:
    with contextlib.suppress(ValueError, TypeError):  # not in our form
        token, number, step, values, picture = told
        if token == ours:
            progress = StepProgress(str(step), Progress(**values), bytes(picture)) if values else None
            tell(int(number), progress or StepStarted(str(step)))


def compute_and_tell(payload: Payload, token: str, number: int) -> dict[str, Any]:
    """`compute_once` on a worker of a Dask cluster, whose task of this number tells how far it is."""
    from distributed import get_worker

    def tell(event: Event) -> None:
        assert isinstance(event, StepStarted | StepProgress)
        told = (vars(event.progress), event.picture) if isinstance(event, StepProgress) else ({}, b"")
        with contextlib.suppress(Exception):  # a worker that is leaving the cluster
            get_worker().log_event(_TOPIC, (token, number, event.step, *told))

    return compute_once(payload, tell)
