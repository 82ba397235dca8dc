"""Many fuzzed cases: ``python -m tests.fuzz --cases 20000`` prints the counts and every distinct failure.

Each batch runs in a process of its own, so that a crash by a signal is reported with the case that caused it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import subprocess
import sys
import time
from collections import Counter, defaultdict

from tests.fuzz.kinds import KINDS, MEMORY, run_case

_BATCH = 200
_SECONDS = 300  # that a batch may take


def _batch(kind: str, first: int, count: int) -> None:
    """Run cases and print a line for each: its number before, its outcome after."""
    for number in range(first, first + count):
        print(f"start {number}", flush=True)
        accepted, problem = run_case(kind, number)
        print(f"end {number} {'accepted' if accepted else 'refused'} {problem or ''}", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"memory {peak}", flush=True)


def _batch_in_process(kind: str, first: int, count: int) -> tuple[str, int, str]:
    """What the process prints, its exit code, and its last line of errors."""
    command = [
        sys.executable,
        "-m",
        "tests.fuzz",
        "--kind",
        kind,
        "--first",
        str(first),
        "--cases",
        str(count),
        "--here",
    ]
    environment = {**os.environ, "TEXLOOM_MEMORY": MEMORY}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, env=environment,
            timeout=_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        return (error.stdout or b"").decode(), 124, f"not ended after {_SECONDS} s"
    return done.stdout, done.returncode, ascii("".join(done.stderr.splitlines()[-1:]))[:200]


def main() -> int:
    """Run the cases of all kinds in turn."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="of all kinds together")
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each kind")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--here", action="store_true", help="in this process")
    given = parser.parse_args()
    kinds = given.kind or list(KINDS)
    if given.here:
        for kind in kinds:
            _batch(kind, given.first, given.cases)
        return 0
    began, peak = time.monotonic(), 0
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    failures: dict[str, list[int]] = defaultdict(list)
    position = dict.fromkeys(kinds, given.first)
    last = {kind: given.first + given.cases // len(kinds) for kind in kinds}
    with contextlib.suppress(KeyboardInterrupt):  # then what has been counted is printed
        while any(position[kind] < last[kind] for kind in kinds) and time.monotonic() < began + given.seconds:
            for kind in kinds:
                count = min(_BATCH, last[kind] - position[kind])
                if count < 1:
                    continue
                output, code, last_line = _batch_in_process(kind, position[kind], count)
                position[kind] += count
                for number, outcome, problem in re.findall(r"^end (\d+) (\w+) (.*)$", output, re.MULTILINE):
                    counts[kind][outcome] += 1
                    if problem:
                        failures[f"{kind}: {problem}"].append(int(number))
                started = re.findall(r"^start (\d+)$", output, re.MULTILINE)
                if code and started:
                    failures[f"{kind}: the process ended with {code}: {last_line}"].append(int(started[-1]))
                    position[kind] = int(started[-1]) + 1
                elif code:
                    failures[f"{kind}: the process ended with {code} before any case: {last_line}"].append(
                        position[kind] - count
                    )
                peak = max([peak, *map(int, re.findall(r"^memory (\d+)$", output, re.MULTILINE))])
    for kind, outcomes in counts.items():
        print(f"{kind:10} {outcomes.total():6} cases, {outcomes['accepted']:6} accepted")
    total = sum(outcomes.total() for outcomes in counts.values())
    print(
        f"{total} cases in {time.monotonic() - began:.0f} s, at most {peak} MB, {len(failures)} distinct failures"
    )
    for problem, numbers in sorted(failures.items()):
        print(f"{len(numbers):5} x {problem} (case {numbers[0]})")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
