import dataclasses
import json
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from tests.synthetic import smooth_noise, stamped
from texloom.pipelines.store import codec
from texloom.stages.analysis.edges import EdgesParams, edges
from texloom.stages.analysis.guidance_weight import GuidanceWeightParams, guidance_weight
from texloom.stages.analysis.lattice import LatticeParams, lattice
from texloom.stages.analysis.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.analysis.otsu import OtsuParams, otsu
from texloom.stages.analysis.signed_distance import signed_distance
from texloom.stages.arrays import Image
from texloom.stages.checkpoints import Checkpoints
from texloom.stages.declare import InputError, find_stage
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity
from texloom.stages.evaluation.sequence import Sequence, SequenceGeneration, SequenceParams, sequence
from texloom.stages.progress import Progress, listening, part, report
from texloom.stages.synthesis.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimise import PRESETS, Optimised, OptimiseParams, optimise

HEIGHT, WIDTH = 48, 56
GAP = 8


class Memory(Checkpoints):
    """Checkpoints that break the run off after ``last`` has been saved."""

    def __init__(self, last: int | None = None):
        self.last = last
        self.saved: dict[int, SequenceGeneration] = {}

    def latest(self, state: type[Any]) -> tuple[int, Any] | None:
        assert state is SequenceGeneration
        return max(self.saved.items(), default=None)

    def save(self, level: int, state: Any) -> None:
        self.saved[level] = state
        if level == self.last:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def exemplar() -> Image:
    pixels = smooth_noise((HEIGHT, WIDTH, 3), 1.5, np.random.default_rng(3))
    return Image(pixels.astype(np.float32), ("R", "G", "B"))


def run(exemplar: Image, checkpoints: Checkpoints | None = None, **params: Any) -> Sequence:
    chosen = SequenceParams(**{"generations": 3, "preset": "fast", **params})
    given = {} if checkpoints is None else {"checkpoints": checkpoints}
    return sequence(exemplar, chosen, np.random.default_rng(11), **given)


@pytest.fixture(scope="module")
def whole(exemplar: Image) -> tuple[Sequence, list[Progress]]:
    seen: list[Progress] = []
    with listening(seen.append):
        return run(exemplar), seen


def by_hand(image: Image, size: tuple[int, int], rng: np.random.Generator) -> Optimised:
    """The steps of configs/self_tuning.yaml."""
    mask = otsu(edges(image, EdgesParams()).strength, OtsuParams()).mask
    distance = signed_distance(mask)
    weight = guidance_weight(image, distance.pixels, GuidanceWeightParams()).weight
    density = offset_statistics(image, OffsetStatisticsParams()).density
    generators = lattice(image, density, LatticeParams()).generators
    at_start, at_optimisation = rng.spawn(2)
    start = initialise(image, InitialiseParams(size=size), at_start, mask=mask, generators=generators).match
    params = OptimiseParams(preset="fast")
    return optimise(image, start, params, at_optimisation, distance.field, weight, generators)


def assert_same(one: Sequence, other: Sequence) -> None:
    for field in dataclasses.fields(Sequence):
        first, second = getattr(one, field.name), getattr(other, field.name)
        if isinstance(first, Image):
            assert first.channels == second.channels
            first, second = first.pixels, second.pixels
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second)
        else:
            assert first == second


def test_each_generation_is_the_method_on_the_one_before(
    exemplar: Image, whole: tuple[Sequence, list[Progress]]
) -> None:
    found = whole[0]
    image, match, strip = exemplar, None, exemplar.pixels
    white = np.ones((HEIGHT, GAP, 3), np.float32)
    for index, random in enumerate(np.random.default_rng(11).spawn(3)):
        made = by_hand(image, (HEIGHT, WIDTH), random)
        match = made.match if match is None else match[made.match[..., 0], made.match[..., 1]]
        image, strip = made.image, np.concatenate([strip, white, made.image.pixels], axis=1)
        scores = metrics(exemplar, image, MetricsParams(), match=match).table
        for name, line in scores["measures"].items():
            assert line["value"] == found.table["measures"][name]["values"][index]
            assert line["score"] == found.table["measures"][name]["scores"][index]
            assert line["floor"] == found.table["measures"][name]["floor"]
        for axis, score in scores["summary"].items():
            assert score == found.table["summary"][axis][index]
        assert found.table["energy"][index] == made.scales[-1]["energy"]
    np.testing.assert_array_equal(found.last.pixels, image.pixels)
    np.testing.assert_array_equal(found.match, match)
    np.testing.assert_array_equal(found.strip.pixels, strip)


def test_the_table_has_an_entry_a_generation(whole: tuple[Sequence, list[Progress]]) -> None:
    table = whole[0].table
    json.dumps(table, allow_nan=False)
    assert table["generations"] == 3
    curves = [table[name] for name in ("energy", "weight", "confidence", "generators")]
    curves += [*table["summary"].values(), *(line["values"] for line in table["measures"].values())]
    assert {len(curve) for curve in curves} == {3}
    assert {"colors", "sharpness", "coherence", "completeness", "use", "continuity"} <= set(table["measures"])
    assert table["measures"]["use"]["values"][0] is not None
    assert table["means"]["detail"] == pytest.approx(np.mean(table["summary"]["detail"]), rel=1e-5)


def test_regularity_goes_by_the_first_lattice(rng: np.random.Generator) -> None:
    regular = stamped(np.array([[24.0, 0.0], [0.0, 24.0]]), rng, (120, 128))
    found = run(regular, generations=2)
    generators = np.array(found.table["generators"][0], np.float32)
    assert generators.shape == (2, 2)
    width = regular.width + GAP
    for index in range(2):
        result = Image(found.strip.pixels[:, (index + 1) * width :][:, : regular.width].copy(), regular.channels)
        table = regularity(regular, result, RegularityParams(), generators=generators).table
        assert table["summary"]["regularity"] == found.table["summary"]["regularity"][index]
        for name, line in table["measures"].items():
            assert line["value"] == found.table["measures"][name]["values"][index]


def test_progress_rises_to_the_end(whole: tuple[Sequence, list[Progress]]) -> None:
    done = [progress.done for progress in whole[1]]
    assert done == sorted(done)
    assert done[-1] == 1
    assert 0 < done[0] < 1 / 3
    inner = [progress for progress in whole[1] if progress.iteration]
    for generation in range(3):
        assert any(generation / 3 < progress.done < (generation + 1) / 3 for progress in inner)
    assert all(progress.energy is not None and progress.preview is not None for progress in inner)


@pytest.mark.parametrize("level", [1, 2])
def test_a_run_goes_on_where_it_was_broken_off(
    exemplar: Image, whole: tuple[Sequence, list[Progress]], level: int
) -> None:
    kept = Memory(level)
    with pytest.raises(KeyboardInterrupt):
        run(exemplar, kept)
    assert sorted(kept.saved) == list(range(1, level + 1))
    kept.last = None
    seen: list[Progress] = []
    with listening(seen.append):
        assert_same(run(exemplar, kept), whole[0])
    assert seen[0].done > level / 3
    assert seen[-1].done == 1
    assert sorted(kept.saved) == [1, 2]


def test_a_generation_survives_its_files(
    exemplar: Image, whole: tuple[Sequence, list[Progress]], tmp_path: Path
) -> None:
    kept = Memory(1)
    with pytest.raises(KeyboardInterrupt):
        run(exemplar, kept)
    codec.write(kept.saved[1], tmp_path, {})
    kept.last, kept.saved = None, {1: SequenceGeneration(**codec.read(SequenceGeneration, tmp_path))}
    assert_same(run(exemplar, kept), whole[0])


def test_more_generations_begin_alike(exemplar: Image, whole: tuple[Sequence, list[Progress]]) -> None:
    found, longer = run(exemplar, generations=1), whole[0]
    width = 2 * WIDTH + GAP
    np.testing.assert_array_equal(found.strip.pixels, longer.strip.pixels[:, :width])
    np.testing.assert_array_equal(
        found.last.pixels, longer.strip.pixels[:, -WIDTH - 2 * (WIDTH + GAP) :][:, :WIDTH]
    )
    assert found.table["energy"] == longer.table["energy"][:1]


def test_a_size_of_its_own(exemplar: Image) -> None:
    found = run(exemplar, generations=2, size=(40, 64))
    assert found.last.pixels.shape == (40, 64, 3)
    assert found.strip.pixels.shape == (HEIGHT, WIDTH + 2 * (64 + GAP), 3)
    assert (found.strip.pixels[40:, WIDTH:] == 1).all()
    assert found.match.max(axis=(0, 1)).tolist() <= [HEIGHT - 1, WIDTH - 1]


def test_further_channels_ride_along(exemplar: Image) -> None:
    rough = np.indices((HEIGHT, WIDTH)).sum(axis=0)[..., None] / (HEIGHT + WIDTH)
    both = Image(np.concatenate([exemplar.pixels[..., :1], rough], axis=2).astype(np.float32), ("Y", "roughness"))
    found = run(both, generations=1)
    assert found.last.channels == found.strip.channels == ("Y", "roughness")
    assert found.last.pixels[..., 1].std() > 0


@pytest.mark.parametrize(
    ("shape", "params", "message"),
    [
        ((12, 40), {}, "exemplar: no result can be of its 12x40 px .*give a size"),
        ((10, 40), {"size": (32, 32)}, "10x40 px is too small for patches of 10 px"),
        ((8, 40), {"size": (32, 32)}, "8x40 px is too small"),
    ],
)
def test_exemplars_that_are_too_small(shape: tuple[int, int], params: dict[str, Any], message: str) -> None:
    small = Image(np.zeros((*shape, 1), np.float32), ("Y",))
    stage = find_stage("evaluation.sequence")
    assert stage.check is not None
    with pytest.raises(InputError, match=message):
        stage.check(SequenceParams(**params), {"exemplar": small})
    with pytest.raises(InputError, match=message):
        run(small, **params)
    stage.check(SequenceParams(**params), {})


def test_every_preset_can_be_chosen() -> None:
    assert set(get_args(SequenceParams.model_fields["preset"].annotation)) == set(PRESETS)


def test_parts_of_parts() -> None:
    seen: list[float] = []
    with listening(lambda progress: seen.append(progress.done)):
        with part(0.5, 1.0):
            report(Progress(0.0))
            with part(0.0, 0.5):
                report(Progress(0.5))
            report(Progress(1.0))
        report(Progress(0.25))
    assert seen == [0.5, 0.625, 1.0, 0.25]
    with part(0.5, 1.0):
        report(Progress(1.0))  # nobody listens
