"""Times and energies of inverse texture synthesis, at the sizes of [Wei2008]_ table 2.

    python -m benchmarks.inverse                    the improved solver
    python -m benchmarks.inverse --basic            and the basic solver beside it (minutes)
    python -m benchmarks.inverse --texture rust.png --control wetness.png
    python -m benchmarks.inverse --resynthesis --pair rust.png wetness.png --pair earth.jpg water.png --pictures out
                                                    textures for their mirrored control maps, from the originals
                                                    and from compactions as in the flow per_pixel_control

Times are the best of ``--repeats`` runs in this process after one that compiles the kernels. The paper's times,
like `compact`, exclude the clusters and similarity sets, which are shared by all sizes; they are listed as
`prepared`. Energies are those of the returned image without the seam penalty, with exhaustive search. For the
basic solver the energy of its means, from which its image is copied, is listed too.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.timing import Seconds, fastest
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import preview
from texloom.pipelines.store.png_file import png
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.analysis.similarity.k_coherence import KCoherenceParams, k_coherence
from texloom.stages.analysis.similarity.tsvq import Tsvq, TsvqParams, tsvq
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features
from texloom.stages.synthesis.inverse.compact import Compacted, CompactParams, compact
from texloom.stages.synthesis.inverse.level import Matching, TextureLevel, Tree
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixelParams, per_pixel
from texloom.stages.synthesis.reconstruction.reconstruct import ReconstructParams, reconstruct
from texloom.stages.vocabulary.arrays import Image

CASES = [("banana", (540, 720), (64, 64), 14.0, 147.0), ("peeling", (488, 615), (128, 128), 263.0, 1637.0)]
"""name in the paper, texture, compaction, the paper's seconds with the improved and the basic solver"""

AXES = ("fidelity", "detail", "variety")
"""of the scores"""

SEED = 7
"""of the compactions whose times are taken"""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A texture and its analysis before compaction."""

    texture: Image
    control: Image
    features: np.ndarray
    tree: Tsvq
    candidates: np.ndarray

    @classmethod
    def of(cls, texture: Image, control: Image, **params: Any) -> Prepared:
        """Analyse a texture; ``params`` are those of `control_features`."""
        features = control_features(texture, ControlFeaturesParams(**params), control).planes
        tree = tsvq(features, TsvqParams())
        candidates = k_coherence(features, tree.nodes, tree.leaf, KCoherenceParams()).candidates
        return cls(texture, control, features, tree, candidates)

    def compacted(self, seed: int, **params: Any) -> Compacted:
        """The compaction."""
        options = CompactParams(**params)
        tree, random = self.tree, np.random.default_rng(seed)
        return compact(
            self.texture, self.features, tree.nodes, tree.leaf, self.candidates, options, random, self.control
        )

    def energy(self, result: Compacted) -> float:
        """Inverse plus forward term of a result, by exhaustive search."""
        tree = Tree(self.tree.nodes, self.tree.leaf, self.candidates)
        level = TextureLevel(self.features, 7, 2, tree, TsvqParams(), KCoherenceParams())
        source = np.ascontiguousarray(np.moveaxis(result.source.astype(np.int32), 2, 0))
        matching = Matching(level, source, 0.01, 0.0)
        matching.match_inverse(matching.propose_by_search())
        matching.match_forward_by_search()
        return sum(matching.energy())


def means(result: Compacted) -> float:
    """Inverse plus forward term of the basic solver's means."""
    last = result.energy[-1]
    return float(last["inverse"] + last["forward"])


def scaled(image: Image, shape: tuple[int, int]) -> Image:
    """The image at another size."""
    return Image(np.ascontiguousarray(resize(image.pixels, *shape), np.float32), image.channels)


@dataclasses.dataclass(frozen=True)
class Exemplar:
    """An exemplar with its control map."""

    image: Image
    control: Image
    is_compaction: bool = False
    """a toroidal compaction, used with the flow's params; otherwise default params are used"""


def by_pixels(exemplar: Exemplar, target: Image, seed: int) -> Image:
    """A texture by `per_pixel`, including the exemplar's analysis."""
    analysis, arrangement = (
        (flow_params("appearance"), flow_params("result")) if exemplar.is_compaction else ({}, {})
    )
    known = appearance_stack(exemplar.image.wrapping(exemplar.is_compaction), AppearanceStackParams(**analysis))
    return per_pixel(
        exemplar.image, known.appearance, known.basis, known.candidates, known.toroidal,
        PerPixelParams(**arrangement), np.random.default_rng(seed), exemplar.control, target,
    ).image  # fmt: skip


def by(**params: Any) -> Callable[[Exemplar, Image, int], Image]:
    """A texture by `reconstruct`."""
    options = ReconstructParams(**params)
    return lambda exemplar, target, seed: (
        reconstruct(
            exemplar.image, options, np.random.default_rng(seed), control=exemplar.control, target=target
        ).image
    )


SOLVERS = {
    "per_pixel": by_pixels,
    "discrete": by(solver="discrete"),
    "optimise": by(solver="optimise"),
}


@functools.cache
def flow_params(step: str) -> dict[str, Any]:
    """The params of a step in the flow per_pixel_control."""
    params = load_flow(find_flow("per_pixel_control")).steps[step].params
    return {name: getattr(params, name) for name in params.model_fields_set}


def print_resynthesis(name: str, texture: Image, control: Image, options: argparse.Namespace) -> None:
    """Synthesise a texture for its mirrored control map, from the original and from its compaction."""
    factor = min(1.0, options.longest / max(texture.height, texture.width))
    shape = (round(texture.height * factor), round(texture.width * factor))
    texture, control = scaled(texture, shape), scaled(control, shape)
    target = Image(np.ascontiguousarray(control.pixels[:, ::-1]), control.channels)
    prepared = Prepared.of(texture, control, **flow_params("features"))
    pictures = {"mirrored": Image(np.ascontiguousarray(texture.pixels[:, ::-1]), texture.channels)}
    for seed in options.seeds:
        small = prepared.compacted(seed, **{**flow_params("compact"), **dict(options.set)})
        assert small.control is not None
        pictures[f"compaction_{seed}"] = small.image
        exemplars = {
            "original": Exemplar(texture, control),
            "compaction": Exemplar(small.image, small.control, is_compaction=True),
        }
        for solver in options.solvers:
            spent: list[Seconds] = []
            for kind, exemplar in exemplars.items():
                work = functools.partial(SOLVERS[solver], exemplar, target, seed)
                seconds, result = fastest(work, options.repeats)
                figures = metrics(texture, result, MetricsParams()).table
                spent.append(seconds)
                pictures[f"{solver}_{kind}_{seed}"] = result
                scores = "".join(f"{figures['summary'][axis]:10.3f}" for axis in AXES)
                print(
                    f"{name:28.28}{solver:>10}{seed:5} {kind:11}{seconds.wall:8.2f} ({seconds.cpu:5.2f})"
                    f"{spent[0].cpu / seconds.cpu:7.1f}{scores}{figures['measures']['sharpness']['value']:11.3f}",
                    flush=True,
                )
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for label, picture in pictures.items():
            (options.pictures / f"{name}_{label}.png").write_bytes(as_png(picture))


def param(text: str) -> tuple[str, Any]:
    """A parameter and its value, in YAML."""
    name, _, value = text.partition("=")
    return name, yaml.safe_load(value)


def as_png(image: Image) -> bytes:
    """A PNG of an image."""
    levels = preview.picture(dict(zip(image.channels, np.moveaxis(image.pixels, 2, 0), strict=True)))
    assert levels is not None
    return png(levels)


def opened(name: str) -> Image:
    """An image by its path, or its name with a scheme."""
    return open_source("picture", name if ":" in name else str(Path(name).resolve())).read()


def main() -> None:
    """Read the options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--texture", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--control", default="skimage:brick", help="a picture (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="(default: %(default)s)")
    parser.add_argument("--basic", action="store_true", help="run the basic solver too")
    use = parser.add_argument_group("use of compactions")
    use.add_argument("--resynthesis", action="store_true", help="time the use of compactions instead")
    use.add_argument(
        "--pair", nargs=2, action="append", metavar=("TEXTURE", "CONTROL"), help="once for each texture"
    )
    use.add_argument(
        "--solvers", nargs="+", choices=list(SOLVERS), default=["per_pixel"], help="(default: per_pixel)"
    )
    use.add_argument(
        "--set", type=param, action="append", default=[], metavar="PARAM=VALUE",
        help="of `compact`, in place of the flow's",
    )  # fmt: skip
    use.add_argument("--seeds", type=int, nargs="+", default=[7], help="of compactions and textures (default: 7)")
    use.add_argument("--longest", type=int, default=512, help="px of the textures, at most (default: %(default)s)")
    use.add_argument("--pictures", type=Path, help="folder for the pictures")
    options = parser.parse_args()
    named = options.pair or [(options.texture, options.control)]
    pairs = [(opened(texture), opened(control)) for texture, control in named]
    if options.resynthesis:
        print(f"{thread_count()} threads; wall time (CPU time), s, and the ratio of CPU times\n")
        print(
            f"{'texture':28}{'solver':>10} seed {'from':11}{'seconds':>16}{'times':>7}"
            f"{''.join(f'{axis:>10}' for axis in AXES)}{'sharpness':>11}"
        )
        image, control = (scaled(picture, (96, 96)) for picture in pairs[0])
        for solver in options.solvers:  # compiles
            SOLVERS[solver](Exemplar(image, control), control, 0)
        for (texture, control), (name, _) in zip(pairs, named, strict=True):
            print_resynthesis(Path(name.split(":")[-1]).stem, texture, control, options)
        return
    texture, control = pairs[0]
    print(f"{options.texture}, {thread_count()} threads; wall time (CPU time), s\n")
    print(f"{'case':8}{'solver':>20}{'prepared':>16}{'compact':>16}{'paper':>8}{'energy':>9}")
    Prepared.of(scaled(texture, (128, 128)), scaled(control, (64, 64))).compacted(SEED, size=(48, 48))
    for name, shape, size, improved, basic in CASES:
        pair = scaled(texture, shape), scaled(control, (shape[0] // 4, shape[1] // 4))
        before, prepared = fastest(functools.partial(Prepared.of, *pair), options.repeats)
        kinds: list[tuple[str, dict[str, Any], float]] = [
            ("improved", {"solver": "improved"}, improved),
            ("improved, no seams", {"solver": "improved", "seams": 0.0}, improved),
        ]
        if options.basic:
            kinds.append(("basic", {"solver": "basic"}, basic))
        for label, params, paper in kinds:
            work = functools.partial(prepared.compacted, SEED, size=size, **params)
            seconds, result = fastest(work, 1 if label == "basic" else options.repeats)
            print(
                f"{name:8}{label:>20}{before.wall:8.2f} ({before.cpu:5.2f}){seconds.wall:8.2f} ({seconds.cpu:5.2f})"
                f"{paper:8.0f}{prepared.energy(result):9.2f}"
                + (f" (its means {means(result):.2f})" if label == "basic" else ""),
                flush=True,
            )


if __name__ == "__main__":
    main()
