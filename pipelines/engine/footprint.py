"""What memory and disk the steps of a large result take, told before any of them runs.

Disk is what self-tuning stores, its checkpoints of all scales, its exports and its scratch files (see
`texloom.stages.scratch`), all of them raw and at the same time; and the image of each further step of synthesis.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.flow.model import Step
from texloom.pipelines.memory import machine_memory, memory_limit

LARGE = 4096**2
"""pixels of a result above which memory and disk are estimated"""
_DISK, _DISK_OF_CHANNEL = 55, 22  # bytes a pixel
_SELF_TUNING = 2  # steps of synthesis, which these hold
_DISK_OF_IMAGE = 12  # bytes a pixel and channel: read, made and stored
_IN_MEMORY = 100  # bytes a pixel, at least, of a step that has all of it in memory
_BASE = 16 * 10**8  # bytes of a step that works in bands
_SHARE = 0.25  # of the memory limit, that it takes besides


@dataclasses.dataclass(frozen=True)
class Footprint:
    """What a large result takes at most."""

    memory: int
    """bytes, of steps that work in bands"""
    disk: int
    """bytes"""
    in_memory: Mapping[str, int]
    """steps that have all of it in memory, and the bytes of each, at least"""

    @property
    def problem(self) -> str:
        """Why a step cannot run on this machine; empty where all can."""
        most = machine_memory()
        for step, needed in self.in_memory.items():
            if needed > most:
                return (
                    f"steps.{step}: takes {format_byte_size(needed)} of memory or more for a result of this size, "
                    f"this machine has {format_byte_size(most)}; make it smaller, or leave the step out"
                )
        return ""

    def __str__(self) -> str:
        memory = max(self.memory, *self.in_memory.values()) if self.in_memory else self.memory
        return f"takes up to {format_byte_size(self.disk)} of disk, and {format_byte_size(memory)} of memory"


def footprint(steps: Mapping[str, Step], scopes: list[Scope]) -> Footprint | None:
    """What the largest result of a flow takes; none where there is no large one, or its size is not known yet."""
    pixels = pixels_of_steps(steps, scopes)
    largest = max(pixels.values(), default=0)
    if largest <= LARGE:
        return None
    channels = max((len(source.channels) for scope in scopes for source in scope.sources.values()), default=3)
    whole = {
        name: _IN_MEMORY * count
        for name, count in pixels.items()
        if count > LARGE and not steps[name].stage.in_bands
    }
    made = [
        name for name, count in pixels.items() if count > LARGE and steps[name].stage.name.startswith("synthesis.")
    ]
    further = max(0, len(made) - _SELF_TUNING)
    disk = largest * (_DISK + channels * (_DISK_OF_CHANNEL + _DISK_OF_IMAGE * further))
    return Footprint(int(_BASE + _SHARE * memory_limit()), disk, whole)


def pixels_of_steps(steps: Mapping[str, Step], scopes: list[Scope]) -> dict[str, int]:
    """The number of pixels of each step's largest result, as far as it is known; else 0."""
    pixels: dict[str, int] = {}
    for name, step in steps.items():  # each after those that it needs
        own = max((scope.pixels_of(step) for scope in scopes), default=0)
        pixels[name] = max(own, *(pixels[needed] for needed in step.needs)) if step.needs else own
    return pixels
