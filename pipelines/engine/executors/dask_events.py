"""How the progress of a step travels from a worker of a Dask cluster to the run: as events, which the scheduler of
the cluster passes on. Nobody waits for them, and they may be lost.
"""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Callable
from typing import Any

from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.executors.worker import Payload, compute_once
from texloom.stages.vocabulary.progress import Progress


class EventReceiver:
    """Receives events from the workers of a Dask cluster until `close`."""

    def __init__(self, client: Any, tell: Callable[[int, Event], None]):
        """``tell`` receives the number of a task and what it tells, from any thread."""
        self._client = client
        self.topic = f"texloom-{secrets.token_hex(16)}"
        client.subscribe_topic(self.topic, lambda event: _pass_on(event[1], tell))

    def close(self) -> None:
        """Subscribe no longer."""
        with contextlib.suppress(Exception):  # the cluster may be gone
            self._client.unsubscribe_topic(self.topic)


def _pass_on(told: Any, tell: Callable[[int, Event], None]) -> None:
    with contextlib.suppress(ValueError, TypeError):  # not in our form
        number, step, values, picture = told
        tell(int(number), StepProgress(str(step), Progress(**values), bytes(picture)))


def compute_and_tell(payload: Payload, topic: str, number: int) -> dict[str, Any]:
    """`compute_once` on a worker of a Dask cluster, whose task of this number tells how far it is."""
    from distributed import get_worker

    def tell(event: Event) -> None:
        assert isinstance(event, StepProgress)
        with contextlib.suppress(Exception):  # a worker that is leaving the cluster
            get_worker().log_event(topic, (number, event.step, vars(event.progress), event.picture))

    return compute_once(payload, tell)
