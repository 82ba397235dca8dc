"""Requests about the project and its materials."""

from __future__ import annotations

import anyio.to_thread
from fastapi import FastAPI, HTTPException, Response

from texloom.pipelines.studio.messages.projects import (
    Material,
    MaterialRequest,
    OpenMaterial,
    ProjectState,
    ProjectView,
    ProjectViewRequest,
    Sorting,
    Wall,
)
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.projects.wall import wall
from texloom.pipelines.studio.state import Studio

_FOREVER = {"cache-control": "private, max-age=31536000, immutable"}
"""a result never looks otherwise"""


def add_project(app: FastAPI, studio: Studio) -> None:
    """Answer requests about the project."""

    @app.get("/api/project")
    async def state() -> ProjectState:
        project = studio.project
        return ProjectState(
            name=studio.files.folder.name,
            place=str(studio.files.place),
            view=project.view,
            materials=sum(not one.is_deleted for one in project.materials.values()),
            problem=studio.saver.problem,
        )

    @app.post("/api/project/view")
    async def look(view: ProjectViewRequest) -> None:
        studio.project.look(ProjectView(view=view.view, material=view.material))

    @app.get("/api/materials")
    async def materials(
        search: str = "", tag: str = "", favourites: bool = False, deleted: bool = False,
        sorting: Sorting = "changed", first: int = 0, count: int = 60,
    ) -> Wall:  # fmt: skip
        return wall(
            studio.project, studio.unread, search=search, tag=tag, favourites=favourites, deleted=deleted,
            sorting=sorting, first=first, count=count,
        )  # fmt: skip

    @app.post("/api/materials")
    async def create(recipe: Recipe) -> Material:
        return studio.project.create(studio.name_of(recipe), recipe)

    @app.get("/api/materials/{material}")
    async def one(material: str) -> OpenMaterial:
        found = studio.project.material(material)
        pictures, missing = await anyio.to_thread.run_sync(studio.pictures_of, found)
        jobs = {variant.job.id: studio.job(variant.job.id) or variant.job for variant in found.variants}
        variants = tuple(one.model_copy(update={"job": jobs[one.job.id]}) for one in found.variants)
        return OpenMaterial(
            material=found.model_copy(update={"variants": variants}), pictures=pictures, missing=missing
        )

    @app.post("/api/materials/{material}")
    async def edit(material: str, change: MaterialRequest) -> Material:
        before = studio.project.material(material)
        is_new = change.draft is not None and _beginning(change.draft) != _beginning(before.draft)
        name = studio.name_of(change.draft) if is_new and change.draft is not None else ""
        after = studio.project.edit(material, change, name)
        return after if after.name == before.name else studio.renamed(after)

    @app.post("/api/materials/{material}/duplicate")
    async def duplicate(material: str) -> Material:
        return studio.project.duplicate(material)

    @app.get("/api/thumbnails/{job}")
    async def thumbnail(job: str) -> Response:
        found = await studio.thumbnail(job)
        if found is None:
            raise HTTPException(404)
        return Response(found, media_type="image/png", headers=_FOREVER)


def _beginning(recipe: Recipe | None) -> str | tuple[str, ...]:
    """The picture, or several, that a recipe begins with."""
    return next(iter(recipe.sources.values()), "") if recipe is not None else ""
