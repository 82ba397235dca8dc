"""Runs of all runners on one store at the same time: nothing is lost, and no step is computed twice.

``python -m tests.crowds --rounds 20`` starts eight runs at a time so often and prints every distinct failure.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.pipelines.flows import ANALYSIS, SET, files, start_run, write_flow, write_set

RUNNERS = ("local", "threads", "processes", "local", "dask", "local", "threads", "local")
_SECONDS = 600  # that all runs together may take


def crowd(folder: Path, runners: tuple[str, ...]) -> list[str]:
    """Run two flows by these runners in turn, all at once on a new store, and say what is wrong."""
    for name in ("one", "set"):
        (folder / name).mkdir(parents=True)
    flows = [write_set(folder / "set", SET), write_flow(folder / "one", ANALYSIS)]
    runs = []
    for index, runner in enumerate(runners):
        options = ["--store", folder / "store", "--out", folder / f"out-{index}", "--runner", runner]
        options += ["--workers", "2"] if runner != "local" else []
        runs.append(start_run(flows[index % 2], *options))
    problems, computed = [], Counter[str]()
    try:
        for index, process in enumerate(runs):
            output, errors = process.communicate(timeout=_SECONDS)
            if process.returncode or "Traceback" in errors:
                problems.append(f"{runners[index]}: exit code {process.returncode}: {errors[-300:]}")
                continue
            computed.update(
                f"{one['stage']} {one['key']}" for one in json.loads(output)["steps"] if one["state"] == "ran"
            )
            if files(folder / f"out-{index}") != files(folder / f"out-{index % 2}"):
                problems.append(f"{runners[index]}: other files than {runners[index % 2]}")
    finally:
        for process in runs:
            process.kill()
    problems += [f"{key.split()[0]} was computed {times} times" for key, times in computed.items() if times > 1]
    records = {path.name for path in (folder / "store" / "records").glob("*") if not path.name.startswith(".")}
    if len(records) != len(computed):
        problems.append(f"{len(computed)} steps were computed, and {len(records)} are in the store")
    problems += [f"left in the store: {path.name[:5]}" for path in (folder / "store").rglob(".new-*")]
    return problems


def main() -> int:
    """Start the runs, round after round, and print every distinct failure."""
    parser = argparse.ArgumentParser(prog="python -m tests.crowds", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    given = parser.parse_args()
    failures = Counter[str]()
    for number in range(given.rounds):
        with tempfile.TemporaryDirectory() as folder:
            problems = crowd(Path(folder), RUNNERS)
        failures.update(problems)
        print(f"round {number + 1}: {problems or 'nothing lost, nothing computed twice'}", flush=True)
    for problem, times in failures.most_common():
        print(f"{times:5} x {problem}")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
