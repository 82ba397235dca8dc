"""The wall: which materials are shown, in which order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from texloom.pipelines.studio.messages.projects import Material, Sorting, Wall, WallEntry
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.projects.project import Project

MOST_SHOWN = 120
"""at a time"""


def wall(
    project: Project, problems: Sequence[str], *, search: str = "", tag: str = "", favourites: bool = False,
    deleted: bool = False, sorting: Sorting = "changed", first: int = 0, count: int = 60,
) -> Wall:  # fmt: skip
    """The materials that a search finds, from the ``first`` on, at most ``count``."""
    kept = [one for one in project.materials.values() if not one.is_deleted]
    thrown = [one for one in project.materials.values() if one.is_deleted]
    words = search.casefold().split()
    found = [
        one
        for one in (thrown if deleted else kept)
        if all(word in _text(one) for word in words)
        and (not tag or tag in one.tags)
        and (not favourites or one.is_favourite)
    ]
    if sorting == "name":
        found.sort(key=lambda one: (one.name.casefold(), one.id))
    else:
        found.sort(key=lambda one: (-getattr(one, sorting), one.id))
    shown = found[max(0, first) :][: min(max(1, count), MOST_SHOWN)]
    return Wall(
        shown=tuple(_entry(one) for one in shown),
        first=max(0, first),
        found=len(found),
        kept=len(kept),
        deleted=len(thrown),
        tags=dict(sorted(Counter(name for one in kept for name in one.tags).items())),
        problems=tuple(problems),
    )


def _text(material: Material) -> str:
    """What is searched."""
    return " ".join((material.name, *material.tags, _flow(material).replace("_", " "))).casefold()


def _flow(material: Material) -> str:
    if material.draft is not None:
        return material.draft.flow
    return material.variants[0].job.recipe.flow if material.variants else ""


def _entry(material: Material) -> WallEntry:
    done = [one.job.id for one in material.variants if one.job.state == "done"]
    cover = material.shown if material.shown in done else done[-1] if done else ""
    return WallEntry(
        id=material.id,
        name=material.name,
        tags=material.tags,
        is_favourite=material.is_favourite,
        is_deleted=material.is_deleted,
        flow=_flow(material),
        changed=material.changed,
        results=len(material.variants),
        is_running=any(one.job.state in ("waiting", "running") for one in material.variants),
        cover=cover,
        picture=first_picture(material.draft),
    )


def first_picture(recipe: Recipe | None) -> str:
    """The id of the picture that a recipe begins with; empty where it has none."""
    given = next(iter(recipe.sources.values()), "") if recipe is not None else ""
    return given if isinstance(given, str) else given[0]
