"""How often the scores agree with the eye: which of two results of one exemplar is better.

    TEXLOOM_TEXTURES=folder python -m benchmarks.verdicts render made           the results that the verdicts name
    python -m benchmarks.verdicts sheets made sheets --judging 1                 unnamed results, in random order
    python -m benchmarks.verdicts record sheets ranks.csv --judging 1            adds ranks of the letters on them
    python -m benchmarks.verdicts agreement made                                 of scores and verdicts
    python -m benchmarks.verdicts agreement made --half 0                        of every other exemplar
    TEXLOOM_TEXTURES=folder python -m benchmarks.verdicts choices store          what the flow `auto` chooses

A sheet shows an exemplar and results of several methods, each a letter, at full size; the file that says which
method is which letter is read by `record` only. ``ranks.csv`` has lines such as ``07,A,C=D,B``, best first, for
sheet 07. Verdicts are kept beside this file: of each result its rank, equal where none is better; a pair of results
is judged where the ranks differ. A judging repeats another in another order, for the agreement of the eye with
itself. Exemplars are prepared as by `benchmarks.scores`.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import itertools
import json
import os
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import PIL.Image

from benchmarks.scores import Sample, exemplars, made, table_of
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.stages.evaluation.choice import ChoiceParams, weighted_mean

_FILE = Path(__file__).with_suffix(".csv")
_GAP = 8  # px between pictures of a sheet


class Verdict(NamedTuple):
    """A line of the file."""

    judging: int
    exemplar: str
    """file name of the picture"""
    method: str
    """a flow, and its preset after a colon"""
    seed: int
    rank: int
    """among the results of the exemplar in this judging, 1 is best"""


def verdicts() -> list[Verdict]:
    """All that are recorded."""
    with _FILE.open(newline="") as file:
        lines = list(csv.reader(file))[1:]
    return [
        Verdict(int(one), exemplar, method, int(seed), int(rank)) for one, exemplar, method, seed, rank in lines
    ]


def by_exemplar(judging: int) -> dict[str, list[Verdict]]:
    """The verdicts of a judging by exemplar, in alphabetical order."""
    chosen = sorted((one for one in verdicts() if one.judging == judging), key=lambda one: one[1:4])
    return {name: list(group) for name, group in itertools.groupby(chosen, key=lambda one: one.exemplar)}


def samples(folder: Path, results: Sequence[tuple[str, str, int]]) -> Iterator[tuple[tuple[str, str, int], Sample]]:
    """The results, by exemplar, method and seed; those that are not in ``folder`` are made."""
    pictures = {}
    if textures := os.environ.get("TEXLOOM_TEXTURES"):
        pictures = {Path(name).name: picture for name, picture in exemplars(Path(textures), None, [])}
    for result in results:
        exemplar, method, seed = result
        flow, _, preset = method.partition(":")
        yield result, made(pictures[exemplar], flow, folder, seed=seed, preset=preset or None)


# -- judging


def shuffled(name: str, results: Sequence[tuple[str, int]], judging: int) -> list[tuple[str, int]]:
    """The results in the order of their letters."""
    rng = np.random.default_rng(zlib.crc32(f"{name} {judging}".encode()))
    return [results[place] for place in rng.permutation(len(results))]


def sheet(sample: Sequence[Sample]) -> np.ndarray:
    """The exemplar and results in rows of three, with letters; BGR bytes."""
    import cv2

    pictures = [sample[0][0], *(one[1] for one in sample)]
    height, width = pictures[1].shape[:2]
    columns = min(3, len(pictures))
    whole = np.full((-(-len(pictures) // columns) * (height + 28), columns * (width + _GAP), 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = number // columns * (height + 28), number % columns * (width + _GAP)
        whole[top + 24 : top + 24 + len(picture), left : left + picture.shape[1]] = np.rint(
            np.clip(picture[..., ::-1], 0, 1) * 255
        )
        letter = "exemplar" if number == 0 else chr(64 + number)
        cv2.putText(whole, letter, (left, top + 19), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0, 0, 0), 2)
    return whole


def write_sheets(made_folder: Path, out: Path, judging: int) -> None:
    """Write a sheet for each exemplar, of a third of them after the first judging, and the key."""
    import cv2

    out.mkdir(parents=True, exist_ok=True)
    known = by_exemplar(1)
    names = list(known) if judging == 1 else list(known)[judging % 3 :: 3]
    order = np.random.default_rng(judging).permutation(len(names))
    key = {}
    for number, place in enumerate(order):
        name = names[place]
        results = shuffled(name, sorted({(one.method, one.seed) for one in known[name]}), judging)
        wanted = [(name, method, seed) for method, seed in results]
        cv2.imwrite(
            str(out / f"{judging}-{number:02}.png"), sheet([one for _, one in samples(made_folder, wanted)])
        )
        key[f"{number:02}"] = [name, results]
    (out / f"key-{judging}.json").write_text(json.dumps(key))


def record(sheets: Path, ranks: Path, judging: int) -> None:
    """Replace the verdicts of a judging by those of ``ranks``."""
    key = json.loads((sheets / f"key-{judging}.json").read_text())
    lines = [one for one in verdicts() if one.judging != judging]
    for number, *groups in csv.reader(ranks.read_text().splitlines()):
        name, results = key[number]
        letters = [letter for group in groups for letter in group.split("=")]
        if sorted(letters) != [chr(65 + place) for place in range(len(results))]:
            raise SystemExit(f"{ranks}: sheet {number} has {len(results)} results, not {','.join(groups)}")
        for rank, group in enumerate(groups, 1):
            for letter in group.split("="):
                method, seed = results[ord(letter) - 65]
                lines.append(Verdict(judging, name, method, seed, rank))
    write_verdicts(lines)


def write_verdicts(lines: Sequence[Verdict]) -> None:
    """Write the file, in order."""
    with _FILE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Verdict._fields)
        writer.writerows(sorted(lines))


# -- agreement


def pairs(known: Sequence[Verdict]) -> Iterator[tuple[tuple[str, int], tuple[str, int], int]]:
    """Two results of one exemplar, and -1, 0 or 1 where the first is better, equal or worse."""
    for one, other in itertools.combinations(known, 2):
        yield (one.method, one.seed), (other.method, other.seed), int(np.sign(one.rank - other.rank))


def own_agreement() -> tuple[int, int, int]:
    """Pairs that two judgings decide, of these those decided alike, and pairs that one of them alone decides."""
    first, both, alike, one_only = by_exemplar(1), 0, 0, 0
    for name, again in by_exemplar(2).items():
        before = {pair[:2]: pair[2] for pair in pairs(first[name])}
        for *pair, sign in pairs(again):
            own = before[pair[0], pair[1]]
            both += bool(sign and own)
            alike += bool(sign and own == sign)
            one_only += bool(sign) != bool(own)
    return both, alike, one_only


def report(folder: Path, half: int | None) -> None:
    """Print how often the better total of `choice` has the better rank, and how often two judgings agree."""
    both, alike, one_only = own_agreement()
    print(f"the eye with itself: {alike} of {both} pairs; {one_only} pairs are decided by one of two judgings only")
    known, weights = by_exemplar(1), ChoiceParams().weights
    agreed, ties, decided = 0.0, 0, 0
    for name in list(known) if half is None else list(known)[half::2]:
        results = [(name, one.method, one.seed) for one in known[name]]
        scores = {
            result[1:]: weighted_mean(table_of(sample)["summary"], weights) or 0.0
            for result, sample in samples(folder, results)
        }
        signs = [(scores[one], scores[other], sign) for one, other, sign in pairs(known[name])]
        agreed += sum(np.sign(other - one) == sign for one, other, sign in signs if sign)
        decided += sum(sign != 0 for *_, sign in signs)
        ties += sum(sign == 0 for *_, sign in signs)
        print(name, {":".join(map(str, result)): score for result, score in scores.items()}, flush=True)
    print(f"scores and the eye: {agreed:.0f} of {decided} pairs, {agreed / decided:.0%}; {ties} pairs are ties")


def trials(picture: np.ndarray, methods: str, store: Path) -> dict[str, Any]:
    """What `auto` chooses, and why, without the result at full size."""
    store.mkdir(parents=True, exist_ok=True)
    file = store / "exemplar.png"
    PIL.Image.fromarray(picture).save(file)
    flow = load_flow(find_flow("auto"), Overrides({"exemplar": str(file)}, {"methods": methods}))
    needed = {"method"}
    for name in reversed(list(flow.steps)):
        needed.update(flow.steps[name].needs if name in needed else ())
    steps = {name: step for name, step in flow.steps.items() if name in needed}
    run = Run(dataclasses.replace(flow, steps=steps, exports={}, likes={}), Store(store / "store"))
    execute(run, lambda _: None, store / "out")
    return dict(run.store.table(run.shared.artifacts["method"], "table"))


def report_choices(store: Path, half: int | None) -> None:
    """Print what `auto` chooses for each exemplar, of the methods that were judged, and that method's rank."""
    pictures = {
        Path(name).name: picture for name, picture in exemplars(Path(os.environ["TEXLOOM_TEXTURES"]), None, [])
    }
    tried = dict(load_flow(find_flow("auto")).steps["methods"].params)["labels"]
    known, ranks, best = by_exemplar(1), list[int](), 0
    for name in list(known) if half is None else list(known)[half::2]:
        judged = {one.method.partition(":")[0]: one.rank for one in known[name]}
        judged = {method: rank for method, rank in judged.items() if method in tried}
        methods = ",".join(judged)
        table = trials(pictures[name], methods, store)
        ranks.append(judged[table["chosen"]])
        best += min(judged.values()) == judged[table["chosen"]]
        print(name, table["chosen"], judged, table["totals"], flush=True)
    rank = f"mean rank {np.mean(ranks):.2f}"
    print(f"the first choice of the eye is chosen for {best} of {len(ranks)} exemplars; {rank}")


def main() -> None:
    """Read the command and do it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("render", "sheets", "record", "agreement", "choices"))
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--judging", type=int, default=1)
    parser.add_argument("--half", type=int, choices=(0, 1), help="only every other exemplar")
    options = parser.parse_args()
    if options.command == "record":
        record(options.folders[0], options.folders[1], options.judging)
    elif options.command == "choices":
        report_choices(options.folders[0], options.half)
    elif options.command == "sheets":
        write_sheets(options.folders[0], options.folders[1], options.judging)
    elif options.command == "render":
        for (name, method, seed), _ in samples(options.folders[0], sorted({one[1:4] for one in verdicts()})):
            print(name, method, seed, flush=True)
    else:
        report(options.folders[0], options.half)


if __name__ == "__main__":
    main()
