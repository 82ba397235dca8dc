"""Saving a project as it changes, beside whatever else goes on."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import anyio.to_thread

from texloom.pipelines.errors import one_line
from texloom.pipelines.studio.projects.files import ProjectFiles
from texloom.pipelines.studio.projects.project import Project

_PAUSE = 3.0
"""seconds until what could not be saved is tried again"""


class Saver:
    """Writes what has changed, the newest state of each material, one file after the other."""

    def __init__(self, files: ProjectFiles, told: Callable[[str], None]):
        """``told`` is called with why nothing can be saved, and with nothing when it can again."""
        self.files = files
        self.project: Project | None = None
        self.problem = ""
        self._told = told
        self._waiting: dict[str, None] = {}
        """ids of materials, and nothing for the view, the oldest change first"""
        self._news = asyncio.Event()

    def want(self, material: str) -> None:
        """Save a material, or where one is, soon."""
        self._waiting[material] = None
        self._news.set()

    async def work(self) -> None:
        """Save what changes, for ever."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                if not await self._saved(next(iter(self._waiting))):
                    await asyncio.sleep(_PAUSE)

    async def _saved(self, one: str) -> bool:
        """Whether what has changed could be written."""
        self._waiting.pop(one, None)
        try:
            await anyio.to_thread.run_sync(self._writer(one))
        except OSError as error:
            self._waiting.setdefault(one)
            self._tell(one_line(f"not saved: {self.files.place}: {error.strerror or error}"))
            return False
        self._tell("")
        return True

    def _writer(self, one: str) -> Callable[[], None]:
        assert self.project is not None
        project = self.project
        if not one:
            view = project.view
            return lambda: self.files.write_view(view)
        material = project.materials[one]
        return lambda: self.files.write_material(material)

    def flush(self) -> None:
        """Save all that waits, at the end."""
        for one in list(self._waiting):
            with contextlib.suppress(OSError):
                self._writer(one)()
        self._waiting.clear()

    def _tell(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._told(problem)
