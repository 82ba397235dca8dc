"""The search of the main method as WGSL through wgpu: whether it has the bits of the CPU's, and how long it takes.

    pip install wgpu                                     see `benchmarks.wgsl_per_pixel`
    python -m benchmarks.wgsl_search                     256x256 px from a reduced brick
    python -m benchmarks.wgsl_search --side 1024 --reduce 1

All but the sweeps stays on the CPU, as does all else of the stage: before each phase of a sweep the penalties are
sent, and after it the moves come back. Times are of the whole step `texture`, and of the sweeps in it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import wgpu

from benchmarks.per_pixel import small
from benchmarks.timing import Seconds, timed
from benchmarks.wgsl_per_pixel import opened
from texloom import stages
from texloom.pipelines.media.sources import open_source
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.synthesis.optimisation import match_search


class CpuSweeps:
    """Stands before the functions by which `Search.step` runs kernels, and counts the seconds of sweeps."""

    def __init__(self) -> None:
        self.seconds, self.phases = 0.0, 0
        self._released: Callable[..., Any] = vars(match_search)["run_released"]
        self._bands: Callable[..., Any] = vars(match_search)["run_bands"]
        vars(match_search).update(run_released=self._timed, run_bands=self.run_bands)

    def _timed(self, *arguments: Any) -> Any:
        started = time.perf_counter()
        found = self.run_released(*arguments)
        self.seconds += time.perf_counter() - started
        self.phases += 1
        return found

    def restore(self) -> None:
        """Give way."""
        vars(match_search).update(run_released=self._released, run_bands=self._bands)

    def run_released(self, *arguments: Any) -> Any:
        """A phase of a sweep: strips that do not depend on each other."""
        return self._released(*arguments)

    def run_bands(self, *arguments: Any) -> Any:
        """Other work on all rows."""
        return self._bands(*arguments)


class GpuSweeps(CpuSweeps):
    """Does the sweeps on a GPU."""

    def __init__(self, lanes: int):
        super().__init__()
        self.name, self.device = opened()
        self.lanes, self.most = lanes, self.device.limits["max-compute-invocations-per-workgroup"]
        self.pipelines: dict[tuple[int, ...], Any] = {}
        self.buffers: dict[str, Any] = {}
        self.target: Any = None

    def put(self, name: str, values: np.ndarray) -> Any:
        """A buffer with these values."""
        values = np.ascontiguousarray(values)
        buffer = self.buffers.get(name)
        if buffer is None or buffer.size < values.nbytes:
            usage = wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_DST | wgpu.BufferUsage.COPY_SRC
            buffer = self.buffers[name] = self.device.create_buffer(size=values.nbytes, usage=usage)
        self.device.queue.write_buffer(buffer, 0, values)
        return buffer

    def get(self, name: str, kind: type, count: int) -> np.ndarray:
        """The first values of a buffer."""
        size = count * np.dtype(kind).itemsize
        return np.frombuffer(self.device.queue.read_buffer(self.buffers[name], 0, size), kind)

    def run_bands(self, *arguments: Any) -> Any:
        """Matches are wanted back."""
        target, self.target = self.target, None
        if target is not None:
            started = time.perf_counter()
            size, shape = target.row.size, target.row.shape
            found = self.get("matches", np.int32, 2 * size).reshape(*shape, 2)
            target.row[:], target.column[:] = found[..., 0], found[..., 1]
            target.distance[:] = self.get("distances", np.int64, size).reshape(shape)
            target.active[:] = self.get("states", np.uint32, size).reshape(shape)
            self.seconds += time.perf_counter() - started
        return self._bands(*arguments)

    def run_released(self, kernel: Any, calls: Any, arrays: Any) -> Any:  # noqa: ARG002
        """A phase of a sweep."""
        shape, target, exemplar, scan = calls[0][:4]
        strips = np.array([call[4:] for call in calls], np.int32)
        if self.target is None:
            self.target = target
            self.put("features", target.features.astype(np.int32))
            self.put("exemplar", exemplar.features.astype(np.int32))
            self.put("matches", np.stack([target.row, target.column], axis=-1))
            self.put("distances", target.distance)
            self.put("states", target.active.astype(np.uint32))
            self.put("moves", np.zeros((target.row.size, 2), np.int32))
        self.put("scan", _numbers(target, exemplar, scan))
        self.put("penalty", exemplar.penalty.astype(np.int64))
        self.put("unused", np.stack([exemplar.unused_row, exemplar.unused_column], axis=-1))
        self.put("strips", strips)
        self.put("totals", np.zeros(2, np.uint32))
        pipeline = self.pipeline(int((strips[:, 1] - strips[:, 0]).max()), shape)
        names = ["scan", "features", "exemplar", "penalty", "unused", "strips", "matches", "distances", "states"]
        names += ["totals", "moves"]
        entries = [{"binding": at, "resource": {"buffer": self.buffers[name]}} for at, name in enumerate(names)]
        encoder = self.device.create_command_encoder()
        work = encoder.begin_compute_pass()
        work.set_pipeline(pipeline)
        work.set_bind_group(
            0, self.device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
        )
        work.dispatch_workgroups(len(strips))
        work.end()
        self.device.queue.submit([encoder.finish()])
        changed, compared = (int(total) for total in self.get("totals", np.uint32, 2))
        moves = (
            self.get("moves", np.int32, 2 * changed).reshape(-1, 2).astype(np.int64)
            if changed
            else np.zeros((0, 2), np.int64)
        )
        return [(moves, compared)]

    def pipeline(self, rows: int, shape: Any) -> Any:
        """The shader for strips of so many rows."""
        lanes = self.lanes
        while rows * lanes > self.most:
            lanes //= 2
        key = (rows, lanes, shape.size, shape.channels)
        if key not in self.pipelines:
            constants = zip(("ROWS", "LANES", "SIZE", "CHANNELS"), key, strict=True)
            code = "".join(f"const {name} = {value};\n" for name, value in constants)
            code += Path(__file__).with_suffix(".wgsl").read_text()
            module = self.device.create_shader_module(code=code)
            self.pipelines[key] = self.device.create_compute_pipeline(
                layout="auto", compute={"module": module, "entry_point": "sweep"}
            )
        return self.pipelines[key]


def _numbers(target: Any, exemplar: Any, scan: Any) -> np.ndarray:
    """What the shader takes as ``scan``."""
    numbers = [
        *target.row.shape, *exemplar.penalty.shape, target.features.shape[1], exemplar.features.shape[1],
        scan.wrap.down, scan.wrap.across, scan.forward, scan.radii.size, scan.fill_tries, scan.everywhere,
        exemplar.own_penalty, exemplar.penalty_limit, np.uint64(scan.key).astype(np.int64), scan.distance_per_try,
        *scan.radii, exemplar.unused_row.size,
    ]  # fmt: skip
    return np.array([int(number) for number in numbers], np.int64)


def show(name: str, seconds: Seconds, sweeps: CpuSweeps) -> None:
    """Print a line of the table."""
    print(f"{name:44}{seconds.wall:8.2f}{seconds.cpu:8.2f}{sweeps.seconds:10.2f}", flush=True)


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--exemplar", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--reduce", type=int, default=4, help="exemplar by this (default: %(default)s)")
    parser.add_argument("--side", type=int, default=256, help="of the result, px (default: %(default)s)")
    parser.add_argument("--lanes", type=int, default=8, help="that share a distance (default: %(default)s)")
    options = parser.parse_args()
    image = open_source("exemplar", options.exemplar).read()
    side = max(image.height, image.width) // options.reduce
    image = small("exemplar", options.exemplar, side)
    edges = stages.edges(image)
    structure = stages.otsu(edges.strength, image).structure
    distance = stages.signed_distance(structure)
    weight = stages.guidance_weight(image, distance.pixels).weight
    start = stages.initialise(image, structure=structure, size=(options.side, options.side)).match

    def texture() -> Any:  # of one start, since those of several take turns on all threads
        return stages.optimise(
            image, start, guidance=distance.field, weight=weight, contours=edges.strength, starts=1
        )

    print(f"{options.exemplar}, {side}x{side} to {options.side}x{options.side} px\n")
    print(f"{'':44}{'s':>8}{'CPU s':>8}{'sweeps s':>10}")
    texture()
    on_cpu = CpuSweeps()
    seconds, expected = timed(texture)
    print(
        f"{f'{thread_count()} threads':44}{seconds.wall:8.2f}{seconds.cpu:8.2f}{on_cpu.seconds:10.2f}", flush=True
    )
    on_cpu.restore()
    on_gpu = GpuSweeps(options.lanes)
    texture()
    on_gpu.seconds, on_gpu.phases = 0.0, 0
    seconds, found = timed(texture)
    on_gpu.restore()
    show(on_gpu.name, seconds, on_gpu)
    different = int((np.asarray(expected.match) != np.asarray(found.match)).any(axis=-1).sum())
    print(f"\n{on_gpu.phases} phases; {different} of {options.side**2} px differ")


if __name__ == "__main__":
    main()
