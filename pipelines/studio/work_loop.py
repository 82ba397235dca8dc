"""A worker process: does one piece of work after the other, so that the server survives whatever happens to it.

Each request is a frame of `Work`; what comes back are frames, the last one of them `Ended`. An empty frame cancels
the work at hand. The process ends when its connection does.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import queue
import re
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

from texloom.pipelines.errors import one_line
from texloom.pipelines.studio.messages.message import Message, packed, unpacked
from texloom.pipelines.studio.messages.requests import (
    AlternativesRequest,
    LatticeRequest,
    PaintDabRequest,
    PaintOpenRequest,
    PaintSummaryRequest,
    PhotoRequest,
    PreviewRequest,
)
from texloom.pipelines.studio.work import (
    WORK,
    Ended,
    EndlessWork,
    HostWork,
    InsightWork,
    KeepPhotoWork,
    KeepWork,
    LayersWork,
    MeshWork,
    PictureWork,
    Places,
    RunWork,
    SaveWork,
    ThumbnailWork,
    TileWork,
)
from texloom.stages.vocabulary.declare import InputError

CANCEL = b""
_PLACE = re.compile(r"^\S+\.yaml: |steps\.| \(\w+ is [^()]*\)$")
"""what a problem tells of flow files and paths, which the page does not show"""
Send = Callable[..., None]
"""``send(message, payload)``"""


class WorkAborted(BaseException):
    """The work at hand is not wanted any more; nothing on its way catches it."""


def serve(connection: Connection, places: Places) -> None:
    """Work until the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the server ends its workers
    logging.disable(logging.WARNING)
    WorkLoop(connection, places).run()


class WorkLoop:
    """The state of the process."""

    def __init__(self, connection: Connection, places: Places):
        self.connection, self.places = connection, places
        self.is_cancelled = threading.Event()
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def run(self) -> None:
        """Receive in another thread, so that work can be cancelled."""
        from texloom.pipelines.studio.endless import Endless
        from texloom.pipelines.studio.lattices import Lattices
        from texloom.pipelines.studio.layer_tiles import Tiler
        from texloom.pipelines.studio.painting import Painter
        from texloom.pipelines.studio.photographs import Photographer
        from texloom.pipelines.studio.previews import Previewer

        self.previewer, self.painter = Previewer(self.places), Painter(self.places)
        self.photographer, self.tiler = Photographer(self.places), Tiler(self.places)
        self.lattices, self.endless = Lattices(self.places), Endless(self.places)
        threading.Thread(target=self._receive, daemon=True).start()
        while (frame := self._waiting.get()) is not None:
            self._send(self.ended(frame))

    def _receive(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                frame = self.connection.recv_bytes()
                if frame == CANCEL:
                    self.is_cancelled.set()
                else:
                    self.is_cancelled.clear()
                    self._waiting.put(frame)
        os._exit(0)  # the server is gone, and nobody waits for what is being computed

    def ended(self, frame: bytes) -> Ended:
        """Do the work and say how it ended."""
        try:
            header, payload = unpacked(frame)
            self._work(header, bytes(payload))
        except WorkAborted:
            return Ended(is_cancelled=True)
        except InputError as error:
            return Ended(problem=_PLACE.sub("", str(error)))
        except Exception as error:
            return Ended(problem=_problem(error))
        return Ended()

    def _work(self, header: bytes, payload: bytes) -> None:
        from texloom.pipelines.studio import (
            corrections,
            decoding,
            full_size_runs,
            host_runs,
            layers,
            surfaces,
            thumbnails,
        )

        self.check()
        match WORK.validate_json(header):
            case PreviewRequest() as work:
                self.previewer.make(work, payload, self.check, self._send)
            case RunWork() as work:
                full_size_runs.run(work, self.places, self.check, self._send)
            case HostWork() as work:
                host_runs.run(work, self.places, self.check, self._send)
            case SaveWork() as work:
                full_size_runs.save(work, self.places, self.check, self._send)
            case PaintOpenRequest() as work:
                self.painter.open(work, payload, self.check, self._send)
            case PaintSummaryRequest() as work:
                self.painter.summarise(work, self.check, self._send)
            case PaintDabRequest() as work:
                self.painter.paint(work, payload, self._send)
            case PhotoRequest() as work:
                self.photographer.answer(work, self.check, self._send)
            case KeepPhotoWork() as work:
                self.photographer.keep(work, self._send)
            case LatticeRequest() as work:
                self.lattices.follow(work, self._send)
            case AlternativesRequest() as work:
                corrections.alternatives(work, self.places, self.check, self._send)
            case InsightWork() as work:
                corrections.insight(work, self.places, self._send)
            case ThumbnailWork() as work:
                thumbnails.send(work, self.places, self._send)
            case PictureWork() as work:
                decoding.encode(work, self.places, self._send)
            case LayersWork() as work:
                layers.layers(work, self._send)
            case MeshWork() as work:
                surfaces.mesh(work, self.places, self.check, self._send)
            case TileWork() as work:
                self.tiler.send(work, self._send)
            case EndlessWork() as work:
                self.endless.send(work, self.check, self._send)
            case KeepWork() as work:
                decoding.keep(work, self.places, self._send)

    def check(self) -> None:
        """`WorkAborted` if the work has been cancelled."""
        if self.is_cancelled.is_set():
            raise WorkAborted

    def _send(self, message: Message, payload: bytes = b"") -> None:
        try:
            self.connection.send_bytes(packed(message, payload))
        except OSError:
            os._exit(0)


def _problem(error: BaseException) -> str:
    """What went wrong, in a line, and what to do about a full disk."""
    cause: BaseException | None = error
    while cause is not None:
        if any(os.strerror(code) in str(cause) for code in (errno.ENOSPC, errno.EDQUOT)):  # OpenEXR only says so
            return "the disk is full; free some space and try again: finished steps are kept"
        cause = cause.__cause__ or cause.__context__
    return one_line(f"{type(error).__name__}: {error}")
