"""Per-pixel synthesis on the CPU or on a GPU, with bit-identical results."""

import os
from importlib.util import find_spec
from typing import Any, Literal, cast, get_args

import numpy as np
from jaxtyping import Float32, Integer

from texloom.stages.common.per_pixel.levels import NOTHING, Level, Levels, Rect, Style
from texloom.stages.common.per_pixel.tables import Tables
from texloom.stages.common.per_pixel.target import Limits, TargetControl
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.kernels.per_pixel.arguments import Distortion, Subpass
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps

Device = Literal["cpu", "gpu", "auto"]
"""``auto``: the GPU where there is one"""

_WANTED = "cpu, gpu or auto"
_UNCHANGED = np.array([2**31 - 1, 0, 2**31 - 1, 0], np.int32)


def wanted_device(device: Device | None = None) -> Device:
    """The requested device: ``device``, else the environment variable TEXLOOM_DEVICE, else the CPU.

    Raises
    ------
    InputError
        there is no such device.
    """
    wanted = device or os.environ.get("TEXLOOM_DEVICE") or "cpu"
    if wanted not in get_args(Device):
        raise InputError(f"{_asked_by(device)}: got {wanted!r}, want {_WANTED}")
    return cast(Device, wanted)


def on_gpu(device: Device | None) -> bool:
    """Whether to compute on the GPU, see `wanted_device`.

    Raises
    ------
    InputError
        there is no such device, or no GPU that can be used.
    """
    wanted = wanted_device(device)
    if wanted == "cpu":
        return False
    problem = gpu_problem()
    if problem and wanted == "gpu":
        raise InputError(f"{_asked_by(device)}: gpu, but {problem}")
    return not problem


def _asked_by(device: Device | None) -> str:
    return "device" if device else "TEXLOOM_DEVICE"


def gpu_problem() -> str:
    """Why no GPU can be used; empty if one can."""
    from numba import config, cuda

    if config.ENABLE_CUDASIM:
        return ""
    if find_spec("numba_cuda") is None:
        return "numba-cuda is not installed: pip install 'texloom[gpu]'"
    if not cuda.is_available():
        return "there is no CUDA GPU that this process can use"
    return ""


def levels_on(device: Device | None, tables: Tables, style: Style, window: Rect, wrap: Wraps) -> Levels:
    """`Levels` on a device; see `on_gpu`."""
    return (_GpuLevels if on_gpu(device) else Levels)(tables, style, window, wrap)


def target_on(levels: Levels, planes: Float32[np.ndarray, "H W k"], limits: Limits | None = None) -> TargetControl:
    """A `TargetControl` on the device of ``levels``."""
    return (_GpuTarget if isinstance(levels, _GpuLevels) else TargetControl)(planes, levels, limits)


class _GpuLevels(Levels):
    """Levels whose arrays are on the GPU: work is recorded as steps, and all of them run in one launch.

    Whatever could have changed counts as changed, except in the end: nothing is read from the GPU in between.
    """

    def __init__(self, tables: Tables, style: Style, window: Rect, wrap: Wraps):
        super().__init__(tables, style, window, wrap)
        self._steps: list[dict[str, Any]] = []
        self._program: tuple[Any, int] | None = None  # steps of a launch, on the GPU, and pixels of the largest
        self._painted: Rect | None = None
        self._arrays: dict[str, Any] = {}
        self._changed: Any = None
        self._staged: Any = None
        self._blocks: int | None = None
        self.control: dict[str, Any] = {name: np.zeros(1, np.float32) for name in ("control", "lows", "spans")}
        """planes of all levels, and the limits of what is painted"""
        sizes = [level.states[0].size for level in self.levels]
        self._first = np.concatenate([[0], np.cumsum(sizes)])  # pixels of finer levels
        counts = [size * len(level.states) for size, level in zip(sizes, self.levels, strict=True)]
        self._states = np.concatenate([[0], np.cumsum(counts)])

    def put(self, kind: int, level: Level, area: Rect, **fields: Any) -> Rect:
        """Record a step."""
        number = level.number
        rows, columns = level.states.shape[1:]
        shared = {
            "kind": kind, "top": area.top, "bottom": area.bottom, "left": area.left, "right": area.right,
            "stride": 1, "first": self._first[number], "rows": rows, "columns": columns,
            "row": level.origin[0], "column": level.origin[1], "wrap": self.wrap.down + 2 * self.wrap.across,
            "level": number, "key": self.style.key_of(number),
            "tolerance": self.style.tolerance_of(number, self.tables.strengths),
        }  # fmt: skip
        self._steps.append(shared | fields)
        return area

    def begins(self, painted: Rect, values: Float32[np.ndarray, "h w k"]) -> bool:
        """Send new control for a rectangle; True if the steps of the last update can be reused."""
        from numba import cuda

        flat = np.ascontiguousarray(values, np.float32).ravel()
        if self._staged is None or self._staged.size != flat.size:
            self._staged = cuda.to_device(flat)
        else:
            self._staged.copy_to_device(flat)
        if painted != self._painted:
            self._painted, self._program = painted, None
        return self._program is not None

    def run(self) -> None:
        """Compute everything."""
        super().run()
        self._launch()
        self._program = None

    def update(self, changed: list[Rect]) -> Rect:
        """Compute what depends on changes of control; see `Levels.update`."""
        if self._program is None:
            super().update(changed)
        return self._launch().moved(*self.levels[0].origin).within(self.window)

    def _fetched(self, area: Rect) -> Integer[np.ndarray, "H W"]:
        columns = self.levels[0].states.shape[2]
        begin = self._state(self.levels[0], -1)
        rows = self._arrays["states"][begin + area.top * columns : begin + area.bottom * columns]
        fetched: np.ndarray = rows.copy_to_host().reshape(-1, columns)[:, area.left : area.right]
        return fetched

    def _state(self, level: Level, number: int) -> int:
        """Where a state of a level begins."""
        state = range(len(level.states))[number]
        return int(self._states[level.number] + state * level.states[0].size)

    def _start(self, level: Level, area: Rect) -> Rect:
        from texloom.stages.kernels.per_pixel.cuda import START

        return self.put(START, level, area, after=self._state(level, 0))

    def _refine(self, level: Level, area: Rect) -> Rect:
        from texloom.stages.kernels.per_pixel.cuda import REFINE

        coarse = self.levels[level.number + 1]
        return self.put(
            REFINE, level, area, after=self._state(level, 0), amplitude=self.style.amplitude_of(level.number),
            coarse=self._state(coarse, -1), coarse_columns=coarse.states.shape[2], coarse_row=coarse.origin[0],
            coarse_column=coarse.origin[1],
        )  # fmt: skip

    def _correct_subpass(self, level: Level, part: Subpass, area: Rect) -> Rect:
        from texloom.stages.kernels.per_pixel.cuda import CORRECT

        before, after = self._state(level, part.number), self._state(level, part.number + 1)
        vertical, horizontal, diagonal = (after if corrected else before for corrected in part[1:])
        last = level.number == 0 and part.number == len(level.states) - 2
        return self.put(
            CORRECT, level, area, stride=2, before=before, after=after, vertical=vertical, horizontal=horizontal,
            diagonal=diagonal, watched=int(last),
        )  # fmt: skip

    def _launch(self) -> Rect:
        """Run the steps; returns where the finest level's last state has changed."""
        from numba import cuda

        from texloom.stages.kernels.per_pixel.cuda import (
            ControlPyramid,
            ResultPyramid,
            distorted,
            launch,
            planar,
            resident_blocks,
        )

        if self._program is None:
            self._program = self._prepared()
        steps, pixels = self._program
        if not self._arrays:
            self._arrays = self._upload()
        if self._changed is None:
            self._changed = cuda.to_device(_UNCHANGED)
        else:
            self._changed.copy_to_device(_UNCHANGED)
        arrays, control = self._arrays, self.control
        staged = control["control"] if self._staged is None else self._staged
        arguments: tuple[Any, ...] = (
            steps, ResultPyramid(self._changed, arrays["states"], arrays["given"], arrays["pinned"]),
            ControlPyramid(control["control"], staged, control["lows"], control["spans"]), arrays["exemplar"],
            arrays["contributions"], arrays["pieces"], arrays["repetition"], self.bonuses,
        )  # fmt: skip
        kernel = planar
        if "distortion" in arrays:
            kernel = distorted
            arguments += (arrays["distortion"],)
        if self._blocks is None:
            self._blocks = resident_blocks(kernel, arguments)
        launch(kernel, arguments, pixels, self._blocks)
        changed = Rect(*(int(side) for side in self._changed.copy_to_host()))
        return NOTHING if changed.empty else changed

    def _prepared(self) -> tuple[Any, int]:
        """The steps recorded since the last time, on the GPU, and the pixels of the largest."""
        from numba import cuda

        from texloom.stages.kernels.per_pixel.cuda import STEP

        assert STEP.names is not None
        steps = np.array([tuple(step.get(name, 0) for name in STEP.names) for step in self._steps], STEP)
        self._steps = []
        sizes = (steps["bottom"] - steps["top"]) * (steps["right"] - steps["left"]) // steps["stride"] ** 2
        return cuda.to_device(steps), int(sizes.max()) + 1

    def _upload(self) -> dict[str, Any]:
        """Everything but control, on the GPU."""
        from numba import cuda

        tables, levels = self.tables, self.levels
        states = np.full(int(self._states[-1]), -1, levels[0].states.dtype)
        fixed = any(level.pinned.size for level in levels)
        dimensions = tables.values.shape[1] - 8
        pixels = int(self._first[-1])
        pinned = [level.pinned.ravel() for level in levels] if fixed else [np.full(1, -1, states.dtype)]
        values, candidates = cuda.to_device(tables.values.view(np.int64)), cuda.to_device(tables.candidates)
        arrays = {
            "states": cuda.to_device(states),
            "given": cuda.to_device(np.zeros((pixels if dimensions else 1, max(dimensions, 1)), np.int16)),
            "pinned": cuda.to_device(np.concatenate(pinned)),
            "exemplar": tables.exemplar._replace(values=values, candidates=candidates),
            "contributions": self._contributions(),
            "pieces": self.pieces._replace(starts=cuda.to_device(self.pieces.starts)),
            "repetition": self.repetition._replace(
                wanted=cuda.to_device(self.repetition.wanted), phases=cuda.to_device(self.repetition.phases)
            ),
        }
        if tables.jacobian is not None:
            parts = [level.distortion for level in levels]
            assert None not in parts, "distorted texture needs `Levels.bend`"
            inverse = np.concatenate([part.inverse for part in parts if part])
            sampled = np.concatenate([part.sampled for part in parts if part])
            arrays["distortion"] = Distortion(*map(cuda.to_device, (tables.jacobian, inverse, sampled)))
        if isinstance(self.control["control"], np.ndarray):
            self.control = {name: cuda.to_device(array) for name, array in self.control.items()}
        return arrays

    def _contributions(self) -> Any:
        """On the GPU, what each place contributes to its neighbours; the CPU holds one of eight sides at a time."""
        from numba import cuda

        from texloom.stages.kernels.per_pixel.correction import contribute

        tables = self.tables
        places, rows = tables.places, len(tables.sides) // tables.levels
        table = cuda.device_array((8 * len(tables.appearance), 2), np.int64)
        part = np.empty_like(tables.appearance)
        for side in range(8):
            for level in range(tables.levels):
                own = slice(level * places, (level + 1) * places)
                shared = tables.appearance[own], tables.sides, level * rows + side * rows // 8, part[own]
                run_spans(contribute, shared, places, thread_count())
            table[side * len(part) : (side + 1) * len(part)].copy_to_device(part.view(np.int64))
        return table


class _GpuTarget(TargetControl):
    """A control map on the GPU; its work goes to the steps of ``levels``, which must run or be updated after it."""

    levels: _GpuLevels

    def planes(self, area: Rect) -> Float32[np.ndarray, "h w k"]:
        """A part of the planes, 0..1."""
        width, count = self.shapes[0][1], len(self.limits[0])
        rows = self.levels.control["control"][area.top * width * count : area.bottom * width * count]
        fetched: np.ndarray = rows.copy_to_host().reshape(-1, width, count)[:, area.left : area.right]
        return fetched

    def _hold(self, planes: Float32[np.ndarray, "H W k"]) -> None:
        from numba import cuda

        sizes = [height * width * planes.shape[2] for height, width in self.shapes]
        self._begins = np.concatenate([[0], np.cumsum(sizes)])
        control = np.zeros(int(self._begins[-1]), np.float32)
        control[: sizes[0]] = planes.ravel()
        lows, highs = self.limits
        self.levels.control = {
            name: cuda.to_device(array)
            for name, array in {"control": control, "lows": lows, "spans": highs - lows}.items()
        }

    def paint(self, values: Float32[np.ndarray, "h w k"], top: int, left: int) -> list[Rect]:
        """Replace a rectangle; see `TargetControl.paint`."""
        area = Rect(top, top + values.shape[0], left, left + values.shape[1])
        return [] if self.levels.begins(area, values) else super().paint(values, top, left)

    def _replace(self, values: Float32[np.ndarray, "h w k"], area: Rect) -> None:  # noqa: ARG002, they are there
        from texloom.stages.kernels.per_pixel.cuda import PAINT

        self.levels.put(PAINT, self.levels.levels[0], area, plane=0, plane_columns=self.shapes[0][1])

    def _halve(self, number: int, area: Rect) -> None:
        from texloom.stages.kernels.per_pixel.cuda import HALVE

        self.levels.put(
            HALVE, self.levels.levels[number], area, plane=self._begins[number],
            plane_columns=self.shapes[number][1], **self._read(number - 1),
        )  # fmt: skip

    def _give_to(self, level: Level, into: Rect) -> None:
        from texloom.stages.kernels.per_pixel.cuda import FOLLOW

        self.levels.put(FOLLOW, level, into, strength=self._strength(level.number), **self._read(level.number))

    def _read(self, number: int) -> dict[str, int]:
        """The planes of a level, as what a step reads."""
        height, width = self.shapes[number]
        return {"fine": int(self._begins[number]), "fine_rows": height, "fine_columns": width}
