"""Per-pixel synthesis as WGSL through wgpu: whether it has the bits of the CPU's, and how long it takes.

    pip install wgpu                              it takes a driver for Vulkan, Metal or DX12; on Debian the package
                                                  mesa-vulkan-drivers has one that runs on processors
    python -m benchmarks.wgsl_per_pixel
    python -m benchmarks.wgsl_per_pixel --side 1024

Texture that is not distorted and repeats at its borders, without control and under control that does not change.
The steps are those that are recorded for CUDA; each is a dispatch. Times are of all; no pixels are fetched.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import wgpu

from benchmarks.per_pixel import median, small
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.per_pixel import device
from texloom.stages.common.per_pixel.levels import Levels, Rect, Style
from texloom.stages.common.per_pixel.target import TargetControl
from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.kernels.per_pixel.correction import contribute
from texloom.stages.synthesis.per_pixel.per_pixel import prepare
from texloom.stages.vocabulary.facts import TORUS

_GpuLevels: Any = vars(device)["_GpuLevels"]
FIELDS = (
    "kind", "top", "bottom", "left", "right", "stride", "first", "rows", "columns", "row", "column", "wrap",
    "before", "vertical", "horizontal", "diagonal", "after", "coarse", "coarse_columns", "coarse_row",
    "coarse_column", "level", "amplitude", "tolerance", "watched",
)  # fmt: skip
KEY = 30
"""its place in the shader's ``step``, in which the fields come first"""


def opened() -> tuple[str, Any]:
    """The GPU's name, and the GPU, with 64-bit integers and the largest buffers it has."""
    adapter = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
    limits = {name: value for name, value in adapter.limits.items() if "buffer" in name or "compute" in name}
    gpu = adapter.request_device_sync(required_features=["shader-int64"], required_limits=limits)
    return adapter.info["device"], gpu


class WgslLevels(_GpuLevels):  # type: ignore[misc]
    """Levels whose steps run through wgpu."""

    _steps: list[dict[str, Any]]
    _program: Any
    window: Rect

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self.name, self.gpu = opened()
        tables = self.tables
        constants = {
            "D": tables.values.shape[1], "ROWS": tables.places // tables.pitch, "PITCH": tables.pitch,
            "K": tables.candidates.shape[1], "LEVELS": tables.levels, "BLOCK": self.style.block,
            "TRIES": self.style.tries, "COHERENCE": f"{self.bonuses.coherence}li",
            "CONTROL": f"{self.bonuses.control}li", "ENDLESS": str(tables.endless).lower(),
            "CORE": f"vec4{tables.core}",
        }  # fmt: skip
        code = "".join(f"const {name} = {value};\n" for name, value in constants.items())
        code += Path(__file__).with_suffix(".wgsl").read_text()
        module = self.gpu.create_shader_module(code=code)
        self.pipeline = self.gpu.create_compute_pipeline(
            layout="auto", compute={"module": module, "entry_point": "run"}
        )
        self.made: list[Any] = []

    def buffer(self, values: np.ndarray) -> Any:
        """A new buffer with these values."""
        usage = wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.COPY_SRC
        return self.gpu.create_buffer_with_data(data=np.ascontiguousarray(values), usage=usage)

    def contributions(self) -> np.ndarray:
        """What each place contributes to its neighbours, a side after another."""
        tables, places = self.tables, self.tables.places
        table = np.empty((8, *tables.appearance.shape), np.int16)
        rows = len(tables.sides) // tables.levels
        for side in range(8):
            for level in range(tables.levels):
                own = slice(level * places, (level + 1) * places)
                shared = tables.appearance[own], tables.sides, level * rows + side * rows // 8, table[side, own]
                run_spans(contribute, shared, places, thread_count())
        return table

    def _upload(self) -> list[Any]:
        """Buffers with the tables, control, the states, and what changes, in the order of the shader."""
        tables = self.tables
        given = np.concatenate([level.given.ravel() for level in self.levels])
        states = np.full(int(self._states[-1]), -1, np.int32)
        arrays = tables.values, self.contributions(), tables.candidates, given, states, np.zeros(4, np.int32)
        return [self.buffer(array if array.size else np.zeros(8, np.int16)) for array in arrays]

    def _launch(self) -> Rect:
        self.made = self.made or self._upload()
        if self._program is None:
            numbers = np.zeros((len(self._steps), 32), np.int64)
            for row, step in zip(numbers, self._steps, strict=True):
                row[: len(FIELDS)] = [int(step.get(name, 0)) for name in FIELDS]
                row[KEY] = np.uint64(step["key"]).astype(np.int64)
            steps, layout = self.buffer(numbers), self.pipeline.get_bind_group_layout(0)
            shared = [{"binding": 1 + at, "resource": {"buffer": made}} for at, made in enumerate(self.made)]
            self._program = [
                (
                    self.gpu.create_bind_group(layout=layout, entries=[
                        {"binding": 0, "resource": {"buffer": steps, "offset": 256 * at, "size": 256}}, *shared
                    ]),
                    -(-(row[4] - row[3]) // row[5] // 64), -(-(row[2] - row[1]) // row[5]),
                )
                for at, row in enumerate(numbers)
            ]  # fmt: skip
            self._steps = []
        encoder = self.gpu.create_command_encoder()
        work = encoder.begin_compute_pass()
        work.set_pipeline(self.pipeline)
        for group, across, down in self._program:
            work.set_bind_group(0, group)
            work.dispatch_workgroups(int(across), int(down))
        work.end()
        self.gpu.queue.submit([encoder.finish()])
        return self.window

    def again(self) -> None:
        """Run the same steps, and wait for the end."""
        self._launch()
        self.gpu.queue.read_buffer(self.made[-1])

    def run(self) -> None:
        """Compute everything."""
        Levels.run(self)
        self.again()

    def _fetched(self, area: Rect) -> np.ndarray:
        columns, begin = self.levels[0].states.shape[2], self._state(self.levels[0], -1)
        size = 4 * columns * (area.bottom - area.top)
        rows = self.gpu.queue.read_buffer(self.made[4], 4 * (begin + area.top * columns), size)
        return np.frombuffer(rows, np.int32).reshape(-1, columns)[:, area.left : area.right]


def _ignoring(work: Callable[[], None], _: int) -> None:
    work()


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exemplar", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--side", type=int, default=512, help="of the result, px (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=15, help="(default: %(default)s)")
    options = parser.parse_args()
    image = small("exemplar", options.exemplar, 128)
    stack = appearance_stack(image, AppearanceStackParams())
    print(f"{options.exemplar}, 128x128 to {options.side}x{options.side} px, {thread_count()} threads\n")
    print(f"{'':40}{'CPU ms':>10}{'WGSL ms':>10}{'px that differ':>16}")
    for name, control in (("without control", None), ("under control", image)):
        tables, scale = prepare(image, stack, control, None, 1.0)
        count = tables.levels
        style = Style(7, (0.5,) * count, (2,) * count, 8, 16, 20, 12, 0.05)
        window = Rect(0, options.side, 0, options.side)
        on_cpu, on_gpu = Levels(tables, style, window, TORUS), WgslLevels(tables, style, window, TORUS)
        if scale is not None:
            rows, columns = np.indices((options.side, options.side)) / options.side
            waves = (0.5 + 0.5 * np.sin(6 * columns + 3 * np.sin(5 * rows))).astype(np.float32)
            planes = np.repeat(waves[..., None], len(scale.control), axis=2)
            TargetControl(planes, on_cpu)
            TargetControl(planes, on_gpu)
        on_cpu.run()
        on_gpu.run()
        different = int((on_cpu.finest() != on_gpu.finest()).sum())
        processors = median(partial(_ignoring, on_cpu.run), options.repeats)[0]
        card = median(partial(_ignoring, on_gpu.again), options.repeats)[0]
        print(f"{name:40}{1000 * processors:10.1f}{1000 * card:10.1f}{different:16}   {on_gpu.name}", flush=True)


if __name__ == "__main__":
    main()
