"""Other programs and texloom on the same exemplars and the same machine: CPU seconds and scores.

    python -m benchmarks.other_tools tools.yaml --exemplars 'exemplars/*.png' --size 512 --keep results
    python -m benchmarks.other_tools tools.yaml --exemplars 'exemplars/*.png' --flows self_tuning quilting

The YAML file maps the name of each tool to its command, in which {exemplar}, {out}, {height}, {width} and {seed}
are filled in. It must write a PNG to {out}:

    gmic: gmic {exemplar} syntexturize_matchpatch {width},{height} output {out}
    texture-synthesis: texture-synthesis --seed {seed} --out {out} --out-size {width} generate {exemplar}
    my-method: python synthesise.py {exemplar} {out} --size {height} {width}

Each run is a process of its own, so that times include its start; texloom's has an empty store and makes the
picture only. Kernels are compiled before. All results are scored alike, from their pixels alone. With ``--keep``,
the pictures stay, so that ``texloom compare --against NAME=results/NAME`` can show them.
"""

from __future__ import annotations

import argparse
import dataclasses
import glob
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.yaml import read_document
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import Size, format_size, size_value

os.environ.pop("PREFECT_API_URL", None)

Command = Callable[[Path, Path], Sequence[str]]
"""the command that makes a picture of an exemplar"""


@dataclasses.dataclass(frozen=True)
class Made:
    """One run of one tool."""

    wall: float
    """s"""
    cpu: float
    """s, of all threads and processes"""
    scores: Mapping[str, float | None]
    """mean score by axis; nothing where it failed"""
    problem: str = ""


def read_tools(file: Path) -> dict[str, list[str]]:
    """Name of each tool to the words of its command."""
    tools = read_document(file)
    if not isinstance(tools, dict) or not all(isinstance(command, str) for command in tools.values()):
        raise InputError(f"{file}: must map names of tools to their commands")
    for name, command in tools.items():
        if "{exemplar}" not in command or "{out}" not in command:
            raise InputError(f"{file}: {name}: the command must have {{exemplar}} and {{out}}, got {command!r}")
    return {str(name): shlex.split(command) for name, command in tools.items()}


def filled(words: Sequence[str], exemplar: Path, out: Path, size: tuple[int, int], seed: int) -> list[str]:
    """The words of a command with what belongs in it."""
    values = {"exemplar": exemplar, "out": out, "height": size[0], "width": size[1], "seed": seed}
    line = list(words)
    for name, value in values.items():
        line = [word.replace(f"{{{name}}}", str(value)) for word in line]
    return line


def texloom_command(
    flow: str, work: Path, exemplar: Path, out: Path, size: tuple[int, int], seed: int
) -> list[str]:
    """The command that makes the picture of a flow, and nothing else, from an empty store."""
    loaded = load_flow(find_flow(flow))
    source, picture = next(iter(loaded.sources)), loaded.exports["texture.png"]
    file = work / f"{flow}.yaml"
    include = f"{{flow: {loaded.path.resolve()}, steps: [{picture.name}]}}"
    file.write_text(f"flow: {loaded.name}\ninclude: {include}\nexports: {{{out.name}: {picture}}}\n")
    store = work / "store"
    shutil.rmtree(store, ignore_errors=True)
    options = ["--source", f"{source}={exemplar}", "--size", size_value(size), "--seed", str(seed)]
    return [
        *(sys.executable, "-m", "texloom", "run", str(file), *options),
        *("--out", str(out.parent), "--store", str(store)),
    ]


def run(command: Sequence[str], timeout: float) -> tuple[float, float, str]:
    """Wall and CPU seconds of a process with those that it starts, and why it failed, if it did."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
        lines = done.stderr.strip().splitlines() or [""]
        problem = "" if done.returncode == 0 else f"exit code {done.returncode}: {lines[-1][:200]}"
    except subprocess.TimeoutExpired:
        problem = f"took more than {timeout:g} s"
    except OSError as error:
        problem = f"{command[0]}: {error.strerror}"
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, problem


def scores_of(exemplar: Image, picture: Path, size: tuple[int, int]) -> dict[str, float | None]:
    """Mean score of a result by axis; `InputError` where there is none of that size."""
    result, metrics = find_stage("evaluation.external_result"), find_stage("evaluation.metrics")
    image = open_source("result", str(picture)).read()
    part = result.function(image, result.params.model_validate({"size": size})).image
    table = metrics.function(exemplar, part, metrics.params()).table
    return {axis: score for axis, score in table["summary"].items() if axis != "wrap"}


def measured(command: Command, exemplar: Path, out: Path, size: tuple[int, int], timeout: float) -> Made:
    """One run, scored."""
    out.parent.mkdir(parents=True, exist_ok=True)
    wall, cpu, problem = run(command(exemplar, out), timeout)
    if problem:
        return Made(wall, cpu, {}, problem)
    try:
        return Made(wall, cpu, scores_of(open_source("exemplar", str(exemplar)).read(), out, size))
    except InputError as error:
        return Made(wall, cpu, {}, str(error))


def lines(results: Mapping[str, Sequence[Made]]) -> Iterable[str]:
    """The table: means over the exemplars on which every tool that made anything made a picture."""
    working = [column for column in results.values() if any(not one.problem for one in column)]
    shared = [index for index, row in enumerate(zip(*working, strict=True)) if not any(one.problem for one in row)]
    axes = list(dict.fromkeys(axis for column in working for one in column for axis in one.scores))
    yield f"{'':24}{'pictures':>10}{'s':>10}{'CPU s':>10}" + "".join(f"{axis:>10}" for axis in axes)
    for name, column in results.items():
        made = sum(not one.problem for one in column)
        line = f"{name:24}{f'{made} of {len(column)}':>10}"
        if made and shared:
            own = [column[index] for index in shared]
            line += f"{np.mean([one.wall for one in own]):10.2f}{np.mean([one.cpu for one in own]):10.2f}"
            known = [[one.scores[axis] for one in own] for axis in axes]
            line += "".join(
                f"{'-':>10}" if None in scores else f"{np.mean(np.array(scores, np.float64)):10.3f}"
                for scores in known
            )
        yield line


def main() -> None:
    """Read the options, run everything and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tools", type=Path, help="the YAML file of commands")
    parser.add_argument("--exemplars", required=True, metavar="PATTERN", help="as in 'exemplars/*.png'")
    parser.add_argument(
        "--flows", nargs="*", default=["self_tuning"], metavar="NAME", help="(default: %(default)s)"
    )
    parser.add_argument(
        "--size", default="512", metavar="N|WIDTHxHEIGHT", help="of the results, px (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=7, help="(default: %(default)s)")
    parser.add_argument("--timeout", type=float, default=600, help="seconds for one picture (default: %(default)s)")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where the pictures stay, by tool")
    options = parser.parse_args()
    try:
        compare(options)
    except InputError as error:
        parser.error(str(error))


def compare(options: argparse.Namespace) -> None:
    """Run everything and print the table."""
    import pydantic

    try:
        size: tuple[int, int] = pydantic.TypeAdapter(Size).validate_python(options.size)
    except pydantic.ValidationError as error:
        raise InputError(f"--size: {error.errors()[0]['msg']}") from None
    tools = read_tools(options.tools)
    exemplars = [Path(path).resolve() for path in sorted(glob.glob(options.exemplars))]  # noqa: PTH207
    if not exemplars:
        raise InputError(f"--exemplars: no file matches {options.exemplars}")
    given: dict[str, Any] = {"size": size, "seed": options.seed}
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        commands: dict[str, Command] = {name: partial(filled, words, **given) for name, words in tools.items()}
        for flow in options.flows:
            commands[f"texloom {flow}"] = partial(texloom_command, flow, work, **given)
            run(commands[f"texloom {flow}"](exemplars[0], work / "compiled" / "texture.png"), options.timeout)
        results: dict[str, list[Made]] = {name: [] for name in commands}
        for exemplar in exemplars:
            for name, command in commands.items():
                out = (options.keep or work).resolve() / name.replace(" ", "_") / f"{exemplar.stem}.png"
                made = measured(command, exemplar, out, size, options.timeout)
                results[name].append(made)
                print(f"{exemplar.name:24}{name:24}{made.wall:8.2f} s  {made.problem}", flush=True)
    machine = f"{os.cpu_count()} cores, {thread_count()} threads"
    print(f"\n{len(exemplars)} exemplars to {format_size(size)}, {machine}\n")
    print("\n".join(lines(results)))


if __name__ == "__main__":
    main()
