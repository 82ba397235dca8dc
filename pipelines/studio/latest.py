"""Requests of which only the newest counts."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from texloom.pipelines.studio.messages.answers import PreviewFailed
from texloom.pipelines.studio.messages.message import packed
from texloom.pipelines.studio.messages.requests import (
    AlternativesRequest,
    Answered,
    PaintSummaryRequest,
    PhotoRequest,
    PreviewRequest,
)
from texloom.pipelines.studio.page_words import page_words
from texloom.pipelines.studio.processes import WorkCancelledError, WorkerProcess
from texloom.stages.vocabulary.declare import InputError

Request = AlternativesRequest | PaintSummaryRequest | PhotoRequest | PreviewRequest


class Latest:
    """A process that does the newest request: one that waits is replaced, and the one at work cancelled."""

    def __init__(self, take: Callable[[], WorkerProcess], send: Callable[[bytes], None]):
        self._take, self._send = take, send
        self.worker = take()
        self._wanted: tuple[Request, bytes] | None = None
        self._is_wanted = asyncio.Event()

    def want(self, request: Request, payload: bytes = b"") -> None:
        """Do this next."""
        self._wanted = request, payload
        self._is_wanted.set()
        self.worker.cancel()

    def stop(self) -> None:
        """Do nothing more until something is wanted."""
        self._is_wanted.clear()
        self.worker.cancel()

    async def serve(self) -> None:
        """Do what is wanted, for ever."""
        while True:
            await self._is_wanted.wait()
            self._is_wanted.clear()
            assert self._wanted is not None
            request, payload = self._wanted
            if not self.worker.is_alive:
                self.worker = self._take()
            await answer(self.worker, request, payload, self._send)


async def answer(worker: WorkerProcess, request: Answered, payload: bytes, send: Callable[[bytes], None]) -> None:
    """Send what a worker makes of a request, and why where it refuses; no more once it is cancelled."""
    try:
        async for frame in worker.frames(request, payload):
            send(frame)
    except WorkCancelledError:
        pass
    except InputError as error:
        send(packed(PreviewFailed(number=request.number, problem=page_words(str(error)))))
