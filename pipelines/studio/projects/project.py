"""The materials of a project: what can be done with them, and which of them have to be saved."""

from __future__ import annotations

import re
import secrets
import time
import unicodedata
from collections.abc import Callable, Iterable
from typing import Any

from texloom.pipelines.errors import one_line
from texloom.pipelines.studio.messages.projects import (
    MOST_VARIANTS,
    Material,
    MaterialRequest,
    ProjectView,
    Variant,
)
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Job
from texloom.stages.vocabulary.declare import InputError

_LONGEST = 56
"""characters of a name that is made, so that a number has room behind it"""
_CORRECTION = "revise"
_INTERRUPTED = "the studio ended twice while this ran; finished steps are kept"


class Project:
    """What is known of a project; not for several threads at once."""

    def __init__(self, view: ProjectView, materials: Iterable[Material], changed: Callable[[str], None]):
        """``changed`` is called with the id of a material that has to be saved, or nothing of the view."""
        self.view = view
        self.materials = {one.id: one for one in materials}
        self._owners = {variant.job.id: one.id for one in self.materials.values() for variant in one.variants}
        self._changed = changed

    # -- looking

    def material(self, material: str) -> Material:
        """A material by its id; `InputError` where there is none."""
        if material not in self.materials:
            raise InputError("this material is no longer there")
        return self.materials[material]

    def owner(self, job: str) -> Material | None:
        """The material that a run belongs to."""
        return self.materials.get(self._owners.get(job, ""))

    def variant(self, job: str) -> Variant | None:
        """The variant that a run has made."""
        owner = self.owner(job)
        return None if owner is None else next(one for one in owner.variants if one.job.id == job)

    def export_name(self, job: str) -> str:
        """What the files of a run are called: the material, and the flow that made it before any correction."""
        owner = self.owner(job)
        if owner is None:
            raise InputError("this material is no longer there")
        return f"{stem(owner.name)}_{_first_flow(owner, job)}"

    def with_result(self, texture: str) -> Material | None:
        """The material of which a picture is a result; None where it is of none."""
        every = self.materials.values()
        return next((one for one in every if any(made.job.texture == texture for made in one.variants)), None)

    # -- changing

    def create(self, name: str, recipe: Recipe | None, **fields: Any) -> Material:
        """A new material with a name that is free."""
        now = time.time()
        return self._set(
            Material(id=secrets.token_hex(8), name=self._free(name), made=now, changed=now, draft=recipe, **fields)
        )

    def edit(self, material: str, change: MaterialRequest, picture: str = "") -> Material:
        """Change a material, which is called after ``picture`` now unless it has a name that a person gave.

        Raises
        ------
        InputError : another material has that name.
        """
        before = self.material(material)
        given: dict[str, Any] = {name: getattr(change, name) for name in change.model_fields_set}
        given = {name: value for name, value in given.items() if value is not None}
        if "name" in given:
            given["name"] = " ".join(given["name"].split())
            self._check_free(given["name"], material)
            given["is_named"] = True
        elif picture and not before.is_named and not before.saved_as:
            given["name"] = self._free(picture, material)
        if "tags" in given:
            given["tags"] = tuple(dict.fromkeys(tag.strip() for tag in given["tags"] if tag.strip()))
        if all(getattr(before, name) == value for name, value in given.items()):
            return before
        return self._set(before.model_copy(update=given | {"changed": time.time()}))

    def duplicate(self, material: str) -> Material:
        """A copy with the settings as they are; results belong to the first one, and are cached for the copy."""
        one = self.material(material)
        return self.create(one.name, one.draft, tags=one.tags, mode=one.mode, drawing=one.drawing)

    def add(self, material: str, job: Job, parent: str = "") -> Material:
        """Add a variant that is wanted now; `InputError` where there are too many."""
        one = self.material(material)
        if len(one.variants) >= MOST_VARIANTS:
            raise InputError(f"{one.name}: has {MOST_VARIANTS} results, the most; duplicate it and go on there")
        variant = Variant(job=job, made=time.time(), parent=parent)
        self._owners[job.id] = one.id
        changes: dict[str, Any] = {"variants": (*one.variants, variant), "shown": job.id, "changed": time.time()}
        if not parent:
            changes["draft"] = job.recipe
        return self._set(one.model_copy(update=changes))

    def update(self, job: Job, folder: str = "") -> None:
        """Take the new state of a run; how far it is, is not saved."""
        before, owner = self.variant(job.id), self.owner(job.id)
        if before is None or owner is None:
            return
        after = before.model_copy(
            update={"job": job, "folder": folder or before.folder, "starts": 0 if _is_over(job) else before.starts}
        )
        self._replace(owner, after, is_to_be_saved=_saved(before.job) != _saved(job))

    def interrupted(self) -> list[Job]:
        """The runs that a server has not finished, in their order, to be queued again.

        One that two servers have not survived has failed.
        """
        again = []
        for owner in list(self.materials.values()):
            for variant in owner.variants:
                if _is_over(variant.job) or owner.is_deleted:
                    continue
                starts = variant.starts + (variant.job.state == "running")
                job = variant.job.model_copy(update={"state": "waiting", "text": "", "done": 0.0})
                if starts > 1:
                    job, starts = job.model_copy(update={"state": "failed", "text": _INTERRUPTED}), 0
                else:
                    again.append((variant.made, job))
                self._replace(self.materials[owner.id], variant.model_copy(update={"job": job, "starts": starts}))
        return [job for _, job in sorted(again, key=lambda one: one[0])]

    def pause(self) -> None:
        """Let what runs wait for the next server, as this one ends without any fault of the run."""
        for owner in list(self.materials.values()):
            for variant in owner.variants:
                if variant.job.state == "running":
                    job = variant.job.model_copy(update={"state": "waiting"})
                    self._replace(self.materials[owner.id], variant.model_copy(update={"job": job}))

    def saved_in(self, job: str, folder: str) -> None:
        """Reserve the folder that holds exports of a run."""
        owner = self.owner(job)
        if owner is not None and folder not in owner.saved_as:
            self._set(owner.model_copy(update={"saved_as": (*owner.saved_as, folder)[-64:]}))

    def check_folder(self, job: str, folder: str) -> None:
        """`InputError` where exports of another material are in a folder."""
        owner = self.owner(job)
        for one in self.materials.values():
            if owner is not None and one.id != owner.id and folder in one.saved_as:
                raise InputError(f"{folder}: holds the files of {one.name}; rename this material")

    def look(self, view: ProjectView) -> None:
        """Remember where one is."""
        if view != self.view:
            self.view = view
            self._changed("")

    def matching(self, recipe: Recipe) -> Material | None:
        """The material that a result belongs to which was made elsewhere: of this flow and first picture."""
        kept = [one for one in self.materials.values() if not one.is_deleted and one.draft is not None]
        like = [one for one in kept if _beginning(one.draft) == _beginning(recipe)]
        return max(like, key=lambda one: one.changed, default=None)

    # -- within

    def _set(self, material: Material) -> Material:
        self.materials[material.id] = material
        self._changed(material.id)
        return material

    def _replace(self, owner: Material, variant: Variant, is_to_be_saved: bool = True) -> None:
        variants = tuple(variant if one.job.id == variant.job.id else one for one in owner.variants)
        changed = owner.model_copy(update={"variants": variants})
        self.materials[owner.id] = changed
        if is_to_be_saved:
            self._changed(owner.id)

    def _check_free(self, name: str, but: str) -> None:
        for one in self.materials.values():
            if one.id != but and stem(one.name).casefold() == stem(name).casefold():
                where = " in the bin" if one.is_deleted else ""
                raise InputError(one_line(f"{name}: there is a material{where} whose files are called so already"))

    def _free(self, name: str, but: str = "") -> str:
        """A name that no other material has: this one, or with the first number that is free."""
        name = " ".join(re.sub(r"[\x00-\x1f\x7f]", " ", name).split())[:_LONGEST].strip()
        name = name if re.search(r"\w", name) else "material"
        taken = {stem(one.name).casefold() for one in self.materials.values() if one.id != but}
        base, _, number = name.rpartition(" ")
        base, first = (base, int(number)) if base and re.fullmatch(r"[1-9]\d{0,3}", number) else (name, 1)
        count = first
        while stem(name).casefold() in taken:
            count += 1
            name = f"{base} {count}"
        return name


def stem(name: str) -> str:
    """A name as files have it, which every system takes."""
    return re.sub(r"[^\w-]+", "_", unicodedata.normalize("NFC", name)).strip("_") or "material"


def _is_over(job: Job) -> bool:
    return job.state in ("done", "failed", "cancelled")


def _saved(job: Job) -> tuple[Any, ...]:
    """What is worth saving of a run's state."""
    return (job.state, job.name, job.files, job.saved, job.texture)


def _first_flow(owner: Material, job: str) -> str:
    """The flow of what a run corrects, over all corrections; else its own."""
    by_id = {one.job.id: one for one in owner.variants}
    variant = by_id[job]
    seen = {job}
    while variant.job.recipe.flow == _CORRECTION and variant.parent in by_id and variant.parent not in seen:
        seen.add(variant.parent)
        variant = by_id[variant.parent]
    return variant.job.recipe.flow


def _beginning(recipe: Recipe | None) -> tuple[str, Any]:
    return ("", None) if recipe is None else (recipe.flow, next(iter(recipe.sources.values()), None))
