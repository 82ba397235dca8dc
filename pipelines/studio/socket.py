"""The socket of one open page: its previews, and news of all runs."""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import WebSocket, WebSocketDisconnect

from texloom.pipelines.studio.jobs import Jobs
from texloom.pipelines.studio.messages import (
    TO_SERVER,
    AlternativesRequest,
    JobChanged,
    PreviewFailed,
    ToServer,
    packed,
    unpacked,
)
from texloom.pipelines.studio.processes import Spares, WorkCancelledError
from texloom.pipelines.studio.work import AlternativesWork, PreviewWork
from texloom.stages.declare import InputError

_MOST_FRAMES = 64
"""that wait for a slow page; older pictures are then left out"""
_PROTOCOL_ERROR = 1007


class Tab:
    """One page. When it is closed, so are its previews; runs go on."""

    def __init__(self, socket: WebSocket, jobs: Jobs, spares: Spares):
        self._socket, self._jobs, self._spares = socket, jobs, spares
        self._outgoing: asyncio.Queue[bytes] = asyncio.Queue()
        self._wanted: ToServer | None = None
        self._is_wanted = asyncio.Event()

    async def serve(self) -> None:
        """Talk to the page until it is closed."""
        await self._socket.accept()
        for job in self._jobs.jobs.values():
            self._send(packed(JobChanged(job=job)))
        self._jobs.listeners.add(self._send)
        self._worker = self._spares.take()
        self._worker.start()
        tasks = [asyncio.create_task(one) for one in (self._receive(), self._deliver(), self._preview())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._jobs.listeners.discard(self._send)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._spares.give(self._worker)

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
                    header, _ = unpacked(frame)
                    request = TO_SERVER.validate_json(header)
                except ValueError:
                    await self._socket.close(_PROTOCOL_ERROR, "not a message of the studio")
                    return
                self._wanted = request
                self._is_wanted.set()
                self._worker.cancel()

    async def _preview(self) -> None:
        """Make the preview that is wanted, until another one is."""
        while True:
            await self._is_wanted.wait()
            self._is_wanted.clear()
            request = self._wanted
            assert request is not None
            try:
                async for frame in self._worker.frames(_work(request)):
                    self._send(frame)
            except WorkCancelledError:
                continue
            except InputError as error:
                self._send(packed(PreviewFailed(number=request.number, problem=str(error))))


def _work(request: ToServer) -> AlternativesWork | PreviewWork:
    """What the worker of a page is asked to do."""
    if isinstance(request, AlternativesRequest):
        return AlternativesWork(number=request.number, recipe=request.recipe, seeds=request.seeds)
    return PreviewWork(number=request.number, recipe=request.recipe)
