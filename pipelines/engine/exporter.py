"""Exports of a run: what is written to which file, and what is told of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import Any

from texloom.pipelines.engine.chosen_steps import present
from texloom.pipelines.engine.destination import name_of_pictures
from texloom.pipelines.engine.exports import Export, States
from texloom.pipelines.engine.run import Run, found
from texloom.pipelines.engine.scope import Scope, ScopeInputs
from texloom.pipelines.engine.stage_log import logging_to
from texloom.pipelines.errors import refused
from texloom.pipelines.flow.command import command_of
from texloom.pipelines.flow.feeding import feeding
from texloom.pipelines.flow.model import Reference
from texloom.pipelines.media.delivery import SAME, Delivery
from texloom.pipelines.store import usage
from texloom.pipelines.store.atomic import remove_abandoned
from texloom.pipelines.store.clipping import clipped_map
from texloom.pipelines.store.history import History
from texloom.pipelines.store.png_file import TEXEL_SIZE
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.arrays import Image

_OF_ONE_SCALE = ("exemplar", "picture", "texture", "material")
"""sources whose pixels have the size of the result's, unlike those of photographs"""


def check_same(run: Run, scope: Scope, file: str) -> None:
    """`InputError` where an export should be as the maps of a source are, and that is none of maps."""
    if run.flow.delivery.layout != SAME or not file.endswith("/"):
        return
    like = run.flow.likes.get(file)
    if like is None or not (scope.has_source(like) and scope.source(like).maps):
        raise refused(f"--layout: same needs a folder or YAML file of maps as sources.{like or 'exemplar'}")


class Exporter:
    """Writes the exports of a run into a folder, those that are not there yet."""

    def __init__(self, run: Run, out: Path, history: History):
        self.run, self.out, self.history = run, out, history
        self.states: dict[str, Any] = {}
        """of all files, by path"""
        self.told: list[str] = []
        """what writers have told, such as of values that a file cannot hold"""

    def export(
        self, scope: Scope, kind: str, inputs: ScopeInputs, files: Collection[str] | None = None
    ) -> dict[str, Path]:
        """Write those exports of a scope that are not there yet, an item's into a folder of its name.

        Parameters
        ----------
        files : the exports that are wanted; None for all.

        Returns
        -------
        export name to file.
        """
        written = {}
        told: dict[tuple[str, str], tuple[str, list[str]]] = {}
        prefix = "" if scope.name is None else f"{scope.name}/"
        for file, reference in self.run.exports_of(kind).items():
            if (
                (files is not None and file not in files)
                or reference.name in scope.lost
                or scope.why_passed_over(reference.name) is not None
                or (kind == "item" and not self.run.has(reference, scope))
            ):
                continue
            like = self.run.flow.likes.get(file)
            source = scope.source(like) if like is not None and scope.has_source(like) else None
            check_same(self.run, scope, file)
            if file in self.run.flow.of_maps and not self._is_of_maps(like, scope):
                continue
            surface = self.run.flow.surfaces.get(file)
            delivery = self._delivery(scope)
            export = Export(
                path=self.run.ready_out(self.out, reference, scope) / (prefix + file),
                is_folder=file.endswith("/"),
                origin=self._origin(reference, scope),
                about=self._about(file, reference, scope),
                like=() if source is None else source.maps or source.remembered,
                delivery=delivery,
                material=self._material(like, scope) if delivery.layout else "",
                bits=self._bits(file, reference, scope),
                mesh="" if surface is None else self._origin(surface, scope),
            )
            place = str(export.path)
            known = self.history.exports.get(place) if self.run.has_many_items else None
            state = export.current(self.run.store, known)
            if state is None:
                state = self._write(export, reference, surface, scope, inputs)
            inputs.release([reference])
            if state is None and file in self.run.flow.if_made:
                continue
            if state is None:
                self.told.append(f"{file}: not written, as there is no {reference} here")
                continue
            if not self._shows(export.path.name, reference):  # what shows a result, as a preview does, may clip
                for note in dict.fromkeys(state.get("told", ())):
                    role = clipped_map(note)  # what is cut off is told once of a picture, whatever its files
                    key = (export.path.name, note) if role is None else (str(reference), role)
                    told.setdefault(key, (note, []))[1].append(export.path.name)
            self.states[place] = state
            written[prefix + file] = export.path
        self.told += [f"{', '.join(files)}: {note}" for note, files in told.values()]
        return written

    def _write(
        self, export: Export, reference: Reference, surface: Reference | None, scope: Scope, inputs: ScopeInputs
    ) -> States | None:
        """Write an export that is not there yet; the states of its files, None where the step gave nothing."""
        hint: Any = Image
        provenance = dict(export.about)
        if reference.output is not None:
            hint = self.run.flow.steps[reference.name].stage.outputs[reference.output]
            known = self.run.store.provenance(found(scope.artifact(reference.name)))
            # without what differs between runs, so that equal results are equal files: times, names of inputs,
            # and warnings, as Python tells some of them once only, or where a kernel is compiled
            left_out = ("created", "seconds", "from", "warnings")
            provenance |= {key: value for key, value in known.items() if key not in left_out}
        self.run.store.hold()
        remove_abandoned(export.path.parent)
        told: list[str] = []
        with self.run.store.scratch(), logging_to(__name__, told.append):
            mesh = None if surface is None else inputs.value(self.run.given(surface, scope))
            value = inputs.value(self.run.given(reference, scope))
            if value is None and Hint.of(hint).optional:
                return None
            state = export.write(self.run.store, value, hint, provenance, mesh, told)
        if export.path.is_relative_to(self.run.store.root):
            usage.add(self.run.store, export.path)
        return state

    def _delivery(self, scope: Scope) -> Delivery:
        """How exports are written, pixels of the size that a source's header tells where no option does."""
        delivery = self.run.flow.delivery
        if delivery.texel_size is not None or "mesh" in self.run.flow.sources:
            return delivery
        known = [scope.source(one).texel_size for one in _OF_ONE_SCALE if scope.has_source(one)]
        return dataclasses.replace(delivery, texel_size=next(filter(None, known), None))

    def _is_of_maps(self, like: str | None, scope: Scope) -> bool:
        """Whether the sources that an export is like hold maps, all of a set; a layout is written without."""
        if self.run.flow.delivery.layout:
            return True
        scopes = [scope] if like is None or scope.has_source(like) else self.run.known_scopes
        opened = [one.source(like) for one in scopes if like is not None and one.has_source(like)]
        return bool(opened) and all(one.holds_maps for one in opened)

    def _material(self, like: str | None, scope: Scope) -> str:
        """The name of a material: that asked for, or that of the picture which it is like, or of the first ones."""
        from texloom.pipelines.media.writers.layouts import material_name

        if self.run.flow.delivery.material is not None:
            return material_name(self.run.flow.delivery.material)
        if like is not None and scope.has_source(like):
            return material_name(scope.source(like).picture)
        if scope.name is None:
            return material_name(name_of_pictures(self.run) or self.run.flow.name)
        name = next((one for one in self.run.flow.sources if scope.has_source(one)), None)
        return material_name(self.run.flow.name if name is None else scope.source(name).picture)

    def _shows(self, file: str, reference: Reference) -> bool:
        """Whether an export is a picture that is made to be looked at."""
        step = self.run.flow.steps.get(reference.name) if reference.output is not None else None
        if step is None or not step.stage.name.startswith("evaluation.") or file.startswith("texture."):
            return False
        return step.stage.outputs[reference.output or ""] is Image

    def _bits(self, file: str, reference: Reference, scope: Scope) -> dict[str, int]:
        """For each map the most bits of the sources that feed it; none of what is made to be looked at."""
        if self._shows(file, reference):
            return {}
        bits: dict[str, int] = {}
        for name in feeding(self.run.flow, reference):
            scopes = [scope] if scope.has_source(name) else self.run.known_scopes  # of what is gathered, all
            for one in (one.source(name) for one in scopes if one.has_source(name)):
                bits |= {role: max(own, bits.get(role, 8)) for role, own in one.map_bits.items()}
        return bits

    def _about(self, file: str, reference: Reference, scope: Scope) -> dict[str, Any]:
        """What this run adds to the provenance of an export."""
        about: dict[str, Any] = {"flow": self.run.flow.name, "output": str(reference), "seed": scope.seed}
        if reference.output is not None:
            step = found(present(self.run.flow.steps[reference.name], scope, self.run.store))
            about["from"] = {name: self.run.given(given, scope).label for name, given in step.inputs.items()}
        if (texel_size := self._delivery(scope).texel_size) is not None and not self._shows(file, reference):
            about[TEXEL_SIZE] = texel_size
        if file.endswith((".exr", "/")):
            about["bits"] = self._bits(file, reference, scope)  # so that PNGs made from it one day have as many
            fed = feeding(self.run.flow, reference)
            named = [
                scope.source(one).names for one in self.run.flow.sources if one in fed and scope.has_source(one)
            ]
            if names := next(filter(None, named), {}):
                about["names"] = names  # and are called like those that it was made from
        if file.endswith(".html"):
            about["run"] = self._facts(scope)
        return about

    def _facts(self, scope: Scope) -> dict[str, str]:
        """What a page says of this run, see `texloom.stages.vocabulary.arrays.Page`."""
        sources = list(scope.sources.values())
        name = scope.name or (self.run.flow.name if self.run.flow.is_set or not sources else sources[0].picture)
        about = [self.run.flow.name, *(source.label for source in sources)]
        if scope.item is not None or len(self.run.flow.seeds) == 1:
            about.append(f"seed {scope.seed}")
        return {
            "title": f"{name} · {self.run.flow.name}" if name != self.run.flow.name else name,
            "name": name,
            "about": " · ".join(about),
            "command": command_of(self.run.flow, scope.item),
        }

    def _origin(self, reference: Reference, scope: Scope) -> str:
        """A digest by which one can tell whether an export would come out as before."""
        if reference.output is None:
            return scope.source(reference.name).digest
        return found(scope.artifact(reference.name)).manifest
