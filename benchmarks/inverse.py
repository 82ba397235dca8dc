"""Times and energies of inverse texture synthesis, at the sizes of [Wei2008]_ table 2.

    python benchmarks/inverse.py                    the improved solver, warm
    python benchmarks/inverse.py --basic            and the basic solver beside it (minutes)
    python benchmarks/inverse.py --resynthesis      a texture of new control, from the original and its compaction
    python benchmarks/inverse.py --texture rust.png --control wetness.png

Times are the best of ``--repeats`` runs in this process after one that compiles the kernels. The paper's times, as
`compact`, leave out the clusters and similarity sets, which serve every size; they are `prepared` here. Energies
are those of the returned picture, without the price on seams, all matches found by searching everything. Beside it
stands that of the basic solver's means, from which its picture is copied.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from pipelines.sources import open_source
from stages.analysis.k_coherence import KCoherenceParams, k_coherence
from stages.analysis.tsvq import Tsvq, TsvqParams, tsvq
from stages.arrays import Image
from stages.evaluation.metrics import MetricsParams, metrics
from stages.kernels.threads import thread_count
from stages.synthesis._features import resize
from stages.synthesis._inverse import Level, Matching, Tree
from stages.synthesis.compact import Compacted, CompactParams, compact
from stages.synthesis.control_features import ControlFeaturesParams, control_features
from stages.synthesis.reconstruct import Reconstructed, ReconstructParams, reconstruct

T = TypeVar("T")

CASES = [("banana", (540, 720), (64, 64), 14.0, 147.0), ("peeling", (488, 615), (128, 128), 263.0, 1637.0)]
"""name in the paper, texture, compaction, the paper's seconds with the improved and the basic solver"""


@dataclasses.dataclass(frozen=True)
class Times:
    """Seconds."""

    wall: float
    cpu: float


def best(work: Callable[[], T], repeats: int) -> tuple[Times, T]:
    """The fastest of some runs, and what it returned."""
    runs = []
    for _ in range(repeats):
        began, used = time.perf_counter(), time.process_time()
        result = work()
        runs.append((time.perf_counter() - began, time.process_time() - used, result))
    wall, cpu, result = min(runs, key=lambda run: run[0])
    return Times(wall, cpu), result


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A texture and what is known of it before its compaction."""

    texture: Image
    control: Image
    features: np.ndarray
    tree: Tsvq
    similar: np.ndarray

    @classmethod
    def of(cls, texture: Image, control: Image) -> Prepared:
        """Do what serves every size."""
        features = control_features(texture, ControlFeaturesParams(), control).planes
        tree = tsvq(features, TsvqParams())
        similar = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams()).similar
        return cls(texture, control, features, tree, similar)

    def compacted(self, size: tuple[int, int], solver: Literal["improved", "basic"], **params: Any) -> Compacted:
        """The compaction."""
        given = CompactParams(size=size, solver=solver, **params)
        tree, random = self.tree, np.random.default_rng(7)
        return compact(
            self.texture, self.features, tree.nodes, tree.leaf, self.similar, given, random, self.control
        )

    def energy(self, result: Compacted) -> float:
        """Inverse and forward term of a result, exactly."""
        tree = Tree(self.tree.nodes, self.tree.leaf, self.similar)
        level = Level(self.features, 7, 2, tree, TsvqParams(), KCoherenceParams())
        source = np.ascontiguousarray(np.moveaxis(result.source.astype(np.int32), 2, 0))
        matching = Matching(level, source, 0.01, 0.0)
        matching.match_inverse(matching.propose_by_search())
        matching.match_forward_by_search()
        return sum(matching.energy())


def means(result: Compacted) -> float:
    """Inverse and forward term of what the basic solver ends with, whose pixels are copied from nowhere."""
    last = result.energy[-1]
    return float(last["inverse"] + last["forward"])


def scaled(image: Image, shape: tuple[int, int]) -> Image:
    """The picture at the size of a case."""
    return Image(np.ascontiguousarray(resize(image.pixels, *shape), np.float32), image.channels)


def print_resynthesis(texture: Image, control: Image, repeats: int) -> None:
    """Make the first case's texture under its mirrored control map, from the original and from its compaction.

    ``stray`` is how far the sources' control is from what was wanted, mean, as a share of its range.
    """
    _, shape, _, _, _ = CASES[0]
    texture, control = scaled(texture, shape), scaled(control, shape)
    target = Image(np.ascontiguousarray(control.pixels[:, ::-1]), control.channels)
    small = Prepared.of(texture, control).compacted((128, 128), "improved")
    assert small.control is not None
    exemplars = [("original", texture, control), ("128x128", small.image, small.control)]
    print(f"\n{'from':10}{'solver':>10}{'seconds':>16}{'fidelity':>10}{'sharpness':>11}{'stray':>8}")
    for name, image, own in exemplars:
        for given in (ReconstructParams(occurrence=20), ReconstructParams(solver="discrete", occurrence=50)):

            def made(image: Image = image, own: Image = own, given: ReconstructParams = given) -> Reconstructed:
                return reconstruct(image, given, np.random.default_rng(7), control=own, target=target)

            times, result = best(made, repeats)
            figures = metrics(texture, result.image, MetricsParams()).table
            got = own.pixels[result.match[..., 0], result.match[..., 1]]
            stray = float(np.abs(got - target.pixels).mean() / np.ptp(control.pixels))
            print(
                f"{name:10}{given.solver:>10}{times.wall:8.2f} ({times.cpu:5.2f})"
                f"{figures['summary']['fidelity']:10.3f}{figures['measures']['sharpness']['value']:11.3f}{stray:8.3f}",
                flush=True,
            )


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--texture", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--control", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="(default: %(default)s)")
    parser.add_argument("--basic", action="store_true", help="run the basic solver too")
    parser.add_argument("--resynthesis", action="store_true", help="time the use of a compaction instead")
    options = parser.parse_args()
    names = [name if ":" in name else str(Path(name).resolve()) for name in (options.texture, options.control)]
    texture, control = (open_source("picture", name).read() for name in names)
    print(f"{names[0]}, {thread_count()} threads; seconds (processor seconds)\n")
    if options.resynthesis:
        print_resynthesis(texture, control, options.repeats)
        return
    print(f"{'case':8}{'solver':>20}{'prepared':>16}{'compact':>16}{'paper':>8}{'energy':>9}")
    Prepared.of(scaled(texture, (128, 128)), scaled(control, (64, 64))).compacted((48, 48), "improved")
    for name, shape, size, improved, basic in CASES:
        pair = scaled(texture, shape), scaled(control, (shape[0] // 4, shape[1] // 4))
        before, prepared = best(lambda pair=pair: Prepared.of(*pair), options.repeats)  # type: ignore[misc]
        kinds: list[tuple[str, dict[str, Any], float]] = [
            ("improved", {"solver": "improved"}, improved),
            ("improved, no seams", {"solver": "improved", "seams": 0.0}, improved),
        ]
        if options.basic:
            kinds.append(("basic", {"solver": "basic"}, basic))
        for label, params, paper in kinds:
            times, result = best(
                lambda given=params, size=size, prepared=prepared: prepared.compacted(size, **given),  # type: ignore[misc]
                1 if label == "basic" else options.repeats,
            )
            print(
                f"{name:8}{label:>20}{before.wall:8.2f} ({before.cpu:5.2f}){times.wall:8.2f} ({times.cpu:5.2f})"
                f"{paper:8.0f}{prepared.energy(result):9.2f}"
                + (f" (its means {means(result):.2f})" if label == "basic" else ""),
                flush=True,
            )


if __name__ == "__main__":
    main()
