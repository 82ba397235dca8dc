"""What looking after a store of very many results takes: list, verify, limit and prune.

    python -m benchmarks.large_store --results 100000

makes a store of so many small results, each with an EXR, a picture and a record, and prints wall time, CPU
time and peak memory of each command, and the CPU time for a million results. Data files are hard links to those of
one result, so that a million take 12 GB; each command reads them all the same. The first
listing has no index of sizes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.many_items import run
from texloom.pipelines.store.record import encode_record, record_name
from texloom.pipelines.store.result_files import MANIFEST
from texloom.pipelines.store.store import Store
from texloom.stages.lookup.registry import find_stage

STAGE = "analysis.otsu"
_LINKS = 30_000  # of a file; ext4 has 65,000 at most


def make_store(root: Path, count: int) -> None:
    """Write a result, and copies of it under other keys."""
    stage = find_stage(STAGE)
    store = Store(root)
    store.create()
    values = np.zeros((16, 16), np.uint8)
    key = hashlib.sha256(b"first").hexdigest()
    first = store.save(stage, key, stage.result(values.astype(bool), 0.5), {"params": {}, "inputs": {}})
    manifest = json.loads((first.folder / MANIFEST).read_bytes())
    cache, names = first.folder.parent, list(manifest["files"])
    for number in range(count):
        other = hashlib.sha256(str(number).encode()).hexdigest()
        folder = cache / other
        folder.mkdir()
        if number % _LINKS == 0:
            for name in names:
                status = (first.folder / name).stat()
                (folder / name).write_bytes((first.folder / name).read_bytes())
                os.utime(folder / name, ns=(status.st_mtime_ns, status.st_mtime_ns))
            linked = folder
        else:
            for name in names:
                os.link(linked / name, folder / name)
        content = json.dumps({**manifest, "key": other}).encode()
        (folder / MANIFEST).write_bytes(content)
        record = {**first.record, "key": other, "manifest": hashlib.sha256(content).hexdigest()}
        name = record_name(STAGE, other)
        (store.records / name).write_bytes(encode_record(record, name))
    store.remove(STAGE, key)


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--results", type=int, default=100_000)
    count = parser.parse_args().results
    commands = {
        "ls first": ["store", "ls"],
        "ls": ["store", "ls"],
        "verify": ["store", "verify"],
        "prune none": ["store", "prune", "--days", "1"],
        "limit set": ["store", "limit", "1000TB"],
        "limit kept": ["store", "limit"],
        "prune all": ["store", "prune", "--days", "0"],
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_store(folder / "store", count)
        print(f"{'command':10} {'wall time':>11} {'CPU time':>11} {'of a million':>13} {'memory':>8}")
        for label, arguments in commands.items():
            wall, cpu, memory = run(folder, *arguments)
            print(f"{label:10} {wall:9.2f} s {cpu:9.2f} s {cpu * 1e6 / count:11.1f} s {memory:5.0f} MB", flush=True)


if __name__ == "__main__":
    main()
