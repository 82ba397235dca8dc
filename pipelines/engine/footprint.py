"""What memory and disk the steps of large pictures take, told before any of them runs.

Disk of a large result is what self-tuning stores, its checkpoints of all scales, its exports and its scratch
files (see `texloom.stages.vocabulary.scratch`), all of them raw and at the same time; and the image of each
further step of synthesis. Of a small result it is what is stored of the exemplar.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.flow.model import Flow, Step
from texloom.pipelines.media.sources import Source
from texloom.pipelines.memory import machine_memory, memory_limit
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.sizes import format_size

LARGE = 4096**2
"""pixels of an exemplar or result above which memory and disk are estimated"""
_DISK, _DISK_OF_CHANNEL = 63, 22  # bytes a pixel
_SELF_TUNING = 2  # steps of synthesis, which these hold
_DISK_OF_IMAGE = 12  # bytes a pixel and channel: read, made and stored
_BYTES, _FEWEST_BYTES = (45, 180), 5 * 10**8
"""of memory that a run takes for a pixel of the exemplar and of the result, and besides"""
_STORED, _STORED_OF_EXEMPLAR = 4, 15
"""bytes on disk for a pixel and channel of what synthesis makes, and for a pixel of what is found in an exemplar"""
_ANALYSED = 15 * 10**5  # pixels of an exemplar beyond which most of its analysis is at reduced size
_WRITTEN, _WRITTEN_AS_FLOATS, _FLOATS = 1, 4, (".exr", ".hdr", ".tif", ".tiff", ".tx")
"""bytes for a pixel and channel of an export"""
_BASE = 16 * 10**8  # bytes of a step that works in bands
_MINUTE, _HOUR = 60, 3600  # s
_SHARE = 0.25  # of the memory limit, that it takes besides


@dataclasses.dataclass(frozen=True)
class Footprint:
    """What large pictures take."""

    memory: int
    """bytes, of steps that work in bands, at most"""
    disk: int
    """bytes at most, of a large result"""
    in_memory: Mapping[str, int]
    """steps that have all of the exemplar or the result in memory, and the bytes of each, at least"""

    @property
    def all_memory(self) -> int:
        """Bytes, of all kinds of steps."""
        return max([self.memory, *self.in_memory.values()])

    @property
    def problem(self) -> str:
        """Why a step cannot run on this machine; empty where all can."""
        most = machine_memory()
        for step, needed in self.in_memory.items():
            if needed > most:
                return (
                    f"steps.{step}: takes {format_byte_size(needed)} of memory or more for pictures of this size, "
                    f"this machine has {format_byte_size(most)}; make them smaller, or leave the step out"
                )
        return ""

    def __str__(self) -> str:
        memory = format_byte_size(self.all_memory)
        if not self.disk:
            return f"takes {memory} of memory or more"
        return f"takes up to {format_byte_size(self.disk)} of disk, and {memory} of memory"


def expectation(steps: Mapping[str, Step], scope: Scope, exemplar: Source) -> str:
    """What a large exemplar takes of time and memory, roughly, and what takes less; in one line."""
    height, width = exemplar.height, exemplar.width
    synthesis = (step for step in steps.values() if step.stage.name.startswith("synthesis."))
    made = max((scope.pixels_of(step) for step in synthesis), default=0)

    def taken(pixels: int) -> str:
        memory = format_byte_size(_memory(pixels, made))
        return f"{describe_seconds(_seconds(steps.values(), pixels, made))} and {memory} of memory"

    part = f"a part (--crop {width // 2}x{height // 2}) or half the size (--reduce 0.5)"
    return (
        f"sources.{exemplar.name}: {format_size(exemplar)} take about {taken(height * width)} on this machine; "
        f"{part} takes {taken(height * width // 4)}"
    )


def seconds_of(steps: Sequence[Step], whole: Mapping[str, Step], scope: Scope) -> float:
    """The time that steps of a flow take on all processors of this machine, as far as their stages tell."""
    return _seconds(steps, *_exemplar_and_result(whole, scope))


def memory_of(steps: Sequence[Step], whole: Mapping[str, Step], scope: Scope) -> int:
    """The memory that steps of a flow take, in bytes, roughly; 0 for no steps."""
    return _memory(*_exemplar_and_result(whole, scope)) if steps else 0


def disk_of(steps: Sequence[Step], whole: Mapping[str, Step], scope: Scope) -> int:
    """What the results of steps of a flow take in the store, in bytes, roughly."""
    exemplar, result = _exemplar_and_result(whole, scope)
    made = sum(step.stage.name.startswith("synthesis.") for step in steps)
    analysed = min(exemplar, _ANALYSED)
    of_synthesis = _STORED * _channels([scope]) * (result or exemplar) * made
    of_analysis = _STORED_OF_EXEMPLAR * analysed * (len(steps) - made)
    return of_synthesis + max(of_analysis, _disk_of_exemplars(steps, [scope]))


def disk_of_exports(flow: Flow, steps: Sequence[Step], scope: Scope) -> int:
    """What is exported of steps of a flow takes, in bytes, roughly."""
    pixels, channels = pixels_of_steps(flow.steps, [scope]), _channels([scope])
    names = {step.name for step in steps}
    return sum(
        pixels[given.name] * channels * (_WRITTEN_AS_FLOATS if file.endswith(_FLOATS) else _WRITTEN)
        for file, given in flow.exports.items()
        if given.name in names and not file.endswith((".json", ".html", ".csv"))
    )


def _memory(exemplar: int, result: int) -> int:
    return _FEWEST_BYTES + _BYTES[0] * exemplar + _BYTES[1] * result


def _exemplar_and_result(whole: Mapping[str, Step], scope: Scope) -> tuple[int, int]:
    """Pixels of the largest picture that steps of a scope take, and of what synthesis makes, if known, else 0."""
    own = [*scope.sources.values(), *(scope.shared.sources.values() if scope.shared is not None else ())]
    exemplar = max((source.height * source.width for source in own if source.kind == "picture"), default=0)
    synthesis = (step for step in whole.values() if step.stage.name.startswith("synthesis."))
    return exemplar, max((scope.pixels_of(step) for step in synthesis), default=0)


def _channels(scopes: Sequence[Scope]) -> int:
    return max((len(source.channels) for scope in scopes for source in scope.sources.values()), default=3)


def _seconds(steps: Iterable[Step], exemplar: int, result: int) -> float:
    costs = [step.stage.seconds for step in steps]
    whole = sum(exemplar * of_exemplar + result * of_result for of_exemplar, of_result in costs)
    return whole / 1e6 / thread_count()


def describe_seconds(seconds: float) -> str:
    """A time in the largest unit that fits."""
    if seconds < _MINUTE:
        return f"{max(1, seconds):.0f} s"
    return f"{seconds / _MINUTE:.0f} min" if seconds < _HOUR else f"{seconds / _HOUR:.1f} h"


def footprint(steps: Mapping[str, Step], scopes: list[Scope]) -> Footprint | None:
    """What the largest pictures of a flow take; none where none is large, or their sizes are not known yet."""
    pixels, taken = pixels_of_steps(steps, scopes), _exemplar_pixels(steps, scopes)
    made = {name: pixels[name] for name, step in steps.items() if step.stage.name.startswith("synthesis.")}
    largest = max([0, *made.values(), *(pixels[name] for name in _sized(steps))])
    if max(largest, *pixels.values(), *taken.values(), 0) <= LARGE:
        return None
    whole = {}
    for name, step in steps.items():
        is_result = pixels[name] > taken[name] and not step.stage.in_bands  # else it is of the exemplar's size
        own = pixels[name] if is_result else 0
        if max(own, taken[name]) > LARGE:
            whole[name] = step.stage.result_bytes * own + step.stage.exemplar_bytes * taken[name]
    if largest <= LARGE:
        return Footprint(0, _disk_of_exemplars(list(steps.values()), scopes), whole)
    channels = _channels(scopes)
    further = max(0, sum(count > LARGE for count in made.values()) - _SELF_TUNING)
    disk = largest * (_DISK + channels * (_DISK_OF_CHANNEL + _DISK_OF_IMAGE * further))
    return Footprint(int(_BASE + _SHARE * memory_limit()), disk, whole)


def _exemplar_pixels(steps: Mapping[str, Step], scopes: list[Scope]) -> dict[str, int]:
    """The number of pixels of the largest source that each step takes, or of what was made of one in its size."""
    taken: dict[str, int] = {}
    for name, step in steps.items():  # each after those that it needs
        sources = {given.name for given in step.references if given.output is None}
        own = [
            source.height * source.width
            for scope in scopes
            for source in scope.sources.values()
            if source.name in sources
        ]
        made = [taken[needed] for needed in step.needs if not hasattr(steps[needed].params, "size")]
        taken[name] = max([0, *own, *made])
    return taken


def pixels_of_steps(steps: Mapping[str, Step], scopes: list[Scope]) -> dict[str, int]:
    """The number of pixels of each step's largest result, as far as it is known; else 0."""
    pixels: dict[str, int] = {}
    sized = _sized(steps)
    for name, step in steps.items():  # each after those that it needs
        own = max((scope.pixels_of(step) for scope in scopes), default=0)
        # what takes an exemplar and a start makes something of the start's size
        like = sized.intersection(step.needs) or step.needs
        pixels[name] = own or max((pixels[needed] for needed in like), default=0)
    return pixels


def _sized(steps: Mapping[str, Step]) -> set[str]:
    """The steps whose results have a size that was asked for, and those after them."""
    sized: set[str] = set()
    for name, step in steps.items():
        if isinstance(getattr(step.params, "size", None), tuple) or sized.intersection(step.needs):
            sized.add(name)
    return sized


def _disk_of_exemplars(steps: Sequence[Step], scopes: Sequence[Scope]) -> int:
    """What is stored of images that analysis makes in the size of an exemplar, in bytes."""
    analysis = [step for step in steps if step.stage.name.startswith("analysis.")]
    pixels = sum(max((scope.pixels_of(step) for scope in scopes), default=0) for step in analysis)
    return _STORED * _channels(scopes) * pixels
