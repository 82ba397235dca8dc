"""Open pages: their previews and canvases, and news of all runs. They outlive their sockets."""

from __future__ import annotations

import asyncio
import contextlib
import re

from fastapi import WebSocket, WebSocketDisconnect

from texloom.pipelines.studio.jobs import Jobs
from texloom.pipelines.studio.latest import Latest, answer
from texloom.pipelines.studio.messages.answers import Connected, JobChanged
from texloom.pipelines.studio.messages.message import numbered, packed, unpacked, without_numbers
from texloom.pipelines.studio.messages.requests import (
    TO_SERVER,
    LatticeRequest,
    PaintDabRequest,
    PaintOpenRequest,
    PaintSummaryRequest,
    PhotoRequest,
    PreviewStopRequest,
    ToServer,
)
from texloom.pipelines.studio.outbox import Outbox
from texloom.pipelines.studio.processes import Spares, WorkerProcess
from texloom.pipelines.studio.work import Places

MOST_PAGES = 16
KEPT = 300.0
"""seconds that a page may be without a socket until its previews and canvas end"""
_MOST_STROKES = 256  # that wait; a page that sends more is not read until some are painted
_NAME = re.compile(r"[0-9a-f-]{16,64}")
_PROTOCOL_ERROR, _TOO_MANY, _REPLACED, _BEHIND = 1007, 1013, 4000, 4001  # why a socket is closed
PaintRequest = PaintOpenRequest | PaintDabRequest | LatticeRequest


class Sessions:
    """The open pages, by the names that they give themselves."""

    def __init__(self, jobs: Jobs, spares: Spares, places: Places):
        self._jobs, self._spares, self._places = jobs, spares, places
        self._sessions: dict[str, _Session] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def serve(self, socket: WebSocket, name: str) -> None:
        """Talk to a page until its socket is lost; it may come back with another one."""
        await socket.accept()
        if not _NAME.fullmatch(name):
            await socket.close(_PROTOCOL_ERROR, "a page without a name")
            return
        is_new = name not in self._sessions
        if is_new and not await self._has_room():
            await socket.close(_TOO_MANY, f"{MOST_PAGES} pages are open; close one of them")
            return
        if is_new:
            self._sessions[name] = _Session(self._jobs, self._spares, self._places)
        session = self._sessions[name]
        await session.talk(socket, is_new)
        if session.is_behind:
            await self._end(name)
        elif not session.is_connected:
            task = asyncio.create_task(self._expire(name, session))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _expire(self, name: str, session: _Session) -> None:
        await asyncio.sleep(KEPT)
        if self._sessions.get(name) is session and not session.is_connected:
            await self._end(name)

    async def _has_room(self) -> bool:
        """Whether there is room for one page more; of pages without a socket the oldest ends for it."""
        while len(self._sessions) >= MOST_PAGES:
            lost = [one for one, session in self._sessions.items() if not session.is_connected]
            if not lost:
                return False
            await self._end(lost[0])
        return True

    async def _end(self, name: str) -> None:
        await self._sessions.pop(name).end()

    async def end(self) -> None:
        """End all."""
        for task in self._tasks:
            task.cancel()
        for name in list(self._sessions):
            await self._end(name)


class _Session:
    """One page. When it ends, so do its previews; runs go on."""

    def __init__(self, jobs: Jobs, spares: Spares, places: Places):
        self._jobs, self._spares = jobs, spares
        self._outbox = Outbox()
        self._received = 0
        """number of the last message of the page"""
        self._socket: WebSocket | None = None
        self._painter = WorkerProcess(places)
        self._strokes: asyncio.Queue[tuple[PaintRequest, bytes]] = asyncio.Queue(_MOST_STROKES)
        self._photographs = Latest(lambda: WorkerProcess(places), self._outbox.put)
        self._summaries = Latest(lambda: WorkerProcess(places), self._outbox.put)
        for job in jobs.jobs.values():
            self._outbox.put(packed(JobChanged(job=job)))
        jobs.listeners.add(self._outbox.put)
        self._previews = Latest(spares.take, self._outbox.put)
        self._previews.worker.start()
        parts = self._paint(), self._previews.serve(), self._photographs.serve(), self._summaries.serve()
        self._tasks = [asyncio.create_task(one) for one in parts]

    @property
    def is_connected(self) -> bool:
        """Whether it has a socket."""
        return self._socket is not None

    @property
    def is_behind(self) -> bool:
        """Whether so much waits for the page that it has to begin anew."""
        return self._outbox.is_full

    async def talk(self, socket: WebSocket, is_new: bool) -> None:
        """Talk over a socket until it is lost, or the page comes with another one."""
        if self._socket is not None:
            with contextlib.suppress(RuntimeError):
                await self._socket.close(_REPLACED, "the page has connected again")
        self._socket = socket
        self._outbox.again()
        hello = packed(Connected(is_new=is_new))
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, KeyError):
            await socket.send_bytes(numbered(0, self._received, hello))
            tasks = [asyncio.create_task(one) for one in (self._receive(socket), self._deliver(socket))]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
        if self._socket is socket:
            self._socket = None

    async def end(self) -> None:
        """End its work."""
        self._jobs.listeners.discard(self._outbox.put)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._spares.give(self._previews.worker)
        self._painter.kill()
        self._photographs.worker.kill()
        self._summaries.worker.kill()

    async def _deliver(self, socket: WebSocket) -> None:
        told = self._received
        while self._socket is socket:
            self._outbox.news.clear()
            if self._outbox.is_full:
                await socket.close(_BEHIND, "the page has fallen behind")
                return
            while self._socket is socket and (sent := self._outbox.take()) is not None:
                told = self._received
                await socket.send_bytes(numbered(sent[0], told, sent[1]))
            if told != self._received:
                told = self._received
                await socket.send_bytes(numbered(0, told))
            await self._outbox.news.wait()

    async def _receive(self, socket: WebSocket) -> None:
        while self._socket is socket:
            sent = await socket.receive_bytes()
            try:
                number, arrived, frame = without_numbers(sent)
                self._outbox.arrived(arrived)
                if number <= self._received:  # no message, or one that has come before
                    continue
                header, payload = unpacked(frame)
                request = TO_SERVER.validate_json(header)
            except ValueError:
                await socket.close(_PROTOCOL_ERROR, "not a message of the studio")
                return
            await self._take(request, bytes(payload))
            self._received = number
            self._outbox.news.set()

    async def _take(self, request: ToServer, payload: bytes) -> None:
        if isinstance(request, PaintRequest):
            if isinstance(request, PaintOpenRequest):
                while not self._strokes.empty():
                    self._strokes.get_nowait()
                self._painter.cancel()
            await self._strokes.put((request, payload))
            return
        if isinstance(request, PreviewStopRequest):
            self._previews.stop()
            return
        match request:
            case PhotoRequest():
                self._photographs.want(request)
            case PaintSummaryRequest():
                self._summaries.want(request)
            case _:
                self._previews.want(request, payload)

    async def _paint(self) -> None:
        """Paint in the order in which strokes come."""
        while True:
            request, payload = await self._strokes.get()
            await answer(self._painter, request, payload, self._outbox.put)
