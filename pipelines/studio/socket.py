"""The socket of one open page: its previews, and news of all runs."""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import WebSocket, WebSocketDisconnect

from texloom.pipelines.studio.jobs import Jobs
from texloom.pipelines.studio.latest import Latest
from texloom.pipelines.studio.messages.answers import JobChanged, PreviewFailed
from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.messages.requests import (
    TO_SERVER,
    LatticeRequest,
    PaintDabRequest,
    PaintOpenRequest,
    PhotoRequest,
)
from texloom.pipelines.studio.processes import Spares, WorkCancelledError, WorkerProcess
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.declare import InputError

_MOST_FRAMES = 64
"""that wait for a slow page; older pictures are then left out"""
_MOST_STROKES = 256  # that wait; a page that sends more is not read until some are painted
PaintRequest = PaintOpenRequest | PaintDabRequest | LatticeRequest
_PROTOCOL_ERROR = 1007


class Tab:
    """One page. When it is closed, so are its previews; runs go on."""

    def __init__(self, socket: WebSocket, jobs: Jobs, spares: Spares, places: Places):
        self._socket, self._jobs, self._spares = socket, jobs, spares
        self._outgoing: asyncio.Queue[bytes] = asyncio.Queue()
        self._painter = WorkerProcess(places)
        self._strokes: asyncio.Queue[tuple[PaintRequest, bytes]] = asyncio.Queue(_MOST_STROKES)
        self._photographs = Latest(lambda: WorkerProcess(places), self._send)

    async def serve(self) -> None:
        """Talk to the page until it is closed."""
        await self._socket.accept()
        for job in self._jobs.jobs.values():
            self._send(packed(JobChanged(job=job)))
        self._jobs.listeners.add(self._send)
        self._previews = Latest(self._spares.take, self._send)
        self._previews.worker.start()
        parts = (
            self._receive(), self._deliver(), self._paint(), self._previews.serve(), self._photographs.serve()
        )  # fmt: skip
        tasks = [asyncio.create_task(one) for one in parts]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._jobs.listeners.discard(self._send)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._spares.give(self._previews.worker)
            self._painter.kill()
            self._photographs.worker.kill()

    def _send(self, frame: bytes) -> None:
        while self._outgoing.qsize() >= _MOST_FRAMES:
            self._outgoing.get_nowait()
        self._outgoing.put_nowait(frame)

    async def _deliver(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._socket.send_bytes(await self._outgoing.get())

    async def _receive(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, KeyError):
            while True:
                frame = await self._socket.receive_bytes()
                try:
                    header, payload = unpacked(frame)
                    request = TO_SERVER.validate_json(header)
                except ValueError:
                    await self._socket.close(_PROTOCOL_ERROR, "not a message of the studio")
                    return
                if isinstance(request, PaintRequest):
                    if isinstance(request, PaintOpenRequest):
                        while not self._strokes.empty():
                            self._strokes.get_nowait()
                        self._painter.cancel()
                    await self._strokes.put((request, bytes(payload)))
                    continue
                newest = self._photographs if isinstance(request, PhotoRequest) else self._previews
                newest.want(request, bytes(payload))

    async def _paint(self) -> None:
        """Paint in the order in which strokes come."""
        while True:
            request, payload = await self._strokes.get()
            try:
                async for frame in self._painter.frames(request, payload):
                    self._send(frame)
            except WorkCancelledError:
                continue
            except InputError as error:
                self._send(packed(PreviewFailed(number=request.number, problem=str(error))))
