"""What looking after a store of very many results takes: list, verify, limit and prune.

    python -m benchmarks.large_store --results 100000

makes a store of so many small results, each with an EXR, a picture, a record, and its place in the log of a run,
and prints wall time, CPU time and peak memory of each command, and its CPU time for a million results: that of its
start-up, over a store of one result, and a million times what each result takes beyond it. The first listing has
no index of sizes. What removing takes at least is printed too: the same calls of the system, and nothing else. A
result takes 24 kB of disk, or of memory where TMPDIR is a tmpfs. With ``--against``, a folder that has another
texloom (``.import`` of its clone), its commands run over a second such store.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.many_items import run
from texloom.pipelines.store import run_log
from texloom.pipelines.store.record import encode_record, record_name
from texloom.pipelines.store.result_files import MANIFEST
from texloom.pipelines.store.store import Store
from texloom.stages.lookup.registry import find_stage

STAGE = "analysis.otsu"
_OF_A_RUN = 10_000
_TIMES = 3  # of which the least is printed
COMMANDS = {
    "ls first": ["store", "ls"],
    "ls": ["store", "ls"],
    "ls --json": ["store", "ls", "--json"],
    "verify": ["store", "verify"],
    "prune none": ["store", "prune", "--days", "1"],
    "limit set": ["store", "limit", "1000TB"],
    "limit kept": ["store", "limit"],
    "prune all": ["store", "prune", "--days", "0"],
}


def make_store(root: Path, count: int) -> None:
    """Write a result, and copies of it under other keys."""
    stage = find_stage(STAGE)
    store = Store(root)
    store.create()
    values = np.zeros((16, 16), np.uint8)
    key = hashlib.sha256(b"first").hexdigest()
    first = store.save(stage, key, stage.result(values.astype(bool), 0.5), {"params": {}, "inputs": {}})
    manifest = json.loads((first.folder / MANIFEST).read_bytes())
    cache, files = first.folder.parent, {name: (first.folder / name).read_bytes() for name in manifest["files"]}
    time_ns = {name: (entry["mtime_ns"],) * 2 for name, entry in manifest["files"].items()}
    steps: dict[str, str] = {}
    for number in range(count):
        other = hashlib.sha256(str(number).encode()).hexdigest()
        folder = f"{cache}/{other}"
        os.mkdir(folder)  # noqa: PTH102 (as text, as there are many)
        content = json.dumps({**manifest, "key": other}).encode()
        for name, held in {**files, MANIFEST: content}.items():
            with open(f"{folder}/{name}", "wb") as file:  # noqa: PTH123
                file.write(held)
            if name in time_ns:
                os.utime(f"{folder}/{name}", ns=time_ns[name])
        record = {**first.record, "key": other, "manifest": hashlib.sha256(content).hexdigest()}
        name = record_name(STAGE, other)
        (store.records / name).write_bytes(encode_record(record, name))
        steps[f"item{number:06d}/structure"] = other
        if len(steps) == _OF_A_RUN or number == count - 1:
            run_log.write(root, run_log.LoggedRun("many", {"crop": "*.png"}, (0,), steps))
            steps = {}
    store.remove(STAGE, key)


def least_removal(store: Path) -> float:
    """CPU time, s, of removing all results, their records and locks with nothing but the calls for it."""
    began = time.process_time()
    for key in os.listdir(store / "cache" / STAGE):  # noqa: PTH208
        name = record_name(STAGE, key)
        folder = f"{store}/cache/{STAGE}/{key}"
        os.close(os.open(f"{store}/locks/{name}.lock", os.O_CREAT | os.O_RDWR))
        for file in os.listdir(folder):  # noqa: PTH208
            os.unlink(f"{folder}/{file}")  # noqa: PTH108
        os.rmdir(folder)  # noqa: PTH106
        os.unlink(f"{store}/records/{name}")  # noqa: PTH108
        os.unlink(f"{store}/locks/{name}.lock")  # noqa: PTH108
    return time.process_time() - began


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--results", type=int, default=100_000)
    parser.add_argument("--against", type=Path, help="folder with another texloom, which is measured beside")
    options = parser.parse_args()
    programs = {"this": os.environ.get("PYTHONPATH", "")}
    if options.against is not None:
        programs["other"] = str(options.against)
    count = options.results
    with tempfile.TemporaryDirectory() as name:
        places = {(program, many): Path(name, f"{program}{many}") for program in programs for many in (1, count)}
        for (_, many), place in places.items():
            make_store(place / "store", many)
        print(f"{'command':10} {'program':7} {'wall time':>11} {'CPU time':>11} {'of a million':>13} {'memory':>8}")
        for label, arguments in COMMANDS.items():
            for program, path in programs.items():
                os.environ["PYTHONPATH"] = path
                times = 1 if label in ("ls first", "prune all") else _TIMES
                start = min(run(places[program, 1], *arguments)[1] for _ in range(times))
                wall, cpu, memory = map(
                    min, zip(*(run(places[program, count], *arguments) for _ in range(times)), strict=True)
                )
                million = start + max(0.0, cpu - start) * 1e6 / count
                print(
                    f"{label:10} {program:7} {wall:9.2f} s {cpu:9.2f} s {million:11.1f} s {memory:5.0f} MB",
                    flush=True,
                )
        make_store(Path(name, "least"), count)
        cpu = least_removal(Path(name, "least"))
        print(f"{'at least':10} {'':7} {'':11} {cpu:9.2f} s {cpu * 1e6 / count:11.1f} s")


if __name__ == "__main__":
    main()
