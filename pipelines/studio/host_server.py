"""The server for other programs: pictures in, runs, pictures out. The protocol is on docs/bridge.md."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.metadata
import json
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.responses import FileResponse, JSONResponse

from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.pipelines.studio.host_runs import EXPORTS, MAP
from texloom.pipelines.studio.library import MOST_BYTES, safe_name
from texloom.pipelines.studio.messages.catalogue import Problem
from texloom.pipelines.studio.messages.hosts import (
    HEADER,
    PROTOCOL,
    Hello,
    HostRun,
    OnePicture,
    OneSource,
    PixelFormat,
    Submitted,
)
from texloom.pipelines.studio.messages.message import unpacked
from texloom.pipelines.studio.run_queue import RunQueue
from texloom.pipelines.studio.security import Codes, Guard
from texloom.pipelines.studio.server import add_errors
from texloom.pipelines.studio.work import HostRan, HostWork, Places, Received, Running
from texloom.stages.vocabulary.declare import InputError

HELP = "the token is wrong: read it from the line that the running `texloom serve` has printed\n"
MOST_KEPT = 64  # pictures, and runs that have ended; the oldest go
MOST_KEPT_BYTES = 2**32  # of the pictures that no run waits for; the oldest go, never the latest
MOST_WAITING_BYTES = 2**33  # of the pictures that runs wait for
MOST_WAITING = 256  # runs
LONGEST_WAIT = 20.0  # seconds until a request that waits for changes is answered without


class HostRuns(RunQueue[HostRun]):
    """The runs of programs since the server was started, and the pictures that they have sent."""

    def __init__(self, places: Places):
        super().__init__(places)
        self.received: dict[str, Received] = {}
        self.previews: dict[str, bytes] = {}
        self._root = Path(places.scratch)
        self._submitted: dict[str, HostWork] = {}
        self._changed = asyncio.Condition()
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self) -> None:
        """Start the worker ahead of the first run."""
        self._worker.start()

    def new_file(self, name: str) -> Path:
        """A place for a picture that is being received, in a folder of its own."""
        folder = self._root / f"picture-{secrets.token_hex(8)}"
        folder.mkdir()
        return folder / (name or "pixels.raw")

    def keep(self, file: Path, pixels: PixelFormat | None) -> str:
        """Take a picture that has been received; its id. Of those that no run waits for, the oldest go.

        Raises
        ------
        InputError : the pictures that runs wait for take too much already.
        """
        open_runs = [self._submitted[job.id] for job in self.jobs.values() if not _has_ended(job)]
        waiting = {one for run in open_runs for one in run.received}
        sizes = {one: Path(kept.path).stat().st_size for one, kept in self.received.items()}
        if sum(sizes[one] for one in waiting & sizes.keys()) > MOST_WAITING_BYTES:
            told = f"the pictures of runs that wait take more than {MOST_WAITING_BYTES / 2**30:g} GiB"
            raise InputError(f"{told}; wait for one of them, cancel it, or send paths")
        self.received[file.parent.name] = Received(path=str(file), pixels=pixels)
        idle = [one for one in sizes if one not in waiting]
        room, count = MOST_KEPT_BYTES - file.stat().st_size, 1
        for one in reversed(idle):
            room, count = room - sizes[one], count + 1
            if room < 0 or count > MOST_KEPT:
                shutil.rmtree(Path(self.received.pop(one).path).parent, ignore_errors=True)
        return file.parent.name

    def submit(self, asked: Submitted) -> HostRun:
        """Queue a run.

        Raises
        ------
        InputError : a picture was not sent, or too many runs wait.
        """
        if sum(not _has_ended(job) for job in self.jobs.values()) >= MOST_WAITING:
            raise InputError(f"{MOST_WAITING} runs wait already; wait for one of them or cancel it")
        ended = [one for one, job in self.jobs.items() if _has_ended(job)]
        for one in ended[:-MOST_KEPT]:
            self.forget(one)
        needed = [one for given in asked.sources.values() for one in _ids(given)]
        if missing := [one for one in needed if one not in self.received]:
            kept = f"the latest {MOST_KEPT} are kept, of at most {MOST_KEPT_BYTES / 2**30:g} GiB"
            raise InputError(one_line(f"{missing[0]}: was not sent, or is gone: {kept}; send it again"))
        job = HostRun(id=f"run-{secrets.token_hex(8)}", flow=asked.flow, state="waiting")
        folder = self._root / job.id
        folder.mkdir()
        received = {one: self.received[one] for one in needed}
        self._submitted[job.id] = HostWork(submitted=asked, received=received, folder=str(folder))
        return self._queue(job)

    def forget(self, job: str) -> None:
        """Remove a run that has ended, with its results."""
        del self.jobs[job]
        self.previews.pop(job, None)
        shutil.rmtree(self._submitted.pop(job).folder, ignore_errors=True)

    async def changed(self, job: str, seen: int, seconds: float) -> HostRun:
        """A run, as soon as it has changed more than ``seen`` times, or after some seconds."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(min(max(seconds, 0.0), LONGEST_WAIT)), self._changed:
                await self._changed.wait_for(lambda: job not in self.jobs or self.jobs[job].changes > seen)
        return known(self, job)

    def file(self, job: str, name: str) -> Path:
        """A file in the folder of a run's results; 404 where the run has none of that name."""
        run = known(self, job)
        maps = {MAP.format(one.name): one.name for one in run.maps}
        if name not in maps and name not in {f"{EXPORTS}/{one}" for one in run.files}:
            raise HTTPException(404)
        return Path(self._submitted[job].folder) / name

    def _work_of(self, job: str) -> HostWork:
        return self._submitted[job]

    def _on_frame(self, job: str, frame: bytes) -> None:
        header, payload = unpacked(frame)
        with contextlib.suppress(ValueError):
            ran = HostRan.model_validate_json(header)
            self._change(job, maps=ran.maps, files=ran.files, notes=ran.notes, scores=ran.scores)
            return
        running = Running.model_validate_json(header)
        changes: dict[str, Any] = {"step": running.step, "text": running.text, "done": running.done}
        if running.height:
            self.previews[job] = bytes(payload)
            shape = (running.height, running.width, 4)
            changes["preview"] = PixelFormat(shape=shape, dtype="uint8", color_space="srgb")
            changes["previews"] = self.jobs[job].previews + 1
        self._change(job, **changes)

    def _tell(self, job: HostRun) -> None:
        self.jobs[job.id] = job.model_copy(update={"changes": job.changes + 1})
        task = asyncio.create_task(self._notify())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _notify(self) -> None:
        async with self._changed:
            self._changed.notify_all()


def known(runs: HostRuns, job: str) -> HostRun:
    """A run by its id; 404 where there is none."""
    if job not in runs.jobs:
        raise HTTPException(404)
    return runs.jobs[job]


def _has_ended(job: HostRun) -> bool:
    return job.state not in ("waiting", "running")


def _ids(given: OneSource | list[OneSource]) -> list[str]:
    if isinstance(given, list):
        return [one for source in given for one in _ids(source)]
    if isinstance(given, str):
        return []
    return [given.picture] if isinstance(given, OnePicture) else list(given.maps.values())


def host_application(places: Places, port: int) -> Guard:
    """The whole server, for `uvicorn`."""
    runs = HostRuns(places)

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        runs.start()
        work = asyncio.create_task(runs.work())
        yield
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)

    app = FastAPI(lifespan=lifespan, openapi_url=None, docs_url=None, redoc_url=None)
    add_errors(app, files="/pictures")
    _add_runs(app, runs)
    _add_results(app, runs)

    @app.exception_handler(404)
    async def missing(request: Request, _: HTTPException) -> JSONResponse:
        problem = one_line(f"{request.url.path}: there is no such thing")
        return JSONResponse(Problem(problem=problem).model_dump(), 404)

    @app.middleware("http")
    async def versioned(request: Request, call_next):  # type: ignore[no-untyped-def]
        theirs = request.headers.get(HEADER, "")
        if theirs != str(PROTOCOL):
            told = f"this texloom speaks protocol {PROTOCOL}, the client {theirs or 'none'}"
            problem = f"{told}; write its file anew: texloom client > texloom_client.py"
            return JSONResponse(Problem(problem=one_line(problem)).model_dump(), 426)
        return await call_next(request)

    return Guard(app, Codes(lambda _: None), port, HELP)


def _add_runs(app: FastAPI, runs: HostRuns) -> None:
    @app.get("/hello")
    def hello() -> Hello:
        return Hello(protocol=PROTOCOL, version=importlib.metadata.version("texloom"), flows=tuple(shipped_flows()))

    @app.post("/pictures")
    async def picture(
        request: Request, name: str = "", shape: str = "", dtype: str = "", color_space: str = ""
    ) -> str:
        if name and safe_name(name) != name:
            raise InputError(one_line(f"name: {name} is no name of a file"))
        pixels = None if name else PixelFormat.of(shape, dtype, color_space)
        file, size = runs.new_file(name), 0
        try:
            with file.open("wb") as opened:
                async for chunk in request.stream():
                    size += len(chunk)
                    if size > MOST_BYTES:
                        raise InputError(f"a picture is larger than {MOST_BYTES // 2**20} MiB; send its path")
                    await anyio.to_thread.run_sync(opened.write, chunk)
            if pixels is not None and size != pixels.size:
                raise InputError(f"shape: {shape} of {dtype} are {pixels.size} bytes, but {size} were sent")
            return runs.keep(file, pixels)
        except BaseException:  # such as a full disk, or a program that has ended
            shutil.rmtree(file.parent, ignore_errors=True)
            raise

    @app.post("/runs")
    async def submit(asked: Submitted) -> HostRun:
        return known(runs, runs.submit(asked).id)

    @app.get("/runs/{job}")
    async def status(job: str, seen: int = -1, seconds: float = 0.0) -> HostRun:
        return await runs.changed(job, seen, seconds)

    @app.delete("/runs/{job}")
    async def cancel(job: str) -> None:
        if _has_ended(known(runs, job)):
            runs.forget(job)
        else:
            runs.cancel(job)


def _add_results(app: FastAPI, runs: HostRuns) -> None:
    @app.get("/runs/{job}/preview")
    async def preview(job: str) -> Response:
        pixels = known(runs, job).preview
        if pixels is None:
            raise HTTPException(404)
        return Response(runs.previews[job], headers=_described(pixels), media_type="application/octet-stream")

    @app.get("/runs/{job}/maps/{name}")
    async def result(job: str, name: str) -> FileResponse:
        file = runs.file(job, MAP.format(name))
        pixels = next(one.pixels for one in runs.jobs[job].maps if one.name == name)
        return FileResponse(file, headers=_described(pixels), media_type="application/octet-stream")

    @app.get("/runs/{job}/files/{name:path}")
    async def exported(job: str, name: str) -> FileResponse:
        file = runs.file(job, f"{EXPORTS}/{name}")
        if not file.is_file():
            raise HTTPException(404)
        return FileResponse(file, media_type="application/octet-stream")


def _described(pixels: PixelFormat) -> dict[str, str]:
    return {"x-texloom-pixels": json.dumps(pixels.model_dump())}
