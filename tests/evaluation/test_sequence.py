import json
from typing import Any

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity
from texloom.stages.evaluation.sequence import Sequence, sequence
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

HEIGHT, WIDTH = 48, 56
GAP = 8


def noise(seed: int, height: int = HEIGHT, width: int = WIDTH) -> Image:
    pixels = smooth_noise((height, width, 3), 1.5, np.random.default_rng(seed))
    return Image(pixels.astype(np.float32), ("R", "G", "B"))


@pytest.fixture(scope="module")
def exemplar() -> Image:
    return noise(3)


def tables(exemplar: Image, image: Image) -> tuple[dict[str, Any], dict[str, Any]]:
    return (
        metrics(exemplar, image, MetricsParams()).table,
        regularity(exemplar, image, RegularityParams(), generators=np.zeros((0, 2), np.float32)).table,
    )


def chained(exemplar: Image, images: list[Image]) -> list[Sequence]:
    generations: list[Sequence] = []
    for image in images:
        scores, lattice = tables(exemplar, image)
        before = {"strip": generations[-1].strip, "table": generations[-1].table} if generations else {}
        generations.append(sequence(exemplar, image, scores, lattice, **before))
    return generations


@pytest.fixture(scope="module")
def whole(exemplar: Image) -> list[Sequence]:
    return chained(exemplar, [noise(seed) for seed in (4, 5, 6)])


def test_the_strip_is_all_generations(exemplar: Image, whole: list[Sequence]) -> None:
    white = np.ones((HEIGHT, GAP, 3), np.float32)
    parts = [exemplar.pixels]
    for seed, generation in zip((4, 5, 6), whole, strict=True):
        parts += [white, noise(seed).pixels]
        np.testing.assert_array_equal(generation.strip.pixels, np.concatenate(parts, axis=1))


def test_the_table_has_an_entry_a_generation(exemplar: Image, whole: list[Sequence]) -> None:
    table = whole[-1].table
    json.dumps(table, allow_nan=False)
    assert table["generations"] == 3
    curves = [*table["summary"].values(), *(line["values"] for line in table["measures"].values())]
    assert {len(curve) for curve in curves} == {3}
    assert {"colors", "sharpness", "points"} & set(table["measures"])
    assert table["means"]["detail"] == pytest.approx(np.mean(table["summary"]["detail"]), rel=1e-5)


def test_the_entries_are_the_scores(exemplar: Image, whole: list[Sequence]) -> None:
    table = whole[-1].table
    for index, seed in enumerate((4, 5, 6)):
        for one in tables(exemplar, noise(seed)):
            for axis, score in one["summary"].items():
                assert table["summary"][axis][index] == score
            for name, line in one["measures"].items():
                known = table["measures"][name]
                assert (known["values"][index], known["scores"][index]) == (line["value"], line["score"])
                assert (known["what"], known["floor"]) == (line["what"], line["floor"])


def test_results_of_another_size(exemplar: Image) -> None:
    last = chained(exemplar, [noise(4, 40, 64), noise(5, 40, 64)])[-1]
    assert last.strip.pixels.shape == (HEIGHT, WIDTH + 2 * (64 + GAP), 3)
    assert (last.strip.pixels[40:, WIDTH:] == 1).all()


def test_a_measure_that_a_generation_lacks(exemplar: Image) -> None:
    scores, lattice = tables(exemplar, noise(4))
    one = sequence(exemplar, noise(4), scores)
    two = sequence(exemplar, noise(5), scores, lattice, one.strip, one.table)
    added = set(lattice["measures"]) - set(scores["measures"])
    assert added
    for name in added:
        assert two.table["measures"][name]["values"][0] is None


def test_tables_without_scores_and_other_channels_are_refused(exemplar: Image) -> None:
    scores, _ = tables(exemplar, noise(4))
    with pytest.raises(InputError, match="scores: has no scores"):
        sequence(exemplar, noise(4), {})
    with pytest.raises(InputError, match="image: has Y, the strip R, G, B"):
        sequence(exemplar, Image(np.zeros((20, 20, 1), np.float32), ("Y",)), scores)
