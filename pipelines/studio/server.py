"""The server: the page, pictures, runs and their files. Everything that the page does goes through here."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.metadata
import io
import json
import shutil
import zipfile
from collections.abc import AsyncIterator, Callable, Iterable
from pathlib import Path
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, HTTPException, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.middleware.gzip import GZipMiddleware
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles

from texloom.pipelines.flow.shipped import flow_catalogue
from texloom.pipelines.media.delivery import LAYOUTS
from texloom.pipelines.media.meshes import SUFFIXES
from texloom.pipelines.studio import methods, past_runs, recipe_flows, work
from texloom.pipelines.studio.built_page import BUILT
from texloom.pipelines.studio.library import MOST_BYTES, PAGE, safe_name
from texloom.pipelines.studio.listing import PictureSorting
from texloom.pipelines.studio.messages.catalogue import Picture, PicturePage, Problem, Start
from texloom.pipelines.studio.messages.message import unpacked
from texloom.pipelines.studio.messages.recipes import KeptPhoto, PhotoRecipe, Recipe
from texloom.pipelines.studio.messages.runs import Described, ExrContents, FlowEntry, Job, PastRuns, PastStep
from texloom.pipelines.studio.page_words import page_words
from texloom.pipelines.studio.projects.files import ProjectFiles
from texloom.pipelines.studio.projects.routes import add_project
from texloom.pipelines.studio.security import Codes, Guard
from texloom.pipelines.studio.state import Studio
from texloom.pipelines.studio.work import (
    EndlessWork,
    InsightWork,
    KeepPhotoWork,
    KeepWork,
    Kept,
    LayersWork,
    MeshWork,
    PictureWork,
    Places,
    SaveWork,
    TileWork,
)
from texloom.stages.vocabulary.declare import InputError

_MOST_JSON = 2**20  # bytes of a request that is no file
_MOST_FILES = 32  # that are dropped together
_THUMBNAIL = 2048  # px, the largest


def application(places: Places, codes: Codes, port: int, files: ProjectFiles) -> Guard:
    """The whole server, for `uvicorn`; `InputError` where the project cannot be read."""
    studio = Studio(places, files)

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(one) for one in (studio.jobs.work(), studio.saver.work())]
        studio.begin()
        for one in (studio.reader, studio.keeper, studio.tiler):
            one.start()
        studio.spares.prepare()
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        studio.project.pause()
        studio.saver.flush()
        studio.reader.kill()
        studio.tiler.kill()
        studio.keeper.kill()
        await studio.sessions.end()
        await studio.spares.end()

    app = FastAPI(lifespan=lifespan, openapi_url=None, docs_url=None, redoc_url=None)
    add_errors(app, files="/api/received", words=page_words)
    add_project(app, studio)
    _add_library(app, studio)
    _add_recipes(app, studio)
    _add_jobs(app, studio)
    _add_results(app, studio)

    @app.websocket("/api/socket")
    async def socket(socket: WebSocket, page: str = "") -> None:
        await studio.sessions.serve(socket, page)

    @app.get("/")
    async def page() -> FileResponse:
        return FileResponse(BUILT / "index.html")

    app.mount("/", GZipMiddleware(StaticFiles(directory=BUILT)))
    return Guard(app, codes, port)


def add_errors(app: FastAPI, files: str, words: Callable[[str], str] = str) -> None:
    """Answer each refusal in one line, and bound requests; files go to addresses that begin with ``files``.

    ``words``: how a problem is told.
    """

    @app.exception_handler(InputError)
    async def refuse(_: Request, error: InputError) -> JSONResponse:
        return JSONResponse(Problem(problem=words(str(error))).model_dump(), 422)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"][1:])
        return JSONResponse(Problem(problem=f"{place}: {first['msg']}").model_dump(), 422)

    @app.exception_handler(OSError)
    async def failed(_: Request, error: OSError) -> JSONResponse:
        return JSONResponse(Problem(problem=f"{error.strerror or error}").model_dump(), 500)

    @app.middleware("http")
    async def bounded(request: Request, call_next):  # type: ignore[no-untyped-def]
        length = request.headers.get("content-length", "0")
        is_file = request.url.path.startswith(files)  # whose bytes are counted as they arrive
        largest = MOST_BYTES if is_file else _MOST_JSON
        if "transfer-encoding" in request.headers and not is_file:
            return JSONResponse(Problem(problem="tell the length of the request").model_dump(), 411)
        if request.method != "GET" and (not length.isdigit() or int(length) > largest):
            return JSONResponse(Problem(problem=f"larger than {largest} bytes").model_dump(), 413)
        return await call_next(request)


def _add_library(app: FastAPI, studio: Studio) -> None:
    @app.get("/api/start")
    def start() -> Start:
        return Start(
            folder=studio.places.folder,
            store=studio.places.store,
            version=importlib.metadata.version("texloom"),
            listed=studio.library.pictures(),
            examples=tuple(studio.library.examples()),
            meshes=tuple(studio.library.meshes()),
            mesh_suffixes=SUFFIXES,
            methods=tuple(methods.methods()),
            layouts=LAYOUTS,
        )

    @app.get("/api/pictures")
    async def picture(id: str, side: int = 512) -> Response:
        wanted = PictureWork(picture=id, side=min(max(side, 16), _THUMBNAIL))
        _, payload = unpacked(await studio.reader.answer(wanted))
        return Response(bytes(payload), media_type="image/png")

    @app.get("/api/library")
    def pictures(
        search: str = "", folder: str = "", sorting: PictureSorting = "name", first: int = 0, count: int = PAGE
    ) -> PicturePage:
        return studio.library.pictures(search, folder, sorting, first, count)

    @app.post("/api/receiving")
    def begin() -> str:
        folder = studio.library.new_folder()
        studio.receiving[folder.name] = folder
        return folder.name

    @app.put("/api/received/{key}/{name}")
    async def receive(key: str, name: str, request: Request) -> None:
        folder = studio.receiving.get(key)
        if folder is None or not safe_name(name):
            raise HTTPException(404)
        if sum(1 for _ in folder.iterdir()) >= _MOST_FILES:
            raise InputError(f"more than {_MOST_FILES} files at once; drop one picture or one folder of maps")
        size = 0
        try:
            with (folder / safe_name(name)).open("wb") as file:
                async for chunk in request.stream():
                    size += len(chunk)
                    if size > MOST_BYTES:
                        raise InputError(f"{name}: is larger than {MOST_BYTES // 2**20} MB")
                    await anyio.to_thread.run_sync(file.write, chunk)
        except (InputError, OSError):  # such as a full disk
            shutil.rmtree(studio.receiving.pop(key), ignore_errors=True)
            raise

    @app.post("/api/received/{key}")
    async def keep(key: str, name: str = "") -> Picture:
        picture = (await _kept(studio, key, name=name)).picture
        assert picture is not None
        return picture

    @app.post("/api/received/{key}/mesh")
    async def keep_mesh(key: str) -> str:
        return (await _kept(studio, key, is_mesh=True)).id

    @app.post("/api/documents/{name}")
    def document(name: str, content: dict[str, Any]) -> str:
        return studio.library.keep_document(json.dumps(content).encode(), name)


async def _kept(studio: Studio, key: str, **how: Any) -> Kept:
    """Take what was received under a key into the library."""
    folder = studio.receiving.pop(key, None)
    if folder is None:
        raise HTTPException(404)
    try:
        header, _ = unpacked(await studio.keeper.answer(KeepWork(received=str(folder), **how)))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return Kept.model_validate_json(header)


def _add_recipes(app: FastAPI, studio: Studio) -> None:
    @app.post("/api/photographs")
    async def photograph(recipe: PhotoRecipe) -> KeptPhoto:
        header, _ = unpacked(await studio.keeper.answer(KeepPhotoWork(recipe=recipe)))
        return KeptPhoto.model_validate_json(header)

    @app.post("/api/described")
    def describe(recipe: Recipe) -> Described:
        return recipe_flows.described(
            recipe, recipe_flows.open_recipe(recipe, studio.library, studio.store), studio.library
        )


def _add_jobs(app: FastAPI, studio: Studio) -> None:
    @app.post("/api/jobs")
    async def add(recipe: Recipe, material: str = "", parent: str = "", delivers: str = "") -> Job:
        open_recipe = recipe_flows.open_recipe
        await anyio.to_thread.run_sync(open_recipe, recipe, studio.library, studio.store)
        if delivers:
            _known(studio, delivers)
            return studio.deliver(recipe, delivers)
        return studio.make(recipe, material, parent)

    @app.delete("/api/jobs/{job}")
    async def cancel(job: str) -> None:
        _known(studio, job)
        studio.jobs.cancel(job)

    @app.post("/api/jobs/{job}/again")
    async def again(job: str) -> Job:
        _known(studio, job)
        return studio.jobs.again(job)

    @app.post("/api/jobs/{job}/saved")
    async def save(job: str) -> Job:
        if (found := _known(studio, job)).state != "done":
            raise HTTPException(404)
        studio.project.check_folder(job, found.name)
        header, _ = unpacked(await studio.keeper.answer(SaveWork(recipe=found.recipe, name=found.name)))
        studio.project.saved_in(job, found.name)
        return studio.jobs.saved(job, work.Saved.model_validate_json(header).out)

    @app.get("/api/jobs/{job}/insight")
    async def insight(job: str) -> Response:
        frame = await studio.keeper.answer(InsightWork(recipe=_known(studio, job).recipe))
        return Response(frame, media_type="application/octet-stream")

    @app.get("/api/jobs/{job}/files/{name:path}")
    def file(job: str, name: str) -> Response:
        folder = _exports(studio, job, name)
        path = folder / name.rstrip("/")
        if path.is_dir():
            return Response(_zipped(path, [path]), media_type="application/zip")
        headers = {"content-security-policy": "sandbox allow-scripts"} if path.suffix == ".html" else None
        return FileResponse(path, headers=headers)

    @app.get("/api/jobs/{job}/all")
    def all_files(job: str) -> Response:
        files = _known(studio, job).files
        if not files:
            raise HTTPException(404)
        folder = _exports(studio, job, files[0])
        paths = [folder / name.rstrip("/") for name in files]
        return Response(_zipped(folder, paths), media_type="application/zip")


def _add_results(app: FastAPI, studio: Studio) -> None:
    root = studio.store.root

    @app.get("/api/runs")
    def runs() -> PastRuns:
        return past_runs.past_runs(root)

    @app.get("/api/runs/{run}")
    def steps(run: str) -> list[PastStep]:
        return past_runs.steps_of(root, run)

    @app.get("/api/flows")
    def flows() -> list[FlowEntry]:
        return [FlowEntry(name=name, about=one.about) for name, one in flow_catalogue().items() if one.listed]

    @app.get("/api/results/{key}/{file}")
    def result(key: str, file: str) -> FileResponse:
        return FileResponse(past_runs.artifact_file(root, key, file))

    @app.get("/api/layers")
    async def layers(item: str) -> ExrContents:
        file = _looked_at(studio, item)
        header, _ = unpacked(await studio.tiler.answer(LayersWork(file=file)))
        described = work.LayersRead.model_validate_json(header).layers
        studio.opened[described.key] = file
        return described

    @app.get("/api/meshes")
    async def mesh(id: str, side: int = 1024) -> Response:
        _, payload = unpacked(await studio.tiler.answer(MeshWork(mesh=id, side=min(max(side, 64), 8192))))
        return Response(bytes(payload), media_type="application/octet-stream")

    @app.get("/api/tiles/{key}/{layer}/{level}/{row}/{column}")
    async def tile(key: str, layer: int, level: int, row: int, column: int) -> Response:
        if key not in studio.opened:
            raise HTTPException(404)
        wanted = TileWork.model_validate(
            {"key": key, "file": studio.opened[key], "layer": layer, "level": level, "row": row, "column": column}
        )
        _, payload = unpacked(await studio.tiler.answer(wanted))
        return Response(bytes(payload), media_type="image/png")

    @app.get("/api/endless/{job}/{level}/{row}/{column}")
    async def endless(job: str, level: int, row: int, column: int) -> Response:
        recipe = _known(studio, job).recipe
        wanted = EndlessWork.model_validate({"recipe": recipe, "level": level, "row": row, "column": column})
        _, payload = unpacked(await studio.tiler.answer(wanted))
        return Response(bytes(payload), media_type="image/png")


def _looked_at(studio: Studio, item: str) -> str:
    """The file of ``job:ID:FILE``, the EXR of ``result:KEY``, or a picture of the library as flows refer to it."""
    kind, _, name = item.partition(":")
    if kind == "job":
        job, _, file = name.partition(":")
        return str(_exports(studio, job, file) / file)
    if kind == "result":
        return str(past_runs.artifact_file(studio.store.root, name, "result.exr"))
    return studio.library.reference(item)


def _known(studio: Studio, job: str) -> Job:
    """A run of this server or an earlier one."""
    found = studio.job(job)
    if found is None:
        raise HTTPException(404)
    return found


def _exports(studio: Studio, job: str, name: str) -> Path:
    """The folder of a run that has exported ``name``, which is in it whatever the files of the project say."""
    found = _known(studio, job)
    folder = studio.jobs.folders.get(job)
    if folder is None or name not in {*found.files, *found.maps.values()}:
        raise HTTPException(404)
    path = (folder / name).resolve()
    if not path.exists() or not path.is_relative_to(folder.resolve()) or path == folder.resolve():
        raise HTTPException(404)
    return folder


def _zipped(folder: Path, paths: Iterable[Path]) -> bytes:
    """Files, and those in folders, by their names in ``folder``."""
    found = {file for path in paths for file in (path.rglob("*") if path.is_dir() else [path]) if file.is_file()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(found):
            archive.write(path, path.relative_to(folder))
    return buffer.getvalue()
