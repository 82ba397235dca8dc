"""What all operators share: a timer that looks at the job, one undo step, errors in one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import bpy

from .controller import Job, Request, step
from .session import JOBS
from .texloom_client import CancelledError, RunResult, TexloomError

_SECONDS = 0.2  # between looks


class Task(NamedTuple):
    """What an operator asks for, and what it does with the results; it holds names, as undo moves what has them."""

    requests: Sequence[Request]
    apply: Callable[[list[RunResult]], str]
    """changes the file, and tells what it has made in one line"""
    cleanup: Callable[[], None] = lambda: None


class Running:
    """An operator that runs texloom: from the interface it never waits; ``execute``, which scripts call, does."""

    bl_options: ClassVar = {"UNDO"}
    bl_label: str

    def task(self, context: bpy.types.Context) -> Task:
        """Read all that is needed; `TexloomError` says what is wrong."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make it, and wait."""
        if not self._begin(context):
            return {"CANCELLED"}
        try:
            self._job.wait()
        except CancelledError as error:
            return self._ended({"CANCELLED"}, "WARNING", str(error))
        except TexloomError as error:
            return self._ended({"CANCELLED"}, "ERROR", str(error))
        return self._look(context)

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event | None) -> set[str]:
        """Begin, and go on in the background."""
        if not self._begin(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look at the job at each beat of the timer; all other events are the interface's."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        return self._look(context)

    def cancel(self, _: bpy.types.Context) -> None:
        """Blender ends, or opens another file."""
        self._job.cancel()
        self._ended({"CANCELLED"}, "WARNING", f"{self.bl_label}: cancelled")

    def _begin(self, context: bpy.types.Context) -> bool:
        try:
            self._task: Task = self.task(context)
            self._job: Job = JOBS.begin(self.bl_label, self._task.requests)
        except TexloomError as error:
            self.report({"ERROR"}, f"{self.bl_label}: {error}")
            return False
        self._timer: Any = None
        return True

    def _look(self, context: bpy.types.Context) -> set[str]:
        now = step(self._job, self._task.apply)
        for area in context.screen.areas if context.screen else ():
            area.tag_redraw()
        if now.state == "running":
            return {"PASS_THROUGH"}
        if now.state != "finished":
            return self._ended({"CANCELLED"}, "ERROR" if now.state == "failed" else "WARNING", now.text)
        for note in self._job.notes:
            self.report({"INFO"}, f"texloom: {note}")
        return self._ended({"FINISHED"}, "INFO", now.text)

    def _ended(self, answer: set[str], kind: str, text: str) -> set[str]:
        JOBS.end(self._job)
        self._task.cleanup()
        if self._timer is not None:
            bpy.context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        self.report({kind}, text)
        return answer
