"""Worker processes as seen from the server."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import threading
from collections.abc import AsyncIterator
from multiprocessing.connection import Connection

from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.work import Ended, Places, Work
from texloom.pipelines.studio.work_loop import CANCEL, serve
from texloom.stages.vocabulary.declare import InputError

_PATIENCE = 15.0
"""seconds after which a worker that does not cancel its work is killed"""
PAUSE = 15.0
"""seconds until the next worker is prepared, which are left to the previews of the one that was taken"""
_ENDED = b'{"kind":"ended"'


class WorkCancelledError(Exception):
    """The work was cancelled."""


class WorkerProcess:
    """A process that does one piece of work at a time; the first one starts it, and the next one if it has died."""

    def __init__(self, places: Places):
        self.places = places
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self._frames: asyncio.Queue[bytes | None] = asyncio.Queue()
        self._free = asyncio.Lock()
        self._count = 0
        """rises when a piece of work begins and when it ends"""

    def start(self) -> None:
        """Start the process, if it does not run."""
        if self.is_alive:
            return
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, self.places), daemon=True)
        self._process.start()
        theirs.close()
        self._connection, self._frames = ours, asyncio.Queue()
        receive = (ours, self._frames, asyncio.get_running_loop())
        threading.Thread(target=_receive, args=receive, daemon=True).start()

    async def frames(self, work: Work, payload: bytes = b"") -> AsyncIterator[bytes]:
        """Do a piece of work after those before it; its frames but the last one.

        Raises
        ------
        InputError : the work was refused, has failed, or the process has died.
        WorkCancelledError : it was cancelled.
        """
        async with self._free:
            self.start()
            ended = None
            self._count += 1
            try:
                async for frame in self._answers(packed(work, payload)):
                    header, _ = unpacked(frame)
                    if not header.startswith(_ENDED):
                        yield frame
                        continue
                    ended = Ended.model_validate_json(header)
                    break
            finally:
                self._count += 1
                if ended is None:  # it has died, or whoever asked has gone while it works
                    self.kill()
        if ended is None:
            raise InputError("the process that computed this has ended unexpectedly; try again")
        if ended.is_cancelled:
            raise WorkCancelledError
        if ended.problem:
            raise InputError(ended.problem)

    async def _answers(self, request: bytes) -> AsyncIterator[bytes]:
        """All frames that follow a request, until the process ends."""
        assert self._connection is not None
        with contextlib.suppress(OSError):
            self._connection.send_bytes(request)
            while (frame := await self._frames.get()) is not None:
                yield frame

    async def answer(self, work: Work) -> bytes:
        """The only frame of a piece of work."""
        answer = b""
        async for frame in self.frames(work):
            answer = frame
        return answer

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.is_alive()

    @property
    def is_busy(self) -> bool:
        """Whether it works."""
        return self._free.locked()

    def cancel(self) -> None:
        """Cancel the work at hand; the process is killed if it does not heed."""
        process, connection = self._process, self._connection
        if process is None or connection is None or not self.is_busy:
            return
        with contextlib.suppress(OSError):
            connection.send_bytes(CANCEL)
        work = self._count
        asyncio.get_running_loop().call_later(_PATIENCE, lambda: self.kill() if self._count == work else None)

    def kill(self) -> None:
        """End the process, whatever it does; what a run has finished is kept."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


class Spares:
    """Keeps one worker ahead that has loaded what previews need, so that the first one comes at once."""

    def __init__(self, places: Places, practice: Work):
        self._places, self._practice = places, practice
        self._spare: WorkerProcess | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def prepare(self, delay: float = 0.0) -> None:
        """Start a worker in some seconds, unless there is one by then, and let it do something of no use."""
        task = asyncio.create_task(self._prepare(delay))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _prepare(self, delay: float) -> None:
        await asyncio.sleep(delay)
        if self._spare is not None:
            return
        worker = WorkerProcess(self._places)
        self._spare = worker
        with contextlib.suppress(InputError, WorkCancelledError):
            await worker.answer(self._practice)

    def take(self) -> WorkerProcess:
        """The worker that is ready, or a new one; `give` it back. The next one is prepared."""
        worker, self._spare = self._spare, None
        self.prepare(PAUSE)
        return worker or WorkerProcess(self._places)

    def give(self, worker: WorkerProcess) -> None:
        """Keep a worker for the next one, if it is idle."""
        if self._spare is None and worker.is_alive and not worker.is_busy:
            self._spare = worker
        else:
            worker.kill()

    async def end(self) -> None:
        """End the spare worker."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._spare is not None:
            self._spare.kill()


def _receive(connection: Connection, frames: asyncio.Queue[bytes | None], loop: asyncio.AbstractEventLoop) -> None:
    """Hand over what a process sends, and nothing when it has ended; in a thread of its own."""
    frame: bytes | None = b""
    while frame is not None:
        try:
            frame = connection.recv_bytes()
        except (EOFError, OSError):
            frame = None
        with contextlib.suppress(RuntimeError):  # the server ends
            loop.call_soon_threadsafe(frames.put_nowait, frame)
