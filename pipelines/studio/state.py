"""What the requests of a studio share."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import anyio.to_thread

from texloom.pipelines.flow.items import MOST_NAMES
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.jobs import Jobs
from texloom.pipelines.studio.library import is_painted
from texloom.pipelines.studio.messages.catalogue import Picture
from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.messages.projects import Material, MaterialChanged, ProjectSaved
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PreviewRequest
from texloom.pipelines.studio.messages.runs import Job
from texloom.pipelines.studio.processes import Spares, WorkCancelledError, WorkerProcess
from texloom.pipelines.studio.projects.files import ProjectFiles
from texloom.pipelines.studio.projects.project import Project, stem
from texloom.pipelines.studio.projects.saving import Saver
from texloom.pipelines.studio.sessions import Sessions
from texloom.pipelines.studio.work import Places, ThumbnailWork, library_of
from texloom.stages.vocabulary.declare import InputError

_GONE = "its files are no longer in the store; trying again makes the same once more"
_MOST_PICTURES = 64  # of a material that are described


class Studio:
    """The project, its runs, and the processes that work for all pages."""

    def __init__(self, places: Places, files: ProjectFiles):
        """`InputError` where the project cannot be read."""
        self.places = places
        self.library = library_of(places)
        self.store = Store(Path(places.store))
        self.jobs = Jobs(places)
        self.reader = WorkerProcess(places)
        """decodes pictures"""
        practice = Recipe(
            flow="self_tuning", sources={"exemplar": "texloom:bricks"}, size=(64, 64), tileable="both"
        )
        self.spares = Spares(places, PreviewRequest(number=0, recipe=practice))
        self.tiler = WorkerProcess(places)
        """makes tiles, and texture coordinates of meshes"""
        self.keeper = WorkerProcess(places)
        """takes files, writes them, and reads results, so that thumbnails need not wait for these"""
        self.sessions = Sessions(self.jobs, self.spares, places)
        self.opened: dict[str, str] = {}
        """the pictures that are looked at, by the key of `ExrContents`"""
        self.receiving: dict[str, Path] = {}
        self.files = files
        self.saver = Saver(files, lambda problem: self._tell(ProjectSaved(problem=problem)))
        view = files.read_view()
        materials, self.unread = files.read_materials()
        self.project = self.saver.project = Project(view, materials, self._changed)
        self.jobs.watch = self._watch
        self._tasks: set[asyncio.Task[None]] = set()

    def begin(self) -> None:
        """Go on with what an earlier server has not finished."""
        for job in self.project.interrupted():
            self.jobs.queue(job)

    def job(self, job: str) -> Job | None:
        """A run of this server or an earlier one."""
        variant = self.project.variant(job)
        if job not in self.jobs.jobs and variant is not None:
            folder = self.store.root / "runs" / variant.folder
            is_there = bool(variant.folder) and folder.is_dir() and not folder.is_symlink()
            kept = variant.job
            if kept.state == "done" and not is_there:
                kept = kept.model_copy(update={"state": "cancelled", "text": _GONE, "files": (), "maps": {}})
            self.jobs.restore(kept, folder if is_there else None)
        return self.jobs.jobs.get(job)

    def deliver(self, recipe: Recipe, job: str) -> Job:
        """Queue a run that writes what a run has made for a program; it is no result of its own."""
        owner = self.project.owner(job)
        if owner is None:
            return self.jobs.queue(self.jobs.new(self.jobs.jobs[job].name, recipe))
        named = recipe.model_copy(update={"material": stem(owner.name)})
        return self.jobs.queue(self.jobs.new(self.project.export_name(job), named))

    def make(self, recipe: Recipe, material: str, parent: str) -> Job:
        """Queue a run, whose result is one of a material; of a new one where it is of none."""
        owner = self.project.material(material) if material else self.project.matching(recipe)
        owner = owner or self.project.create(self.name_of(recipe), recipe)
        parent = parent if parent in {one.job.id for one in owner.variants} else ""
        job = self.jobs.new("", recipe)
        self.project.add(owner.id, job, parent)
        job = job.model_copy(update={"name": self.project.export_name(job.id)})
        self.project.update(job)
        return self.jobs.queue(job)

    def name_of(self, recipe: Recipe) -> str:
        """What a material is called after the picture, or the first ones of several, that it begins with."""
        given = next(iter(recipe.sources.values()), "")
        try:
            names = map(self._name_of_picture, (given,) if isinstance(given, str) else given[:MOST_NAMES])
            return " ".join(dict.fromkeys(names))
        except InputError:
            return recipe.flow.replace("_", " ")

    def _name_of_picture(self, picture: str) -> str:
        """Its own, or that of the material of which it is a result."""
        made_it = self.project.with_result(picture)
        return self.library.name_of(picture) if made_it is None else made_it.name

    def renamed(self, material: Material) -> Material:
        """Call the files of its runs after a material."""
        for variant in material.variants:
            name = self.project.export_name(variant.job.id)
            if variant.job.id in self.jobs.jobs:
                self.jobs.rename(variant.job.id, name)
            elif variant.job.name != name:
                self.project.update(variant.job.model_copy(update={"name": name}))
        return self.project.material(material.id)

    def pictures_of(self, material: Material) -> tuple[tuple[Picture, ...], tuple[str, ...]]:
        """The pictures that a material is made from, but no painted ones, and why others cannot be read."""
        begun = (material.draft, *(one.job.recipe for one in material.variants if not one.parent))
        ids = {
            picture: None
            for recipe in begun
            if recipe is not None
            for given in recipe.sources.values()
            for picture in ((given,) if isinstance(given, str) else given)
            if not is_painted(picture)
        }
        found, missing = [], []
        for picture in list(ids)[:_MOST_PICTURES]:
            try:
                found.append(self.library.picture(picture))
            except InputError as error:
                missing.append(str(error))
        return tuple(found), tuple(missing)

    async def thumbnail(self, job: str) -> bytes | None:
        """What a result looks like, as a PNG; none where it is not there."""
        found = self.files.thumbnail(job)
        made = self.job(job)
        folder = self.jobs.folders.get(job)
        if found is None and made is not None and made.state == "done" and folder is not None:
            _, payload = unpacked(await self.keeper.answer(ThumbnailWork(folder=str(folder))))
            found = bytes(payload)
            await anyio.to_thread.run_sync(self.files.write_thumbnail, job, found)
        return found

    def _watch(self, job: Job, folder: Path | None) -> None:
        """Keep the state of a run in its material, and what it looks like."""
        before = self.project.variant(job.id)
        self.project.update(job, folder.name if folder is not None else "")
        if before is not None and before.job.state != job.state:
            if (owner := self.project.owner(job.id)) is not None:
                self._tell(MaterialChanged(id=owner.id))
            if job.state == "done":
                task = asyncio.create_task(self._prepare(job.id))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _prepare(self, job: str) -> None:
        with contextlib.suppress(InputError, WorkCancelledError):
            await self.thumbnail(job)

    def _changed(self, material: str) -> None:
        self.saver.want(material)
        if material:
            self._tell(MaterialChanged(id=material))

    def _tell(self, message: MaterialChanged | ProjectSaved) -> None:
        self.jobs.broadcast(packed(message))
